"""The `trisquare` command, also as `python -m trisquare`."""

import signal
import threading
from typing import NoReturn


def main() -> NoReturn:
    """Run the command and exit.

    Until it is loaded, Ctrl-C ends the process by the default action, since the code that reports
    it in a line is not loaded yet.
    """
    is_main = threading.current_thread() is threading.main_thread()
    # SIGINT that is ignored, as in a background job, remains ignored.
    ends = is_main and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if ends:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from trisquare.cli.app import main as run

    if ends:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    run()


if __name__ == "__main__":  # processes of MPI also import this module
    main()

"""The `trisquare` command, also as `python -m trisquare`."""

import signal
from typing import NoReturn


def main() -> NoReturn:
    """Run the command and exit.

    Until it is loaded, Ctrl-C ends the process as it ends other programs: nothing is there yet that
    could say so in a line.
    """
    handler = signal.signal(signal.SIGINT, signal.SIG_DFL)
    from trisquare.cli.app import main as run

    signal.signal(signal.SIGINT, handler)
    run()


if __name__ == "__main__":  # processes of MPI import it, too
    main()

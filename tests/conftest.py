"""Fixtures that several files share."""

import pytest

from trisquare import cli


@pytest.fixture
def run(capfd):
    """Run the command in this process: (exit code, standard output, standard error)."""

    def run_command(*arguments):
        with pytest.raises(SystemExit) as exit_info:
            cli.main([str(argument) for argument in arguments])
        captured = capfd.readouterr()
        return exit_info.value.code, captured.out, captured.err

    return run_command

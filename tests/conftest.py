"""Fixtures shared by several files."""

import os

import pytest
from hypothesis import settings

from trisquare.cli import app as cli


@pytest.fixture
def run(capfd):
    """Run the command in this process: (exit code, standard output, standard error)."""

    def run_command(*arguments):
        with pytest.raises(SystemExit) as exit_info:
            cli.main([str(argument) for argument in arguments])
        captured = capfd.readouterr()
        return exit_info.value.code, captured.out, captured.err

    return run_command


# Results in CI must not depend on chance; a local run explores. No test depends on the machine's
# load.
settings.register_profile("ci", derandomize=True, deadline=None)
settings.register_profile("by hand", deadline=None)
settings.load_profile("ci" if os.environ.get("CI") else "by hand")

"""Commands with a stream on a terminal."""

import os
import subprocess
import sys

import pytest

COMMAND = (sys.executable, "-m", "trisquare")


def on_terminal(arguments, stream, environment):
    """Run with one stream on a terminal; return its output."""
    pty = pytest.importorskip("pty")
    controlling, terminal = pty.openpty()
    streams = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, stream: terminal}
    with subprocess.Popen([*COMMAND, *arguments], env=environment, **streams) as process:
        os.close(terminal)
        shown = b""
        # At the end, Linux raises an error, and other systems return nothing.
        try:
            while part := os.read(controlling, 1 << 16):
                shown += part
        except OSError:
            pass
    os.close(controlling)
    assert process.returncode == 0
    return shown.decode()

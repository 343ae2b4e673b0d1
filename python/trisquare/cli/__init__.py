"""The command line: `trisquare`, with one file a command."""

from trisquare.cli.app import main

__all__ = ["main"]

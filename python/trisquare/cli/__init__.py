"""The command line: `trisquare`, with one file per command."""

from trisquare.cli.app import main

__all__ = ["main"]

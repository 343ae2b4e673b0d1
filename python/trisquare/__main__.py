"""Makes `python -m trisquare` the `trisquare` command."""

from trisquare.cli.app import main

main()

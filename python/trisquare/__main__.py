"""Makes `python -m trisquare` the `trisquare` command."""

from trisquare.cli import main

main()

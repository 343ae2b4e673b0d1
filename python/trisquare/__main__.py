"""Makes `python -m trisquare` the `trisquare` command."""

from trisquare.cli.app import main

if __name__ == "__main__":  # processes of MPI import it, too
    main()

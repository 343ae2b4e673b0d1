"""The commands of `trisquare`, one module each."""

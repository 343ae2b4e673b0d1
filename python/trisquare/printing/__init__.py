"""The printed target: its layout and its PDF."""

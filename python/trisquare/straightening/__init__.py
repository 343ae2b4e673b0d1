"""Distortion from the straight lines of a picture, whatever it shows (the plumb-line method)."""

"""Distortion from the straight lines of a picture, without targets (the plumb-line method)."""

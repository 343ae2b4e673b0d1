"""Detection of targets in a picture with OpenCV: coarse outlines, without edge measurement."""

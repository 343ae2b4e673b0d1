"""Finding targets in a picture with OpenCV: coarse outlines, nothing measured."""

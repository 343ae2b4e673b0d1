"""Edge measurement of detected targets: the stretches of edge, and their samples."""

"""Camera calibration with lens distortion from a single photograph of three squares."""

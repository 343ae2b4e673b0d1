"""Calibration of many cameras, each from its own photographs: jobs, results and summaries."""

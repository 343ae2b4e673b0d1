"""Calibration: gather edges, choose planes, solve, explain a failure."""

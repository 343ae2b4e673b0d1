"""Calibrating: gathering edges, choosing, solving, explaining a failure."""

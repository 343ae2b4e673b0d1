"""Measuring what was found: which stretches of edge, and the samples that they give."""

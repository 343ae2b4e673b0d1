"""Outlines drawn by hand: their files, and snapping them to edges."""

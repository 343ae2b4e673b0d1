"""Solid and framed squares."""

"""Scenes that try the package: photo-like pictures, damage, tags, distractors, and their bounds.

Benchmarks and tests alone use them: they are beside the package in a checkout, and not in the
wheel.
"""

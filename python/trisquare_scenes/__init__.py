"""Scenes that test the package: photo-like pictures, damage, tags, distractors, and their bounds.

Only benchmarks and tests use them: they are beside the package in a checkout, and not in the wheel.
"""

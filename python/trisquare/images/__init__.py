"""Photographs as pixels: complete reading, orientation and tone, encoding."""

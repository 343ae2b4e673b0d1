"""Photographs as pixels: reading them whole, their orientation and tone, encoding."""

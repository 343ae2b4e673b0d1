"""Shared by all rooms: checks of arguments, JSON members, files, numbers as text."""

"""Sheets of markers of known layout."""

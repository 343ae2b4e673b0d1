"""Hand-drawn outlines: their files, and snapping them to edges."""

"""Chessboards: saddle points, and the lattice that links them."""

"""Chessboards: saddle points, the lattice that links them."""

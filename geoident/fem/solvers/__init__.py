"""Sparse direct solvers behind one protocol."""

"""Identification of parameters from readings: vectors in, vectors out, no soil, no meshes."""

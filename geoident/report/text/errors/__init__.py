"""Errors of models in words: of the mesh, of the model itself, of response surfaces."""

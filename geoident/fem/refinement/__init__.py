"""Finer meshes of the same body, and how fast readings converge on them."""

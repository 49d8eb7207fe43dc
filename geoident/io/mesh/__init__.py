"""Meshes of gmsh, Abaqus and whatever meshio reads."""

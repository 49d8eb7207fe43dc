"""Linings and bolts: members on the mesh, their forces, and what a case must satisfy."""

"""The key ``model`` of a case: a program or a function in place of mesh, ground and supports."""

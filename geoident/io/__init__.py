"""The only place with file formats: cases, readings, meshes, results, checkpoints."""

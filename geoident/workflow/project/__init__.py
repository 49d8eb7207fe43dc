"""Several sections of one ground: from a project file to a result."""

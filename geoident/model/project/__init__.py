"""Several sections of one ground, and their laws."""

"""Project files: several sections of one ground."""

"""Bounds of the errors of readings by their adjoints (theory 14.4)."""

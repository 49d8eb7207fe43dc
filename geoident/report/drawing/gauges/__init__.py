"""Readings by instrument, as monitoring reports have them: along their length and over time."""

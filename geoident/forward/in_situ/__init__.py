"""Stress of the virgin ground, and the surfaces from which it counts depth."""

"""Yield surfaces of the ground as planes with derivatives."""

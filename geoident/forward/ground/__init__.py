"""Elasticity of the ground: moduli at parameter values, and whether a section can stay plane."""

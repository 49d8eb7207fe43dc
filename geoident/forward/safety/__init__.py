"""Strength reduction: by what factor the strength of the ground exceeds what equilibrium needs."""

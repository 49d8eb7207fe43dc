"""Soil whose stiffness and strength follow from a law with a state."""

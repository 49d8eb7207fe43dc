"""Draws from the posterior: importance sampling, chains, and whether they are reliable."""

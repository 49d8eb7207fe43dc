"""Draws from the posterior: importance sampling, chains, and whether to believe them."""

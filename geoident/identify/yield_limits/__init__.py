"""Yield limits by complementarity: the search, its certificate, and two independent checks."""

"""The keys of a structure in service: what acts on it over time, and its seasonal model."""

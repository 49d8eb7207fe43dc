"""The reduced model of a staged analysis in elastic ground (theory 14)."""

"""What acts on a structure in service, and what its readings make of it (theory 16)."""

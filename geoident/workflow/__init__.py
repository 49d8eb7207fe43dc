"""One module per command that puts parts together."""

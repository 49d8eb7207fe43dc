"""Readings in time: noise that lasts, regression under it, and detection of changes (theory 16)."""

"""Results as sentences and tables, JSON and CSV."""

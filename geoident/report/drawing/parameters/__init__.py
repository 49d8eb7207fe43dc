"""Parameters: intervals against what was known before, pairs, and scans of the misfit."""

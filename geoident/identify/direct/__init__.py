"""Searches that ask for values of the discrepancy only."""

"""Figures by matplotlib, the only modules that import it."""

"""Structures in service: seasonal models fitted, and readings held against them as they come."""

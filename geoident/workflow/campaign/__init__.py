"""Campaigns: one case in many variations, computed by an executor."""

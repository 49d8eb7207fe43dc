"""Meshes, cases and closed forms that several tests share."""

"""The command ``geoident``: options, progress, exit codes. Nothing heavy is imported before use."""

from geoident.cli.app import main

__all__ = ["main"]

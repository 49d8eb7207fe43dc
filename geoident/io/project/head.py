"""Whether a file is a project, told before anything else of projects is imported."""

from __future__ import annotations

from geoident.io.text.head import said_format

FORMAT = "geoident-project/"


def is_project(path: str) -> bool:
    """Whether a file says that it is a project."""
    return said_format(path).startswith(FORMAT)

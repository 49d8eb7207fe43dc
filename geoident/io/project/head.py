"""Whether a file is a project, told before anything else of projects is imported."""

from __future__ import annotations

from pathlib import Path

FORMAT = "geoident-project/"
_HEAD = 4096
"""Bytes of a file in which its format stands."""


def is_project(path: str) -> bool:
    """Whether a file says that it is a project."""
    try:
        if not Path(path).is_file():  # a pipe would wait for who writes into it
            return False
        with Path(path).open("rb") as file:
            head = file.read(_HEAD)
    except (OSError, ValueError):
        return False
    lines = head.decode("utf-8", "replace").splitlines()
    said = [line.partition(":")[2].strip(" '\"") for line in lines if line.startswith("format:")]
    return bool(said) and said[0].startswith(FORMAT)

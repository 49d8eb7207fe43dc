"""What measured numbers depend on: the versions of geoident and of what it computes with."""

from __future__ import annotations

import platform
import subprocess
from importlib.metadata import version
from pathlib import Path

import geoident


def versions() -> list[str]:
    """Geoident with its commit, Python, and the libraries that compute."""
    found = [f"geoident {geoident.__version__}{_commit()}", f"Python {platform.python_version()}"]
    return found + [f"{library} {version(library)}" for library in ("numpy", "scipy", "gmsh")]


def _commit() -> str:
    """The commit in brackets, after a blank; nothing without git."""
    root = Path(__file__).resolve().parents[2]
    words = ["git", "-C", str(root), "describe", "--always", "--dirty"]
    try:
        done = subprocess.run(words, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    return f" ({done.stdout.strip()})"

"""Meshes that come with geoident: specimens of tests, of unit size."""

from __future__ import annotations

from pathlib import Path

SHIPPED = "geoident:"
"""Begins the name of such a mesh in a case."""


def shipped_meshes() -> dict[str, str]:
    """Name of each such mesh in a case, and its path.

    >>> "geoident:specimen" in shipped_meshes()
    True
    """
    folder = Path(__file__).parent / "shipped_meshes"
    return {f"{SHIPPED}{path.stem}": str(path) for path in sorted(folder.glob("*.msh"))}

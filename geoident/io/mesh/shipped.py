"""Meshes that come with geoident: specimens of tests, of unit size."""

from __future__ import annotations

from pathlib import Path

SHIPPED = "geoident:"
"""Begins the name of such a mesh in a case."""


def shipped_mesh(name: str) -> str:
    """Path of a mesh that comes with geoident, which may not be there.

    >>> Path(shipped_mesh("geoident:specimen")).is_file()
    True
    """
    return str(Path(__file__).parent / "shipped_meshes" / f"{name.removeprefix(SHIPPED)}.msh")

"""The scripts that make the meshes of shipped cases, run in this process."""

from __future__ import annotations

import runpy
import sys
from importlib import import_module
from pathlib import Path

import pytest


def make_mesh(folder: Path, output: Path, *, size: float, order: int) -> None:
    """Run ``make_mesh.py`` of a case; the test is skipped where gmsh is missing.

    Args:
        folder: of the case.
        output: the mesh.
        size: factor on all element sizes.
        order: of the elements.
    """
    try:
        import_module("gmsh")
    except (ImportError, OSError):  # a library of the system that it needs
        pytest.skip("gmsh or an X library that it needs is missing: see README, Start")
    words = [folder / "make_mesh.py", "--size", size, "--order", order, "--output", output]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", [str(word) for word in words])
        patch.setattr(sys, "path", [*sys.path])
        runpy.run_path(str(words[0]), run_name="__main__")

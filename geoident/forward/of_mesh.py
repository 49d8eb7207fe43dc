"""What was found of a mesh, for the next case on the same mesh.

In a campaign one process computes many cases that differ in a few numbers. What depends on the mesh
and on nothing that differs is found once: the same object comes back, so no number is another one.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

from geoident.model.mesh import Mesh

FoundOf = TypeVar("FoundOf")

_MOST = 64
"""Findings that are kept of a mesh."""


class OfMesh(Generic[FoundOf]):
    """Remembers what was found of the mesh that was asked about last, as long as that is there."""

    def __init__(self) -> None:
        self._mesh: weakref.ref[Mesh] | None = None
        self._found: dict[Hashable, FoundOf] = {}

    def __call__(self, mesh: Mesh, key: Hashable, find: Callable[[], FoundOf]) -> FoundOf:
        """What was found before, or is found now.

        Args:
            mesh: that it is of.
            key: all else that it depends on.
            find: finds it; errors are not remembered.
        """
        if self._mesh is None or self._mesh() is not mesh:
            self._mesh, self._found = weakref.ref(mesh, self._gone), {}
        if key not in self._found:
            if len(self._found) >= _MOST:
                self._found.clear()
            self._found[key] = find()
        return self._found[key]

    def _gone(self, mesh: weakref.ref[Mesh]) -> None:
        """Drop the results with their mesh."""
        if self._mesh is mesh:
            self._mesh, self._found = None, {}

"""Results that depend on a mesh alone, kept for the next case on the same mesh.

A campaign computes many cases in one process that differ in a few numbers. What depends on the mesh
and on none of these numbers is computed once, and the same object is used again.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

from geoident.model.mesh import Mesh

Kept = TypeVar("Kept")

_MOST = 64
"""Results that are kept of a mesh: a bound on memory, far above what one case asks for."""


class OfMesh(Generic[Kept]):
    """Keeps results that depend on the mesh asked about last, as long as this mesh exists.

    >>> volume = OfMesh[float]()
    >>> import numpy as np
    >>> mesh = Mesh(np.zeros((0, 2)), ())
    >>> volume(mesh, "rock", lambda: 12.0)
    12.0
    >>> volume(mesh, "rock", lambda: 99.0)  # not computed again
    12.0
    """

    def __init__(self) -> None:
        self._mesh: weakref.ref[Mesh] | None = None
        self._kept: dict[Hashable, Kept] = {}

    def __call__(self, mesh: Mesh, key: Hashable, compute: Callable[[], Kept]) -> Kept:
        """The result kept under a key, or else computed now.

        Args:
            mesh: on which it depends.
            key: all else on which it depends.
            compute: makes it; what raises is not kept.
        """
        if self._mesh is None or self._mesh() is not mesh:
            self._mesh, self._kept = weakref.ref(mesh, self._gone), {}
        if key not in self._kept:
            if len(self._kept) >= _MOST:
                self._kept.clear()
            self._kept[key] = compute()
        return self._kept[key]

    def _gone(self, mesh: weakref.ref[Mesh]) -> None:
        """Drop the results with their mesh."""
        if self._mesh is mesh:
            self._mesh, self._kept = None, {}

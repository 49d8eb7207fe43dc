"""Names for faces inside a mesh, along which it may be split."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from geoident.fem.faces import face_table, patches
from geoident.model.mesh import ElementBlock, Mesh


def with_inner_faces(mesh: Mesh, **tests: Callable[[np.ndarray], np.ndarray]) -> Mesh:
    """The mesh with groups of inner faces all of whose nodes (k, n_a, dim) pass a test (k, n_a)."""
    table = face_table(mesh)
    shared = np.bincount(table.face, minlength=table.n_faces) == 2
    rows = table.side_by_side[shared[table.face[table.side_by_side]]][::2]
    facets, groups = list(mesh.facets), dict(mesh.facet_groups)
    for name, test in tests.items():
        numbers = []
        for patch in patches(mesh, table, rows):
            nodes = patch.nodes[test(mesh.points[patch.nodes]).all(axis=1)]
            first = sum(map(len, facets))
            facets.append(ElementBlock(patch.kind, nodes, np.arange(1, 1 + len(nodes))))
            numbers.append(first + np.arange(len(nodes)))
        groups[name] = np.concatenate(numbers)
    return replace(mesh, facets=tuple(facets), facet_groups=groups)

"""Sizes of a mesh: volumes of its elements, extents and contents of its groups."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from scipy.spatial import cKDTree

from geoident.fem.kinematics import Kinematics, block_geometry
from geoident.model.arrays import Floats, Ints
from geoident.model.cells import CELLS
from geoident.model.mesh import Mesh, nodes_in
from geoident.model.results.summary import MeshSummary, PartSummary


def element_volumes(mesh: Mesh, kinematics: Kinematics) -> Floats:
    """(n_elements,) volumes, m3, of a unit thickness in plane strain."""
    geometries = [block_geometry(mesh.points, block, kinematics) for block in mesh.blocks]
    return np.concatenate([np.abs(g.volumes.sum(axis=1)) for g in geometries])


def coinciding_nodes(mesh: Mesh) -> Ints:
    """Pairs (k, 2) of nodes of elements that stand at one place, up to a part of an edge."""
    used = nodes_in(mesh.blocks, np.ones(mesh.n_elements, dtype=np.bool_))
    shortest = np.inf
    for block in mesh.blocks:
        edges = np.array(CELLS[block.kind].shape.edges)
        ends = mesh.points[block.nodes[:, edges]]
        shortest = min(shortest, np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2).min())
    found = cKDTree(mesh.points[used]).query_pairs(_ONE_PLACE * shortest, output_type="ndarray")
    pairs = used[np.sort(found, axis=1)]
    return np.asarray(pairs[np.lexsort(pairs.T[::-1])], dtype=np.int64)


_ONE_PLACE = 1e-3
"""Distance of nodes, in parts of the shortest edge, up to which they stand at one place."""


def summarize_mesh(mesh: Mesh, kinematics: Kinematics) -> MeshSummary:
    """What a mesh holds."""
    volumes = element_volumes(mesh, kinematics)
    count = np.zeros(mesh.n_elements, dtype=np.int64)
    for members in mesh.groups.values():
        count[members] += 1
    used = np.unique(np.concatenate([block.nodes.ravel() for block in mesh.blocks]))
    return MeshSummary(
        file=mesh.file,
        nodes=mesh.n_nodes,
        kinds=tuple((block.kind, len(block)) for block in mesh.blocks),
        low=_corner(mesh, used, np.min),
        high=_corner(mesh, used, np.max),
        groups=_parts(mesh, mesh.groups, partial(nodes_in, mesh.blocks), volumes),
        facet_groups=_parts(mesh, mesh.facet_groups, partial(nodes_in, mesh.facets)),
        node_groups=_parts(mesh, mesh.node_groups, lambda members: members),
        ungrouped=int(np.count_nonzero(count == 0)),
        shared=int(np.count_nonzero(count > 1)),
    )


def _parts(
    mesh: Mesh,
    groups: Mapping[str, Ints],
    nodes_of: Callable[[Ints], Ints],
    volumes: Floats | None = None,
) -> tuple[PartSummary, ...]:
    return tuple(
        PartSummary(
            name,
            len(members),
            _corner(mesh, nodes_of(members), np.min),
            _corner(mesh, nodes_of(members), np.max),
            None if volumes is None else float(volumes[members].sum()),
        )
        for name, members in groups.items()
        if len(members)
    )


def _corner(mesh: Mesh, nodes: Ints, pick: Callable[..., Floats]) -> tuple[float, ...]:
    return tuple(float(x) for x in pick(mesh.points[nodes], axis=0))

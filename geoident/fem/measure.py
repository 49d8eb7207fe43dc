"""Sizes of a mesh: volumes of its elements, extents and contents of its groups."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from geoident.fem.kinematics import Kinematics, block_geometry
from geoident.fem.near import pairs_within
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
    pairs = pairs_within(mesh.points[used], _ONE_PLACE * shortest)
    return np.asarray(used[pairs], dtype=np.int64)


_ONE_PLACE = 1e-3
"""Distance of nodes, in parts of the shortest edge, up to which they stand at one place."""


def suspected_unit(low: Sequence[float], high: Sequence[float]) -> str:
    """Why the coordinates of a mesh may be no metres, a sentence; empty where they may well be.

    Args:
        low: (dim,) its smallest coordinates, m.
        high: (dim,) its largest ones.

    >>> suspected_unit((0.0, 0.0), (60.0, 40.0))
    ''
    >>> suspected_unit((0.0, 0.0), (60e3, 40e3))[:62]
    'the mesh is 60000 m by 40000 m large, if its coordinates are m'
    """
    sizes = [b - a for a, b in zip(low, high, strict=True)]
    if max(sizes) < LARGEST:
        return ""
    size = " by ".join(f"{side:.6g} m" for side in sizes)
    return (
        f"the mesh is {size} large, if its coordinates are metres: if they are millimetres, scale "
        "it by 0.001 (gmsh: Mesh.ScalingFactor = 0.001)"
    )


LARGEST = 5000.0
"""Metres from which on a mesh is suspected to be in millimetres."""


def inner_points(mesh: Mesh, volumes: Floats) -> tuple[tuple[float, ...], ...]:
    """Two points well inside the mesh, as examples: centres of elements of no small size.

    Args:
        mesh: the mesh.
        volumes: (n_elements,) of its elements.
    """
    centres = np.concatenate([mesh.points[block.nodes].mean(axis=1) for block in mesh.blocks])
    large = np.flatnonzero(volumes >= np.median(volumes))
    low, high = centres.min(axis=0), centres.max(axis=0)
    middle, up = 0.5 * (low + high), 0.25 * (high - low)
    up[:-1] = 0.0
    places = 4 - math.floor(math.log10(float((high - low).max()) or 1.0))
    inner = []
    for place in (middle, middle + up):
        near = large[np.argmin(np.linalg.norm(centres[large] - place, axis=1))]
        inner.append(tuple(round(float(x), places) for x in centres[near]))
    return tuple(inner)


def summarize_mesh(mesh: Mesh, kinematics: Kinematics) -> MeshSummary:
    """Numbers, sizes and groups of a mesh."""
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
        inside=inner_points(mesh, volumes),
        suspicion=suspected_unit(_corner(mesh, used, np.min), _corner(mesh, used, np.max)),
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
            _both_sides(mesh, nodes_of(members)),
        )
        for name, members in groups.items()
        if len(members)
    )


def _both_sides(mesh: Mesh, nodes: Ints) -> int | None:
    """The axis along which nodes stand at both ends of the mesh and nowhere between."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    near = _AT_END * (high - low).max()
    points = mesh.points[nodes]
    at_low, at_high = np.abs(points - low) <= near, np.abs(points - high) <= near
    both = (at_low | at_high).all(axis=0) & at_low.any(axis=0) & at_high.any(axis=0)
    return int(np.argmax(both)) if both.any() else None


_AT_END = 1e-6
"""Distance of nodes from the end of the mesh, in parts of its size, that is rounding."""


def _corner(mesh: Mesh, nodes: Ints, pick: Callable[..., Floats]) -> tuple[float, ...]:
    return tuple(float(x) for x in pick(mesh.points[nodes], axis=0))

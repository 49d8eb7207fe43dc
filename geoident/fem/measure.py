"""Sizes of a mesh: volumes of its elements, extents and contents of its groups."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from geoident.fem.compatibility import block_geometry
from geoident.fem.kinematics import Kinematics
from geoident.model.arrays import Floats, Ints
from geoident.model.mesh import ElementBlock, Mesh
from geoident.model.summary import MeshSummary, PartSummary


def element_volumes(mesh: Mesh, kinematics: Kinematics) -> Floats:
    """(n_elements,) volumes, m3, of a unit thickness in plane strain."""
    geometries = [block_geometry(mesh.points, block, kinematics) for block in mesh.blocks]
    return np.concatenate([np.abs(g.volumes.sum(axis=1)) for g in geometries])


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
        groups=_parts(mesh, mesh.groups, _nodes_of(mesh.blocks), volumes),
        facet_groups=_parts(mesh, mesh.facet_groups, _nodes_of(mesh.facets)),
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


def _nodes_of(blocks: tuple[ElementBlock, ...]) -> Callable[[Ints], Ints]:
    """A function from indices that count through some blocks to the nodes there."""

    def nodes_of(members: Ints) -> Ints:
        found, first = [np.empty(0, np.int64)], 0
        for block in blocks:
            mine = members[(members >= first) & (members < first + len(block))] - first
            found.append(block.nodes[mine].ravel())
            first += len(block)
        return np.concatenate(found)

    return nodes_of

"""Round tunnels whose wall is a group of lines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geoident.fem.faces import face_table, patches
from geoident.model.mesh import ElementBlock, Mesh

from .meshes import opening


def walled(kind: str, **shape: float) -> Mesh:
    """`opening` in the plane with the group of lines ``wall`` between core and rock."""
    mesh = opening(kind, 2, **shape)
    table = face_table(mesh)
    core = np.zeros(mesh.n_elements, dtype=bool)
    core[mesh.groups["core"]] = True
    found = patches(mesh, table, table.free(core))
    on_wall = [
        p.nodes[
            np.all(
                np.abs(np.linalg.norm(mesh.points[p.nodes[:, :2]], axis=2) - shape["radius"])
                < 1e-9,
                axis=1,
            )
        ]
        for p in found
    ]
    return with_lines(mesh, "wall", np.concatenate(on_wall))


def with_lines(mesh: Mesh, name: str, nodes: np.ndarray) -> Mesh:
    """The mesh with one more group of lines (n, 2 or 3 nodes)."""
    first = sum(len(block) for block in mesh.facets)
    block = ElementBlock(f"line{nodes.shape[1]}", nodes, np.arange(1, len(nodes) + 1))
    groups = {**mesh.facet_groups, name: np.arange(first, first + len(nodes))}
    return replace(mesh, facets=(*mesh.facets, block), facet_groups=groups)

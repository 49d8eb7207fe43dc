"""Slices of round tunnels whose wall is a group of faces, for shells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geoident.fem.faces import face_table, patches
from geoident.model.cells import CELLS
from geoident.model.mesh import ElementBlock, Mesh

from .meshes import build, cut_by_centres, opening, split_cells


def tunnel_slice(
    kind: str, *, n: int, layers: int, radius: float, reach: float, width: float, rows: int = 1
) -> Mesh:
    """A quarter of a tunnel along z, of width z, with the group of faces ``wall``.

    Args:
        kind: hex8, hex20, tet4 or tet10; nodes on edges lie on circles.
        n: cells along the side of the core; its wall has 2 n faces around.
        layers: rings of elements outside of it.
        radius: of the wall.
        reach: of the ground.
        width: along the tunnel.
        rows: of elements along it.
    """
    flat = opening("quad4", 2, n=n, layers=layers, radius=radius, reach=reach)
    m, nodes = flat.n_nodes, flat.blocks[0].nodes
    levels = np.linspace(0.0, width, rows + 1)
    points = np.concatenate([np.column_stack([flat.points, np.full(m, z)]) for z in levels])
    cells = np.concatenate([np.hstack([nodes + k * m, nodes + (k + 1) * m]) for k in range(rows)])
    linear = {"tet10": "tet4", "hex20": "hex8"}.get(kind, kind)
    if linear == "tet4":
        faces = np.sort(cells[:, CELLS["hex8"].faces], axis=2).reshape(-1, 4)
        faces = np.unique(faces, axis=0)  # whose centres follow the points
        first = len(points)
        points, cells = cut_by_centres(points, cells)
        _put_on_circles(points, first + np.arange(len(faces)), faces, radius)
    mesh = build(kind, points, split_cells(cells, linear))
    (block,), x = mesh.blocks, mesh.points.copy()
    for k, ends in enumerate(CELLS[kind].edges):
        middles = block.nodes[:, CELLS[kind].n_corners + k]
        _put_on_circles(x, middles, block.nodes[:, list(ends)], radius)
    corners = x[block.nodes[:, : CELLS[kind].n_corners], :2]
    core = np.linalg.norm(corners, axis=2).max(axis=1) < radius * (1 + 1e-9)
    groups = {"core": np.flatnonzero(core), "rock": np.flatnonzero(~core)}
    mesh = replace(mesh, points=x, groups=groups)
    skin = patches(mesh, table := face_table(mesh), table.free(core))
    on = [
        patch.nodes[np.all(np.abs(np.linalg.norm(x[patch.nodes, :2], axis=2) - radius) < 1e-9, 1)]
        for patch in skin
    ]
    return with_faces(mesh, "wall", np.concatenate(on))


def _put_on_circles(
    points: np.ndarray, middles: np.ndarray, ends: np.ndarray, radius: float
) -> None:
    """Move nodes in the middle of others that lie on a circle, the wall or beyond, onto it."""
    r = np.linalg.norm(points[ends, :2], axis=2)
    on = (np.ptp(r, axis=1) < 1e-9) & (r[:, 0] > radius * (1 - 1e-9))
    own = middles[on]
    points[own, :2] *= (r[on, 0] / np.linalg.norm(points[own, :2], axis=1))[:, None]


def with_faces(mesh: Mesh, name: str, nodes: np.ndarray) -> Mesh:
    """The mesh with one more group of faces (n, 3, 4, 6 or 8 nodes)."""
    first = sum(len(block) for block in mesh.facets)
    count = nodes.shape[1]
    kind = f"{'tri' if count in (3, 6) else 'quad'}{count}"
    block = ElementBlock(kind, nodes, np.arange(1, len(nodes) + 1))
    groups = {**mesh.facet_groups, name: np.arange(first, first + len(nodes))}
    return replace(mesh, facets=(*mesh.facets, block), facet_groups=groups)

"""Round tunnels whose wall is a group of lines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geoident.fem.faces import face_table, patches
from geoident.model.mesh import ElementBlock, Mesh

from .meshes import opening


def walled(kind: str, **shape: float) -> Mesh:
    """`opening` in the plane with the group of lines ``wall`` between core and rock."""
    return with_wall(opening(kind, 2, **shape), shape["radius"])


def with_wall(mesh: Mesh, radius: float) -> Mesh:
    """A mesh of `opening`, of one kind, with the group of faces ``wall`` between core and rock."""
    table = face_table(mesh)
    core = np.zeros(mesh.n_elements, dtype=bool)
    core[mesh.groups["core"]] = True
    (patch,) = patches(mesh, table, table.free(core))
    r = np.linalg.norm(mesh.points[patch.nodes], axis=2)
    nodes = patch.nodes[np.all(np.abs(r - radius) < 1e-6 * radius, axis=1)]
    first = sum(len(block) for block in mesh.facets)
    block = ElementBlock(patch.kind, nodes, np.arange(1, 1 + len(nodes)))
    groups = {**mesh.facet_groups, "wall": np.arange(first, first + len(nodes))}
    return replace(mesh, facets=(*mesh.facets, block), facet_groups=groups)


def with_lines(mesh: Mesh, name: str, nodes: np.ndarray) -> Mesh:
    """The mesh with one more group of lines (n, 2 or 3 nodes)."""
    first = sum(len(block) for block in mesh.facets)
    block = ElementBlock(f"line{nodes.shape[1]}", nodes, np.arange(1, len(nodes) + 1))
    groups = {**mesh.facet_groups, name: np.arange(first, first + len(nodes))}
    return replace(mesh, facets=(*mesh.facets, block), facet_groups=groups)


def ringed(*, n: int, radius: float, thickness: float, reach: float) -> Mesh:
    """A quarter of a tunnel (quad8) whose group ``ring`` is the outermost part of what is dug.

    The group of lines ``wall`` is at the outside of the ring, at the radius of the tunnel.
    """
    layers = int(np.ceil(np.log(reach / radius) / np.log(1 + np.pi / 4 / n))) + 1
    mesh = opening("quad8", 2, n=n, layers=layers, radius=1.0, reach=reach / radius)
    r = np.linalg.norm(mesh.points, axis=1)
    centre = np.linalg.norm(mesh.points[mesh.blocks[0].nodes].mean(axis=1), axis=1)
    first = np.geomspace(1.0, reach / radius, layers + 1)[1]
    inner = radius - thickness
    in_ring = inner + (r - 1.0) / (first - 1.0) * thickness
    beyond = radius + (r - first) / (reach / radius - first) * (reach - radius)
    moved = np.where(r <= 1.0 + 1e-9, r * inner, np.where(r <= first + 1e-9, in_ring, beyond))
    points = mesh.points * (moved / np.maximum(r, 1e-12))[:, None]
    groups = {
        "core": np.flatnonzero(centre < 0.99),
        "ring": np.flatnonzero((centre > 0.99) & (centre < first * 0.999)),
        "rock": np.flatnonzero(centre >= first * 0.999),
    }
    mesh = Mesh(points, mesh.blocks, mesh.facets, groups, mesh.facet_groups, {})
    table = face_table(mesh)
    rock = np.zeros(mesh.n_elements, dtype=bool)
    rock[groups["rock"]] = True
    faces = np.concatenate([p.nodes for p in patches(mesh, table, table.free(rock))])
    at = np.linalg.norm(points[faces], axis=2)
    return with_lines(mesh, "wall", faces[np.all(np.abs(at - radius) < 1e-6 * radius, axis=1)])

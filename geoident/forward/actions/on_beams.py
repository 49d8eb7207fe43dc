"""What is on a beam or shell that has nodes of its own between interfaces: points and faces."""

from __future__ import annotations

import itertools

import numpy as np

from geoident.fem.location import Site
from geoident.fem.shells import flat_triangles, nearest_triangle
from geoident.fem.structures import straight_pieces
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Floats, Ints
from geoident.model.mesh import Mesh
from geoident.model.structures import Beam, Shell

_ON_BEAM = 0.01
"""Distance from a piece of a beam, in parts of its length, up to which a point is on it."""

_ON_SHELL = 0.05
"""The same of a triangle of a shell, by its longest side: a curved one is a little off its own."""


def site_on_beam(
    on_mesh: CaseOnMesh, point: tuple[float, ...], standing: frozenset[str]
) -> Site | None:
    """The place of a point on a beam or shell that has nodes of its own between interfaces.

    Args:
        on_mesh: the case on its mesh.
        point: (dim,) m.
        standing: names of structures; others do not count.

    Returns:
        The place, of no element; None where none is near.
    """
    mesh = on_mesh.mesh
    if not len(mesh.inner):
        return None
    for name in sorted(standing):
        beam = on_mesh.case.structures[name]
        if isinstance(beam, Shell) and (site := _on_shell(mesh, beam, np.array(point))):
            return site
        if not isinstance(beam, Beam):
            continue
        pieces = straight_pieces(mesh, beam.group)
        pieces = pieces[np.isin(pieces, mesh.inner[:, 1]).any(axis=1)]
        first, along = mesh.points[pieces[:, 0]], np.diff(mesh.points[pieces], axis=1)[:, 0]
        square = (along**2).sum(axis=1)
        part = np.clip(((np.array(point) - first) * along).sum(axis=1) / square, 0.0, 1.0)
        apart = np.linalg.norm(first + part[:, None] * along - point, axis=1) / np.sqrt(square)
        n = int(np.argmin(apart))
        if apart[n] <= _ON_BEAM:
            shapes, slopes = np.array([1.0 - part[n], part[n]]), np.array([-1.0, 1.0])
            return Site(-1, pieces[n], shapes, np.outer(slopes, along[n] / square[n]), 0.0)
    return None


def _on_shell(mesh: Mesh, shell: Shell, point: Floats) -> Site | None:
    """The place of a point (3,) on a shell; the same for these."""
    faces = mesh.facet_groups[shell.group]
    nodes = flat_triangles(mesh, faces, np.zeros(len(faces), dtype=np.bool_)).nodes
    nodes = nodes[np.isin(nodes, mesh.inner[:, 1]).any(axis=1)]
    if not len(nodes):
        return None
    best, shapes = nearest_triangle(mesh.points[nodes], point)
    corners = mesh.points[nodes[best]]
    sides = corners[1:] - corners[0]
    if np.linalg.norm(shapes @ corners - point) > _ON_SHELL * np.linalg.norm(sides, axis=1).max():
        return None
    slopes = np.linalg.pinv(sides).T
    return Site(-1, nodes[best], shapes, np.vstack([-slopes.sum(axis=0), slopes]), 0.0)


def onto_beams(on_mesh: CaseOnMesh, nodes: Ints, standing: frozenset[str]) -> Ints:
    """Nodes (n, n_a) of free faces, on what stands there between interfaces.

    Args:
        on_mesh: the case on its mesh.
        nodes: of faces of the ground.
        standing: names of structures.
    """
    structures = on_mesh.case.structures.items()
    groups = {
        one.group for name, one in structures if name in standing and isinstance(one, Beam | Shell)
    }
    beside: dict[frozenset[int], dict[int, int]] = {}
    for part in itertools.chain(*on_mesh.joints.values()):
        if groups.intersection(part.beams):
            pairs = zip(*(nodes.tolist() for nodes in part.ends), strict=True)
            for own, inner in (pair[:: -1 if part.side else 1] for pair in pairs):
                beside[frozenset(own)] = dict(zip(own, inner, strict=True))
    rows = nodes.tolist()
    return np.array([[beside.get(frozenset(own), {}).get(n, n) for n in own] for own in rows])

"""What is on a beam that has nodes of its own between interfaces: points and faces."""

from __future__ import annotations

import itertools

import numpy as np

from geoident.fem.location import Site
from geoident.fem.structures import straight_pieces
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Ints
from geoident.model.structures import Beam

_ON_BEAM = 0.01
"""Distance from a piece of a beam, in parts of its length, up to which a point is on it."""


def site_on_beam(
    on_mesh: CaseOnMesh, point: tuple[float, ...], standing: frozenset[str]
) -> Site | None:
    """The place of a point on a beam that has nodes of its own between interfaces.

    Args:
        on_mesh: the case on its mesh.
        point: (dim,) m.
        standing: names of structures; others do not count.

    Returns:
        The place, of no element; None where no such beam is within 1 % of the length of a piece.
    """
    mesh = on_mesh.mesh
    if not len(mesh.inner):
        return None
    for name in sorted(standing):
        beam = on_mesh.case.structures[name]
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


def onto_beams(on_mesh: CaseOnMesh, nodes: Ints, standing: frozenset[str]) -> Ints:
    """Nodes (n, n_a) of free faces, on the beams that stand there between interfaces.

    Args:
        on_mesh: the case on its mesh.
        nodes: of faces of the ground.
        standing: names of structures.
    """
    structures = on_mesh.case.structures.items()
    groups = {one.group for name, one in structures if name in standing and isinstance(one, Beam)}
    beside: dict[frozenset[int], dict[int, int]] = {}
    for part in itertools.chain(*on_mesh.joints.values()):
        if groups.intersection(part.beams):
            outer = part.second if part.side else part.first
            for own, inner in zip(outer.tolist(), part.inner.tolist(), strict=True):
                beside[frozenset(own)] = dict(zip(own, inner, strict=True))
    rows = nodes.tolist()
    return np.array([[beside.get(frozenset(own), {}).get(n, n) for n in own] for own in rows])

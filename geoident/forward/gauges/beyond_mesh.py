"""Points of gauges beside the mesh: how far they may lie from it.

Straight edges of elements cut off a curved wall, so that a point on the wall lies beside the mesh
by the height of the arc: about a face's length times an eighth of the angle by which faces turn
there. A point farther off stands in the air; its coordinates are wrong, or the ground ends lower.
"""

from __future__ import annotations

import numpy as np

from geoident.errors import Fault
from geoident.fem.faces import FacetPatch, distance_to_faces
from geoident.fem.location import Site, format_point
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Floats
from geoident.model.cells import CELLS
from geoident.model.gauges import Channel
from geoident.model.mesh import Mesh

ALLOWED = 0.01
"""Distance from the mesh, in parts of the length of the face there, up to which a point is on it.

Coordinates of gauges are written with few digits.
"""

_BESIDE = 1e-6
"""How far outside an element a point is said to be beside it, in parts of its size."""

_ARC = 1.5 / 8.0  # of face length and angle: the height of an arc with half as much to spare
_CORNER = np.radians(60.0)  # faces that turn by more make a corner, not a curve


def is_beside(site: Site) -> bool:
    """Whether a point lies just outside the element that takes it."""
    return site.outside > _BESIDE


def beside_fault(
    on_mesh: CaseOnMesh, channel: Channel, point: tuple[float, ...], sites: tuple[Site, ...]
) -> Fault | None:
    """Why a point that no element holds is no point of the ground; None where one does.

    Args:
        on_mesh: the case on its mesh.
        channel: of the gauge.
        point: (dim,) m.
        sites: elements that take the point, the best first.
    """
    if not sites or any(not is_beside(site) for site in sites):
        return None
    mesh = on_mesh.mesh
    place = np.asarray(on_mesh.kinematics.in_section(point)[0])
    away = distance_to_faces(mesh, on_mesh.outline, place)
    if away <= allowed_distance(mesh, on_mesh.outline, place):
        return None
    corners = np.unique(np.concatenate([p.nodes.ravel() for p in on_mesh.outline]))
    nearest = mesh.points[corners[_nearest(mesh.points[corners], place)]]
    return on_mesh.case.source.fault(
        channel.key,
        "gauge-outside",
        f"point {format_point(point)} of gauge '{channel.name}' lies {away:.2g} m outside "
        "the mesh, in the air",
        f"correct it, or take a point of the ground: the nearest node is {format_point(nearest)}",
    )


def allowed_distance(mesh: Mesh, outline: tuple[FacetPatch, ...], place: Floats) -> float:
    """How far a point may lie from the faces of a mesh to be taken as one of them, m.

    Args:
        mesh: the mesh.
        outline: its outer faces.
        place: (dim,) m.
    """
    corners = [p.nodes[:, : CELLS[p.kind].n_corners] for p in outline]
    middles = [mesh.points[nodes].mean(axis=1) for nodes in corners]
    number = _nearest(np.concatenate(middles), place)
    face = [row for nodes in corners for row in nodes][number]
    normal = _normal(mesh.points[face])
    size = float(np.linalg.norm(np.ptp(mesh.points[face], axis=0)))
    turns = [0.0]
    for nodes in corners:
        for other in nodes[np.isin(nodes, face).sum(axis=1) == mesh.dim - 1]:
            cosine = abs(float(normal @ _normal(mesh.points[other])))
            angle = float(np.arccos(min(1.0, cosine)))
            turns.append(angle if angle < _CORNER else 0.0)
    return size * (ALLOWED + _ARC * max(turns))


def _nearest(points: Floats, place: Floats) -> int:
    """Which of some points (n, dim) is the nearest to a place (dim,)."""
    from scipy.spatial import cKDTree  # noqa: PLC0415 - 0.2 s, for points beside the mesh alone

    return int(cKDTree(points).query(place)[1])


def _normal(corners: Floats) -> Floats:
    """Unit normal of a face by its corners (k, dim)."""
    if corners.shape[1] == 2:
        along = corners[1] - corners[0]
        normal = np.array([along[1], -along[0]])
    else:
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    return np.asarray(normal / np.linalg.norm(normal))

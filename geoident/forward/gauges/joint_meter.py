"""Motion of the two sides of an interface against each other: joint meters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import scipy.sparse as sp

from geoident.errors import Fault
from geoident.fem.elements import reference_element
from geoident.fem.interfaces import JointFaces
from geoident.fem.location import format_point
from geoident.forward.gauges.motion import RelativeDisplacements
from geoident.forward.gauges.placement import Placed, unbroken
from geoident.forward.stages import CaseOnMesh
from geoident.forward.structures.interfaces import beams_on
from geoident.model.arrays import Bools, Floats
from geoident.model.cells import CELLS
from geoident.model.gauges import Channel

_SAMPLES = 9
"""Points along each edge of a face from which the nearest one is sought."""

_REFINED = 6
"""Steps that bring it to the foot of the perpendicular; two are usual."""

_WITHIN = 1e-6
"""Distance from the plane of a face, in parts of its size, at which a point is on neither side."""

_OFF = 0.1
"""Distance from the interface, in parts of the size of a face, that is no longer on it."""


@dataclass(frozen=True)
class PlaceOnInterface:
    """The point of an interface nearest to another point.

    Args:
        point: (dim,) m.
        distance: between the two, m.
        size: of the face, m.
        shapes: (n_a,) shape functions of the face there.
        faces: the face alone.
        normal: (dim,) from the first side to the second.
    """

    point: Floats
    distance: float
    size: float
    shapes: Floats
    faces: JointFaces
    normal: Floats


def nearest_place(points: Floats, parts: Sequence[JointFaces], target: Floats) -> PlaceOnInterface:
    """The nearest place on the faces of an interface.

    Args:
        points: (n_nodes, dim) of the mesh, m.
        parts: the faces.
        target: (dim,) m.
    """
    best: PlaceOnInterface | None = None
    for part in parts:
        reference = reference_element(part.kind)
        xi = _samples(part.kind)
        at = np.einsum("qa,nai->nqi", reference.shapes(xi), points[part.first])
        apart = np.linalg.norm(at - target, axis=2)
        face, sample = np.unravel_index(int(apart.argmin()), apart.shape)
        corners = points[part.first[face]]
        local = xi[sample]
        for _ in range(_REFINED):  # Gauss-Newton for the foot of the perpendicular
            along = corners.T @ reference.gradients(local)
            away = target - reference.shapes(local) @ corners
            local = _inside(part.kind, local + np.linalg.lstsq(along, away, rcond=None)[0])
        shapes = reference.shapes(local)
        along = corners.T @ reference.gradients(local)
        normal = np.cross(*along.T) if len(target) == 3 else along[::-1, 0] * [1.0, -1.0]
        foot = shapes @ corners
        place = PlaceOnInterface(
            foot,
            float(np.linalg.norm(foot - target)),
            float(np.ptp(corners, axis=0).max()),
            shapes,
            part.of(np.arange(len(part.first)) == face),
            normal / np.linalg.norm(normal),
        )
        best = place if best is None or place.distance < best.distance else best
    assert best is not None
    return best


def _samples(kind: str) -> Floats:
    """Reference points (q, dim) over a face."""
    cell = CELLS[kind]
    low = 0.0 if cell.shape.name == "tri" else -1.0
    points = np.array(list(product(np.linspace(low, 1.0, _SAMPLES), repeat=cell.dim)))
    return points[points.sum(axis=1) <= 1.0 + 1e-12] if low == 0.0 else points


def _inside(kind: str, xi: Floats) -> Floats:
    """A reference point (dim,) brought into a face."""
    if CELLS[kind].shape.name != "tri":
        return np.clip(xi, -1.0, 1.0)
    xi = np.maximum(xi, 0.0)
    return xi / max(float(xi.sum()), 1.0)


def joint_meters(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> Placed:
    """Channels that read across an interface, while it stands since their zero."""
    mesh, sequence = on_mesh.mesh, on_mesh.sequence
    rows = sp.lil_array((len(channels), mesh.points.size))
    readable = np.zeros((len(channels), len(sequence.states)), dtype=bool)
    faults: list[Fault] = []
    for row, channel in enumerate(channels):
        given = on_mesh.case.interfaces.get(channel.interface)
        parts = () if given is None else on_mesh.joints.get(given.along, ())
        if not parts:
            continue  # the interface is a fault of its own
        target = np.array(on_mesh.kinematics.in_section(channel.second)[0])
        place = nearest_place(mesh.points, parts, target)
        if place.faces.inner is not None:
            if channel.towards is None:
                faults.append(_beside_beam(on_mesh, channel))
                continue
            place = replace(
                place, faces=replace(place.faces, side=int(_beyond(channel, place) > 0))
            )
        if place.distance > _OFF * place.size:
            faults.append(_off(on_mesh, channel, place))
            continue
        if channel.towards is not None and abs(_beyond(channel, place)) < _WITHIN * place.size:
            faults.append(_on_no_side(on_mesh, channel))
            continue
        way = _direction(channel, place)
        for sign, (nodes,) in zip((-1.0, 1.0), place.faces.ends, strict=True):
            for axis, part in enumerate(way):
                rows[row, nodes * mesh.dim + axis] = sign * part * place.shapes
        stands = _stands(on_mesh, place)
        readable[row] = unbroken(sequence, on_mesh.case.zero_of(channel), stands)
        if not readable[row].any():
            faults.append(_never(on_mesh, channel, stands))
    observable = RelativeDisplacements(sp.csr_array(rows))
    why = "a side that the interface joins is not there then"
    return Placed(observable, readable, faults=tuple(faults), unreadable=why)


def _direction(channel: Channel, place: PlaceOnInterface) -> Floats:
    """(dim,) along which the second side moves against the first where the reading is positive."""
    normal = place.normal
    if channel.quantity == "opening":
        return normal
    if channel.quantity == "slip":
        return np.array([-normal[1], normal[0]])
    return np.array(channel.direction) * (1.0 if _beyond(channel, place) > 0.0 else -1.0)


def _beyond(channel: Channel, place: PlaceOnInterface) -> float:
    """How far the point of a channel that names a side is on the second one, m."""
    assert channel.towards is not None
    return float(place.normal @ (np.array(channel.towards) - place.point))


def _stands(on_mesh: CaseOnMesh, place: PlaceOnInterface) -> Bools:
    """(n_states,) when both sides are there: ground, or ground and a beam."""
    faces, states = place.faces, on_mesh.sequence.states
    groups = on_mesh.sequence.group_of[faces.elements[0, list(faces.touches)]]
    beams = beams_on(on_mesh.case, faces)
    return np.array(
        [
            all(int(g) in s.materials for g in groups)
            and (not beams or not beams.isdisjoint(s.structures))
            for s in states
        ]
    )


def _beside_beam(on_mesh: CaseOnMesh, channel: Channel) -> Fault:
    return on_mesh.case.source.fault(
        (*channel.key, "interface"),
        "beside-beam",
        f"gauge '{channel.name}' reads across the interface '{channel.interface}', which a "
        "beam or shell divides: across which of its two sides is not said",
        "Write 'towards: [...]', a point of the ground on the side that is meant.",
    )


def _on_no_side(on_mesh: CaseOnMesh, channel: Channel) -> Fault:
    assert channel.towards is not None
    return on_mesh.case.source.fault(
        (*channel.key, "towards"),
        "on-no-side",
        f"gauge '{channel.name}' reads on the side of {format_point(np.array(channel.towards))} "
        f"of the interface '{channel.interface}', and that point lies in its plane: which side is "
        "meant is not said",
        "Write a point of the ground on the side that is meant, off the interface.",
    )


def _off(on_mesh: CaseOnMesh, channel: Channel, place: PlaceOnInterface) -> Fault:
    return on_mesh.case.source.fault(
        (*channel.key, "point"),
        "off-interface",
        f"gauge '{channel.name}' lies {place.distance:.4g} m off the interface "
        f"'{channel.interface}', at {format_point(np.array(channel.second))}",
        f"the nearest point of it is {format_point(place.point)}",
    )


def _never(on_mesh: CaseOnMesh, channel: Channel, stands: Bools) -> Fault:
    """The interface does not stand at the zero of a gauge."""
    names = [s.name for s, there in zip(on_mesh.sequence.states, stands, strict=True) if there]
    return on_mesh.case.source.fault(
        (*channel.key, "zero"),
        "zero-before-interface",
        f"gauge '{channel.name}' reads zero at stage '{channel.zero}', at which a side "
        f"that the interface '{channel.interface}' joins is not there",
        f"zero it at one of: {', '.join(names)}",
    )

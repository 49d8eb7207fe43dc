"""The advancing face of a case on its mesh: which ground is at the wall, and what is wrong."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.errors import Fault, ModelError
from geoident.forward.in_situ.stress import InSituStress, StressPlaces
from geoident.forward.openings.advance import INSTEAD, AdvancingFace, OpeningAt
from geoident.forward.openings.closed_forms import Opening
from geoident.forward.openings.field import unsuitable
from geoident.forward.openings.load import opening_in
from geoident.forward.stages import CaseOnMesh
from geoident.model.actions import FaceDistance, FaceProfile
from geoident.model.case import Material
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.mesh import nodes_in
from geoident.model.parameter import Values

UNIT = 1.0
"""Radius of the opening whose reaction is asked, m: its motion by its radius has no size."""


def advancing_face(on_mesh: CaseOnMesh) -> AdvancingFace:
    """What turns distances to the face into released parts, of a case without `face_faults`."""
    profile = on_mesh.case.face
    if profile is None or _why_not(on_mesh, profile) is not None:
        return AdvancingFace(profile, None)
    return AdvancingFace(profile, _opening_at(on_mesh, profile))


def face_at(on_mesh: CaseOnMesh, centre: tuple[float, float], ground: int) -> AdvancingFace:
    """The same around the opening of a closed form.

    Args:
        on_mesh: the case, on its mesh or on an empty one.
        centre: of the opening, m.
        ground: index of the group around it.
    """
    profile = on_mesh.case.face
    material = on_mesh.case.materials[on_mesh.sequence.states[0].materials[ground]]
    if profile is None or not (material.yields and _asks(profile)):
        return AdvancingFace(profile, None)
    return AdvancingFace(profile, _around(on_mesh, material, centre, ground))


def face_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Ground at the wall that yields, and has no reaction curve in closed form."""
    case, profile = on_mesh.case, on_mesh.case.face
    if profile is None:
        return []
    why = _why_not(on_mesh, profile)
    if not why:
        return []
    what = (
        "how distances to the face become released stress"
        if profile.conversion != "direct"
        else "the plastic radius, on which the profile depends,"
    )
    message = f"{what} cannot be computed by a closed form: {why}"
    hint = INSTEAD[0].upper() + INSTEAD[1:] + "."
    if profile.conversion == "direct":
        hint = "Give 'plastic_radius', of the tunnel without support, far from its face."
    return [case.source.fault(("face",), code="no-closed-form", message=message, hint=hint)]


@dataclass(frozen=True)
class FaceState:
    """What the distance to the face says of a stage.

    Args:
        stage: its name.
        distance: of the section behind the face, m.
        share: part of its final motion that the wall has made.
        released: part of the stress that is released.
    """

    stage: str
    distance: float
    share: float
    released: float


def face_states(face: AdvancingFace, on_mesh: CaseOnMesh, values: Values) -> tuple[FaceState, ...]:
    """What distances to the face become at some parameters, for the stages that depend on one.

    Args:
        face: of the case.
        on_mesh: the case.
        values: parameters by name, SI.

    Raises:
        ModelError: the ground has no reaction curve that would tell.
    """
    point, found = ParameterPoint(values, ()), []
    for state in on_mesh.sequence.states[1:]:
        by_face = (r for r in state.release.values() if isinstance(r, FaceDistance))
        release = next(by_face, None)
        if release is not None:
            share = float(face.share(release.distance, point, state.name).value)
            part = float(face.part(release, point, state.name).value)
            found.append(FaceState(state.name, release.distance.value(values), share, part))
    return tuple(found)


def face_note(face: AdvancingFace, on_mesh: CaseOnMesh, values: Values) -> tuple[str, ...]:
    """The same as a sentence without a stop; none for a case without distances.

    Args:
        face: of the case.
        on_mesh: the case.
        values: parameters by name, SI.
    """
    if on_mesh.case.face is None:
        return ()
    try:
        states = face_states(face, on_mesh, values)
        ratio = float(face.plastic_ratio(ParameterPoint(values, ())).value)
    except ModelError as error:
        return (error.message,)
    said = [
        f"{s.stage}: {s.distance:.4g} m, {100.0 * s.share:.3g} % of the final motion, "
        f"{100.0 * s.released:.3g} % of the stress"
        for s in states
    ]
    law = _NAMES[on_mesh.case.face.law]
    if on_mesh.case.face.law == "vlachopoulos-diederichs":
        law += f", plastic radius {ratio:.3g} times that of the tunnel"
    return (f"released by the distance to the face ({law}): {'; '.join(said)}",)


def conversion_note(face: AdvancingFace, on_mesh: CaseOnMesh) -> tuple[str, ...]:
    """How distances to the face become released stress, a sentence without a stop; or none.

    Args:
        face: of the case.
        on_mesh: the case.
    """
    profile = on_mesh.case.face
    if profile is None:
        return ()
    text = f"distances to the face release stress by {_NAMES[profile.law]}; "
    if face.by_reaction:
        text += "the part of the final motion becomes a part of the stress on the reaction curve "
        return (text + "of a circular opening without support, in the mean in-situ stress",)
    return (text + "the part of the stress is that of the final motion (exact in elastic ground)",)


_NAMES = {
    "vlachopoulos-diederichs": "the profile of Vlachopoulos and Diederichs",
    "panet": "Panet's profile",
    "chern": "Chern's profile",
}


def _asks(profile: FaceProfile) -> bool:
    """Whether ground that yields has to tell its reaction."""
    radius = profile.law == "vlachopoulos-diederichs" and profile.plastic_radius is None
    return radius or profile.conversion != "direct"


def _why_not(on_mesh: CaseOnMesh, profile: FaceProfile) -> str | None:
    """Why there is no reaction curve, a clause; empty where none is needed; None if there is."""
    materials = _at_wall(on_mesh, profile)
    case = on_mesh.case
    if not (_asks(profile) and any(case.materials[name].yields for name in materials)):
        return ""
    if len(materials) > 1:
        names = ", ".join(f"'{name}'" for name in sorted(materials))
        return f"the ground at the wall is of several materials, {names}"
    (name,) = materials
    return unsuitable(case, name, has_mesh=True)


def _inside(on_mesh: CaseOnMesh, profile: FaceProfile) -> list[int]:
    return [on_mesh.sequence.groups.index(name) for name in profile.groups]


def _at_wall(on_mesh: CaseOnMesh, profile: FaceProfile) -> dict[str, int]:
    """Materials of the virgin ground that touch the tunnel, each with a group of it."""
    mesh, sequence = on_mesh.mesh, on_mesh.sequence
    inside = np.isin(sequence.group_of, _inside(on_mesh, profile))
    wall = nodes_in(mesh.blocks, inside)
    touching = np.concatenate([np.isin(block.nodes, wall).any(axis=1) for block in mesh.blocks])
    around = np.unique(sequence.group_of[touching & sequence.present(0) & ~inside])
    virgin = sequence.states[0].materials
    return {virgin[int(group)]: int(group) for group in around}


def _opening_at(on_mesh: CaseOnMesh, profile: FaceProfile) -> OpeningAt:
    ((name, group),) = _at_wall(on_mesh, profile).items()
    return _around(on_mesh, on_mesh.case.materials[name], _centre(on_mesh, profile), group)


def _centre(on_mesh: CaseOnMesh, profile: FaceProfile) -> tuple[float, ...]:
    """Where the in-situ stress is taken: as given, or the centroid of the groups."""
    if profile.centre is not None:
        return profile.centre
    points = on_mesh.discretization.points
    mine = np.isin(on_mesh.sequence.group_of[points.element], _inside(on_mesh, profile))
    middle = np.average(points.position[mine], axis=0, weights=points.volume[mine])
    return tuple(map(float, middle))


def _around(
    on_mesh: CaseOnMesh, material: Material, centre: tuple[float, ...], group: int
) -> OpeningAt:
    place = StressPlaces(np.array([centre], dtype=np.float64), np.array([group]))
    in_situ = InSituStress(on_mesh, place)

    def opening(point: ParameterPoint) -> Opening:
        return opening_in(material, Dual(in_situ.columns(point)), UNIT, point)

    return opening

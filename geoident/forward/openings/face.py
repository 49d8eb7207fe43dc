"""The advancing face of a case on its mesh: which ground is at the wall, and what is wrong."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from geoident.errors import Fault, ModelError
from geoident.fem.solvers import Solver
from geoident.forward.in_situ.stress import InSituStress, StressPlaces
from geoident.forward.openings.advance import BY_MESH, AdvancingFace, OpeningAt
from geoident.forward.openings.at_point import opening_in
from geoident.forward.openings.closed_forms import Opening
from geoident.forward.openings.mesh_reaction import (
    MeshReaction,
    follow_each_other,
    tunnel_base,
    wall_of,
    yields_at_tunnel,
)
from geoident.forward.openings.obstacles import unsuitable
from geoident.forward.openings.site import ground_at_wall
from geoident.forward.stages import CaseOnMesh
from geoident.model.actions import FaceDistance, FaceProfile
from geoident.model.arrays import Bools, Floats
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.parameter import Scalar, Values
from geoident.model.results.opening import FaceAdvance

_BY_CIRCLE = (None, "reaction-curve")
"""Conversions by the reaction of a round opening; the first is what is not said."""

_ROUND = 0.02
"""Distance of a wall from a circle, and difference of in-situ stresses, of their size: not seen."""

_AHEAD, _BEHIND = 21, 81
"""Places of the profile that are kept ahead of the face and behind it."""

_NAMES = {
    "vlachopoulos-diederichs": "the profile of Vlachopoulos and Diederichs",
    "panet": "Panet's profile",
    "chern": "Chern's profile",
}


def advancing_face(on_mesh: CaseOnMesh, solver: Solver) -> AdvancingFace:
    """What turns distances to the face into released parts, of a case without `face_faults`.

    Args:
        on_mesh: the case.
        solver: factorizes where the opening itself is asked how it reacts.
    """
    profile = on_mesh.case.face
    if profile is None:
        return AdvancingFace()
    wall = opening = None
    if profile.conversion == "mesh" and yields_at_tunnel(on_mesh):
        wall = MeshReaction(on_mesh, AdvancingFace(), solver)
    around = ground_at_wall(on_mesh, _inside(on_mesh, profile))
    if _needs_curve(on_mesh, profile, around) and _curve_obstacle(on_mesh, around) is None:
        opening = _unit_opening(on_mesh, _centre(on_mesh, profile), *around.values())
    return AdvancingFace(profile, opening, wall)


def face_at(on_mesh: CaseOnMesh, centre: tuple[float, float], ground: int) -> AdvancingFace:
    """The same around the opening of a closed form.

    Args:
        on_mesh: the case, on its mesh or on an empty one.
        centre: of the opening, m.
        ground: index of the group around it.
    """
    profile, name = on_mesh.case.face, on_mesh.sequence.states[0].materials[ground]
    if profile is None or not _needs_curve(on_mesh, profile, [name]):
        return AdvancingFace(profile)
    return AdvancingFace(profile, _unit_opening(on_mesh, centre, ground))


def face_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Ground at the wall that yields, and has no reaction curve in closed form."""
    case, profile = on_mesh.case, on_mesh.case.face
    if profile is None:
        return []
    if profile.conversion == "mesh" and (faults := _mesh_faults(on_mesh, profile)):
        return faults
    around = ground_at_wall(on_mesh, _inside(on_mesh, profile))
    why = _curve_obstacle(on_mesh, around) if _needs_curve(on_mesh, profile, around) else None
    if why is None:
        return []
    what = "the plastic radius, on which the profile depends,"
    hint = "Give 'plastic_radius', of the tunnel without support, far from its face."
    if profile.conversion in _BY_CIRCLE:
        what = "how distances to the face become released stress"
        hint = BY_MESH[0].upper() + BY_MESH[1:] + "."
    message = f"{what} cannot be computed by a closed form: {why}"
    return [case.source.fault(("face",), "no-closed-form", message, hint)]


def _mesh_faults(on_mesh: CaseOnMesh, profile: FaceProfile) -> list[Fault]:
    """A tunnel whose own reaction cannot be asked for."""
    source, path = on_mesh.case.source, ("face", "conversion")
    if not follow_each_other(on_mesh):
        message = "stages with a distance to the face do not all build on each other, so that the "
        message += "mesh has no one reaction to the face"
        hint = "Let each of them build on the one before, or write 'conversion: reaction-curve'."
        return [source.fault(path, "branches", message, hint)]
    if not wall_of(on_mesh, profile.groups, tunnel_base(on_mesh)):
        names = ", ".join(f"'{name}'" for name in profile.groups)
        message = f"no ground is beside {names}, so there is no wall whose motion could be computed"
        hint = "Name the element groups of the tunnel by 'groups' of 'face'."
        return [source.fault(path, "no-wall", message, hint)]
    return []


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
    at, states = face.at(ParameterPoint(values, ())), []
    for state in on_mesh.sequence.states[1:]:
        by_face = (r for r in state.release.values() if isinstance(r, FaceDistance))
        if (release := next(by_face, None)) is not None:
            share = float(at.share(release.distance, state.name).value)
            part = float(at.part(release, state.name).value)
            states.append(FaceState(state.name, release.distance.value(values), share, part))
    return tuple(states)


def advance_of(face: AdvancingFace, on_mesh: CaseOnMesh, values: Values) -> FaceAdvance | None:
    """The profile at some parameters with the stages on it; None where it is not known.

    Args:
        face: of the case.
        on_mesh: the case.
        values: parameters by name, SI.
    """
    case, profile = on_mesh.case, on_mesh.case.face
    if profile is None:
        return None
    try:
        states = face_states(face, on_mesh, values)
        radius, at = profile.radius.value(values), face.at(ParameterPoint(values, ()))
        far = max((s.distance for s in states), default=0.0)
        near = min(0.0 if "panet" in profile.laws else -2.0 * radius, *(s.distance for s in states))
        ahead = np.linspace(near, 0.0, _AHEAD)[:-1] if near < 0.0 else np.empty(0)
        behind = far * np.linspace(0.0, 1.0, _BEHIND) ** 2  # closer where it bends
        way = np.concatenate([ahead, behind])
        share = [float(at.share(Scalar(float(x)), "").value) for x in way]
    except ModelError:
        return None
    zeros = {case.stage_names[case.zero_of(c)] for c in case.channels if c.is_zeroed}
    return FaceAdvance(
        law=" averaged with ".join(filter(None, (profile.law, ", ".join(profile.laws[1:])))),
        radius=radius,
        distance=way,
        share=np.array(share),
        stages=tuple(s.stage for s in states),
        stage_distance=np.array([s.distance for s in states]),
        stage_share=np.array([s.share for s in states]),
        stage_released=np.array([s.released for s in states]),
        stage_zero=np.array([s.stage in zeros for s in states], dtype=np.bool_),
    )


def face_note(face: AdvancingFace, on_mesh: CaseOnMesh, values: Values) -> tuple[str, ...]:
    """What the stages release, a sentence without a stop; none for a case without distances.

    Args:
        face: of the case.
        on_mesh: the case.
        values: parameters by name, SI.
    """
    if on_mesh.case.face is None:
        return ()
    try:
        states = face_states(face, on_mesh, values)
    except ModelError as error:
        return (error.message,)
    parts = [
        f"{s.stage}: {s.distance:.4g} m, {100.0 * s.share:.3g} % of the final motion, "
        f"{100.0 * s.released:.3g} % of the stress"
        for s in states
    ]
    law = _named(on_mesh.case.face, values)
    if "vlachopoulos-diederichs" in on_mesh.case.face.laws:
        ratio = float(face.at(ParameterPoint(values, ())).plastic_ratio.value)
        law += f", plastic radius {ratio:.3g} times that of the tunnel"
    return (f"released by the distance to the face ({law}): {'; '.join(parts)}",)


def conversion_note(face: AdvancingFace, on_mesh: CaseOnMesh) -> tuple[str, ...]:
    """How distances to the face become released stress, a sentence without a stop; or none.

    Args:
        face: of the case.
        on_mesh: the case.
    """
    profile = on_mesh.case.face
    if profile is None:
        return ()
    text = f"distances to the face release stress by {_named(profile, on_mesh.case.start)}; "
    if face.by_reaction:
        text += "the part of the final motion becomes a part of the stress on the reaction curve "
        text += "of a circular opening without support, in the mean in-situ stress"
        text += _unlike_circle(on_mesh, profile)
    elif face.wall is not None:
        text += "the part of the stress is that at which the mean motion of the tunnel's wall in "
        text += "the mesh, without support, is the part of its final motion"
    else:
        text += "the part of the stress is that of the final motion (exact in elastic ground)"
    if profile.averaged and not any(weight.parameter for _, weight in profile.averaged):
        return (text, _FIXED_WEIGHTS)
    return (text,)


_FIXED_WEIGHTS = (
    "the weights of the averaged profiles are numbers, so that intervals take the profile as "
    "known. To let them contain the choice, make each weight a parameter: '{start: 0.333, bounds: "
    "[-0.6, 1.6], prior: {mean: 0.333, sd: 0.47}}'"
)


def _named(profile: FaceProfile, values: Values) -> str:
    """The profile in words; of an average with the parts of all."""
    if not profile.averaged:
        return _NAMES[profile.law]
    weights = {one.law: weight.value(values) for one, weight in profile.averaged}
    weights = {profile.law: 1.0 - sum(weights.values()), **weights}
    *parts, last = (f"{_NAMES[law]} ({100.0 * weight:.0f} %)" for law, weight in weights.items())
    return f"an average of {', '.join(parts)} and {last}"


def _unlike_circle(on_mesh: CaseOnMesh, profile: FaceProfile) -> str:
    """In what a tunnel in a mesh differs from a circle in even stress, a clause; or nothing."""
    if not on_mesh.mesh.blocks:
        return ""
    differs = []
    wall = wall_of(on_mesh, profile.groups, tunnel_base(on_mesh))
    radii = _radii(on_mesh.mesh.points[np.unique(np.concatenate([p.nodes.ravel() for p in wall]))])
    if not np.ptp(radii) <= _ROUND * radii.mean():
        differs.append("is not round")
    (group,) = ground_at_wall(on_mesh, _inside(on_mesh, profile)).values()
    place = StressPlaces(np.array([_centre(on_mesh, profile)]), np.array([group]))
    point = ParameterPoint(on_mesh.case.start, ())
    xx, yy, _, xy = InSituStress(on_mesh, place).columns(point)[:, 0, 0]
    apart = float(np.hypot(0.5 * (xx - yy), xy))
    if 2.0 * apart > _ROUND * abs(0.5 * (xx + yy)):
        least, most = (1e-6 * abs(0.5 * (xx + yy) + sign * apart) for sign in (1.0, -1.0))
        differs.append(
            f"lies in uneven stress ({least:.3g} and {most:.3g} MPa at the start values)"
        )
    if not differs:
        return ""
    text = f". This tunnel {' and '.join(differs)}, so that the mean motion of its wall is another "
    return text + "part of the final one (theory 2.9): 'conversion: mesh' takes that of the mesh"


def _radii(wall: Floats) -> Floats:
    """Distances (k,) of places (k, 2) from the middle of the circle that is nearest to them."""
    away = wall - wall.mean(axis=0)
    rows = np.column_stack([2.0 * away, np.ones(len(away))])
    middle = np.linalg.lstsq(rows, (away**2).sum(axis=1), rcond=None)[0][:2]
    return np.asarray(np.linalg.norm(away - middle, axis=1))


def _needs_curve(on_mesh: CaseOnMesh, profile: FaceProfile, materials: Collection[str]) -> bool:
    """Whether ground at the wall yields, and the profile or its conversion asks how far.

    Args:
        on_mesh: the case.
        profile: of the face.
        materials: names of those at the wall.
    """
    radius = "vlachopoulos-diederichs" in profile.laws and profile.plastic_radius is None
    asks = radius or profile.conversion in _BY_CIRCLE
    return asks and any(on_mesh.case.materials[name].yields for name in materials)


def _curve_obstacle(on_mesh: CaseOnMesh, materials: Collection[str]) -> str | None:
    """Why ground at the wall has no reaction curve in closed form, a clause, or None if it has."""
    if len(materials) > 1:
        names = ", ".join(f"'{name}'" for name in sorted(materials))
        return f"the ground at the wall is of several materials, {names}"
    return unsuitable(on_mesh.case, *materials, has_mesh=True)


def _inside(on_mesh: CaseOnMesh, profile: FaceProfile) -> Bools:
    """(n_elements,) the elements that the tunnel fills."""
    groups = [on_mesh.sequence.groups.index(name) for name in profile.groups]
    return np.isin(on_mesh.sequence.group_of, groups)


def _centre(on_mesh: CaseOnMesh, profile: FaceProfile) -> tuple[float, ...]:
    """Where the in-situ stress is taken: as given, or the centroid of the groups."""
    if profile.centre is not None:
        return profile.centre
    points = on_mesh.discretization.points
    inside = _inside(on_mesh, profile)[points.element]
    middle = np.average(points.position[inside], axis=0, weights=points.volume[inside])
    return tuple(map(float, middle))


def _unit_opening(on_mesh: CaseOnMesh, centre: tuple[float, ...], group: int) -> OpeningAt:
    """The opening of radius 1 m in a group under the stress at a centre, by parameters."""
    material = on_mesh.case.materials[on_mesh.sequence.states[0].materials[group]]
    place = StressPlaces(np.array([centre], dtype=np.float64), np.array([group]))
    in_situ = InSituStress(on_mesh, place)

    def opening(point: ParameterPoint) -> Opening:
        return opening_in(material, Dual(in_situ.columns(point)), 1.0, point)

    return opening

"""Whether weight and in-situ stress agree: contradictions of a case in its initial state.

Three things are looked at, in this order; what follows from an earlier one is not told again.

*No gravity.* A vertical stress that grows with depth is the weight of ground; without gravity the
ground of the model has none.

*Unit weights.* The vertical stress grows with depth by the unit weight of the ground: density times
gravity, less the unit weight of the water where the pores are full of it, since in-situ stresses
are effective. More than `UNIT_WEIGHT` of it apart is a contradiction, group by group.

*Local balance.* At node a, with the forces q_ea of the stress in each element e there, and the
external forces f_ka of each kind k (weight, water, loads, held edges), the part out of balance is

    |sum_k f_ka - sum_e q_ea|  /  (sum_e |q_ea| + sum_k |f_ka|)

over the free directions; mid-nodes count half to the corners beside them. Both sides are forces of
the patch of elements around the node, so it is the local stress that counts: near a free surface,
where stresses vanish, the weight of the patch remains below the line. A weight that is wrong by the
part d is out of balance by d / 2 at most, so what the unit weights may differ is never told as out
of balance.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.errors import Fault
from geoident.fem.location import format_point
from geoident.forward.analysis.analysis import StagedAnalysis
from geoident.forward.in_situ.overburden import Overburden
from geoident.forward.in_situ.stress import CoverAndSurcharge, StressPlaces
from geoident.forward.in_situ.surfaces import Depths
from geoident.forward.in_situ.water import PorePressure, is_wet
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Analysis, Case, KeyPath
from geoident.model.cells import CELLS
from geoident.model.dual import ParameterPoint
from geoident.model.in_situ import GeostaticStress, HeimStress, InSitu, ProfileStress, Surface
from geoident.model.mesh import Mesh, spans
from geoident.model.parameter import Scalar, Values

UNIT_WEIGHT = 0.02
"""Difference of unit weights, in parts of the ground's own, from which on they contradict."""

LOCAL_IMBALANCE = 0.01
"""Part of the local forces that may be out of balance."""

_NOTHING = 1e-9
"""Local forces, in parts of the largest, that count as none."""

_GRAVITY = 9.81  # m/s^2

_SHOWN = 8  # groups in a note

_LIFTED = 1e-6  # of the largest pressure: a tension below it is rounding

ACCEPT = "or accept it: in_situ: {equilibrium: accept}"


def contradictions(analysis: StagedAnalysis, values: Values) -> list[Fault]:
    """Where weight and in-situ stress contradict each other at some parameter values.

    Without any in-situ stress nothing can: weight and loads then make it, by elasticity.

    Args:
        analysis: of the case.
        values: parameters by name, SI.
    """
    case = analysis.case
    if case.in_situ is None and not case.in_situ_of:
        return []
    return _weight_faults(analysis, values) or _balance_faults(analysis, values)


@dataclass(frozen=True)
class _Disagreement:
    """A group whose weight is another than that of its in-situ stress; unit weights in N/m3."""

    path: KeyPath
    material: str
    grows: float
    density: float
    gravity: float | None
    water: float | None


def _growth(
    model: InSitu | None, dim: int, values: Values
) -> tuple[KeyPath, float, Surface] | None:
    """By how much a vertical pressure grows with depth, N/m3: its key, the number, the surface."""
    if isinstance(model, HeimStress) and model.unit_weight is not None:
        return ("unit_weight",), model.unit_weight.value(values), model.surface or Scalar(0.0)
    if isinstance(model, ProfileStress):
        vertical = model.gradient[dim - 1]
        if vertical != Scalar(0.0):  # else it is the same at all depths
            return ("gradient", "xyz"[dim - 1] * 2), -vertical.value(values), model.surface
    return None


def _weight_faults(analysis: StagedAnalysis, values: Values) -> list[Fault]:
    """Unit weights of in-situ stresses that are not those of the ground."""
    case, sequence, mesh = analysis.case, analysis.sequence, analysis.on_mesh.mesh
    points = analysis.systems.discretization.points
    group_of_point = sequence.group_of[points.element]

    def below(surface: Surface) -> Bools:
        """(n_points,) strain points below a level or the topography."""
        depth = Depths(mesh, surface, points.position).at(ParameterPoint(values, ()))
        return np.asarray(depth.value > 0.0)

    wet = np.zeros(points.n_points, dtype=bool)
    if case.water is not None:
        wet = is_wet(case.water, group_of_point, sequence.groups) & below(case.water.table)
    stressed: dict[Surface, Bools] = {}
    groups: dict[_Disagreement, list[str]] = {}
    for g, material in sequence.states[0].materials.items():
        name = sequence.groups[g]
        zone = case.in_situ_of.get(name)
        growth = _growth(zone or case.in_situ, case.analysis.dim, values)
        if growth is None:
            continue
        key, grows, surface = growth
        if surface not in stressed:
            stressed[surface] = below(surface)
        density = case.materials[material].density.value(values)
        gravity = None if case.gravity is None else -case.gravity[-1]
        prefix: KeyPath = ("in_situ",) if zone is None else ("in_situ", "groups", name)
        for under_water in (False, True):
            if not (stressed[surface] & (group_of_point == g) & (wet == under_water)).any():
                continue
            water = None
            if under_water and case.water is not None:
                water = case.water.unit_weight.value(values)
            own = density * (gravity or 0.0) - (water or 0.0)
            if abs(grows - own) > UNIT_WEIGHT * max(abs(own), 1e-9 * abs(grows)):
                one = _Disagreement((*prefix, *key), material, grows, density, gravity, water)
                groups.setdefault(one, []).append(name)
    return [_weight_fault(case, disagreement, names) for disagreement, names in groups.items()]


def _weight_fault(case: Case, disagreement: _Disagreement, groups: list[str]) -> Fault:
    """The sentence about groups of one material."""
    stress = (
        f"the in-situ stress of {_listed(groups)} grows by {_weight(disagreement.grows)} with depth"
    )
    density = f"{disagreement.density:.4g} kg/m3"
    if disagreement.gravity is None:
        right = disagreement.grows / _GRAVITY
        weighs = "the ground weighs 0 kN/m3"
        message = f"{stress}, but there is no gravity: {weighs}"
        weights = (
            f"'{disagreement.material}' has {density}"
            if disagreement.density
            else f"'{disagreement.material}' has no density: {right:.4g} kg/m3 would be"
            f" {_weight(disagreement.grows)}"
        )
        hint = f"Add 'gravity: 9.81 m/s2' ({weights}), {ACCEPT}."
        return case.source.fault(disagreement.path, "no-gravity", message, hint)
    own = disagreement.density * disagreement.gravity
    weighs = _weight(own - (disagreement.water or 0.0))
    product = f"{density} x {disagreement.gravity:.4g} m/s2"
    if disagreement.water is None:
        message = f"{stress}, but density times gravity of '{disagreement.material}' is {weighs}"
        message += f" ({product})"
    else:
        message = (
            f"{stress}, but below the water table '{disagreement.material}' weighs "
            f"{weighs} ({product} less {_weight(disagreement.water)} of water; "
            "in-situ stresses are effective)"
        )
    right = (
        (disagreement.grows + (disagreement.water or 0.0)) / disagreement.gravity
        if disagreement.gravity
        else 0.0
    )
    hint = (
        f"Correct '{disagreement.path[-1]}' ({weighs}) or the density ({right:.4g} kg/m3), or let "
        f"'model: geostatic' take the weight from the densities, {ACCEPT}."
    )
    return case.source.fault(disagreement.path, "unit-weight", message, hint)


def _balance_faults(analysis: StagedAnalysis, values: Values) -> list[Fault]:
    """The initial state is out of balance somewhere by too much of the local stress."""
    imbalance = local_imbalance(analysis, ParameterPoint(values, ()))
    if imbalance.part <= LOCAL_IMBALANCE:
        return []
    unit = "kN" if analysis.case.analysis is not Analysis.PLANE_STRAIN else "kN/m"
    where = f"in '{imbalance.group}'"
    if imbalance.across:
        where = f"where {_listed(imbalance.across)} meet,"
    message = (
        f"the initial state is out of balance near {format_point(imbalance.position)} {where} "
        f"by {100 * imbalance.part:.2g} % of the local stress: {imbalance.rest / 1e3:.3g} "
        f"of {imbalance.size / 1e3:.3g} {unit}"
    )
    hint = (
        "Hold the edges of the model ('supports', or 'held: true'), and let weight, water, loads "
        "and in-situ stress agree, as 'model: geostatic' does; where slopes or dipping layers "
        f"remain, {ACCEPT[3:]}."
    )
    hint = _meeting_hint(imbalance.across) if imbalance.across else hint
    path = ("in_situ",)
    return [analysis.case.source.fault(path, "out-of-balance", message, hint)]


def _meeting_hint(groups: Sequence[str]) -> str:
    """What to do where groups of different horizontal stress meet at a steep boundary."""
    return (
        "A steep boundary bears only one horizontal stress, that of both sides: give "
        f"{_listed(groups)} the same horizontal stress there (one K0), or let them meet at a "
        "horizontal boundary; where the ground is so, "
        "accept it: in_situ: {equilibrium: accept} brings the difference to equilibrium "
        "before the first stage."
    )


@dataclass(frozen=True)
class LocalImbalance:
    """Where the initial state is most out of balance.

    Args:
        part: of the local forces.
        rest: force out of balance, N (N/m in plane strain).
        size: the local forces, likewise.
        position: (dim,) m.
        group: there.
        across: groups that meet there, if what is out of balance is that their horizontal stresses
            differ; empty otherwise.
    """

    part: float
    rest: float
    size: float
    position: Floats
    group: str
    across: tuple[str, ...] = ()


def local_imbalance(analysis: StagedAnalysis, point: ParameterPoint) -> LocalImbalance:
    """The largest part of the local forces that is out of balance in the initial state.

    Args:
        analysis: of the case.
        point: the parameters; derivatives are not asked for.
    """
    point = ParameterPoint(point.values, ())
    system, mesh = analysis.systems[0], analysis.on_mesh.mesh
    stress = analysis.in_situ.columns(point)[..., 0]
    stress[:, ~system.present] = 0.0
    parts = [forces(point)[:, 0] for _, forces in analysis.actions.parts(0)]
    # in parts of the largest, so that no square of a force overflows
    unit = max((float(np.abs(x).max(initial=0.0)) for x in (stress, *parts)), default=0.0) or 1.0
    stress, parts = stress / unit, [part / unit for part in parts]
    internal, size, owner = _internal_forces(analysis, stress)
    rest = -internal.ravel()
    tractions = analysis.joints.columns(point) / unit
    if len(tractions):
        held = analysis.systems.structures.nodal_forces(tractions)[:, 0]
        rest = rest - held
        size = size + np.linalg.norm(held.reshape(-1, mesh.dim), axis=1)
    for part in parts:
        rest = rest + part
        size = size + np.linalg.norm(part.reshape(-1, mesh.dim), axis=1)
    free = np.zeros(len(rest), dtype=bool)
    free[system.dofs] = True
    unheld = _at_corners(mesh, np.where(free, rest, 0.0).reshape(-1, mesh.dim))
    left, size = np.linalg.norm(unheld, axis=1), _at_corners(mesh, size[:, None])[:, 0]
    floor = max(_NOTHING * float(size.max(initial=0.0)), np.finfo(float).tiny)
    ratio = np.where(size > floor, left / np.maximum(size, floor), 0.0)
    worst = int(np.argmax(ratio))
    group = analysis.sequence.groups[analysis.sequence.group_of[owner[worst]]]
    axis = int(np.argmax(np.abs(unheld[worst])))
    return LocalImbalance(
        float(ratio[worst]),
        unit * float(left[worst]),
        unit * float(size[worst]),
        mesh.points[worst],
        group,
        _meeting(analysis, worst, stress, axis) if axis < mesh.dim - 1 else (),
    )


def _meeting(analysis: StagedAnalysis, node: int, stress: Floats, axis: int) -> tuple[str, ...]:
    """The groups on both sides of a node along a horizontal axis, if their stresses differ there.

    Horizontal stresses are compared in parts of the vertical ones, which differ by depth alone.
    """
    sequence, mesh = analysis.sequence, analysis.on_mesh.mesh
    points, present = analysis.systems.discretization.points, sequence.present(0)
    around = np.concatenate(
        [
            span.start + np.flatnonzero((block.nodes == node).any(axis=1))
            for block, span in spans(mesh.blocks)
        ]
    )
    near = np.isin(points.element, around[present[around]])
    beside = points.position[near, axis] - mesh.points[node, axis]
    group = sequence.group_of[points.element[near]]
    groups = np.unique(group)
    if len(groups) < 2 or beside.min() > 0.0 or beside.max() < 0.0:
        return ()  # the edge of the ground, one kind of it, or a beam between interfaces
    sums = np.array([stress[:, near][:, group == one].sum(axis=1) for one in groups])
    up = mesh.dim - 1
    along, vertical = sums[:, axis], sums[:, up]
    ratio = along / np.where(vertical == 0.0, 1.0, vertical)
    differ = np.ptp(ratio) > LOCAL_IMBALANCE * np.abs(ratio).max()
    return tuple(sequence.groups[one] for one in groups) if differ else ()


def _at_corners(mesh: Mesh, forces: Floats) -> Floats:
    """Forces (n_nodes, k) with those of mid-nodes shared by the corners beside them.

    The part of a stress that an element of second order cannot follow moves forces to and fro
    between its corners and mid-nodes, which is no imbalance of the patch.
    """
    beside = np.zeros((mesh.n_nodes, 2), dtype=np.int64)
    middle = np.zeros(mesh.n_nodes, dtype=bool)
    for block in mesh.blocks:
        cell = CELLS[block.kind]
        for n, edge in enumerate(cell.edges):
            nodes = block.nodes[:, cell.n_corners + n]
            beside[nodes], middle[nodes] = block.nodes[:, edge], True
    shared = np.where(middle[:, None], 0.0, forces)
    for corner in beside[middle].T:
        np.add.at(shared, corner, 0.5 * forces[middle])
    return shared


def _internal_forces(analysis: StagedAnalysis, stress: Floats) -> tuple[Floats, Floats, Ints]:
    """Forces of a stress (n_strain, n_points) on the nodes, element by element.

    Returns:
        Their sum (n_nodes, dim), the sum of their sizes (n_nodes,), and an element (n_nodes,) that
        is present at each node (0 where there is none).
    """
    discretization, mesh = analysis.systems.discretization, analysis.on_mesh.mesh
    present = analysis.sequence.present(0)
    adds = discretization.kinematics.incidence
    total, size = np.zeros((mesh.n_nodes, mesh.dim)), np.zeros(mesh.n_nodes)
    owner, first = np.zeros(mesh.n_nodes, dtype=np.int64), 0
    for (block, span), geometry in zip(spans(mesh.blocks), discretization.geometries, strict=True):
        n_el, n_q = geometry.volumes.shape
        of_block = stress[:, first : first + n_el * n_q].reshape(-1, n_el, n_q)
        first += n_el * n_q
        pulls = np.einsum("cij,ceq->eqij", adds, of_block * geometry.volumes)
        forces = np.einsum("eqij,eqaj->eai", pulls, geometry.gradients)
        rows = present[span]
        nodes = block.nodes[rows]
        np.add.at(total, nodes, forces[rows])
        np.add.at(size, nodes, np.linalg.norm(forces[rows], axis=2))
        owner[nodes] = np.arange(span.start, span.stop)[rows][:, None]
    return total, size, owner


def surface_gaps(analysis: StagedAnalysis, values: Values) -> list[Fault]:
    """Surfaces of geostatic stresses that are not where the ground of the mesh ends.

    Args:
        analysis: of the case.
        values: parameters by name, SI.
    """
    case, sequence = analysis.case, analysis.sequence
    points = analysis.systems.discretization.points
    present = analysis.systems[0].present
    group_of_point = sequence.group_of[points.element]
    faults = []
    for path, model, groups in _geostatic_zones(analysis):
        if model.surface is None:
            continue
        chosen = present & np.isin(group_of_point, groups)
        places = StressPlaces(points.position[chosen], group_of_point[chosen])
        above = Overburden(analysis.on_mesh).above(places.positions)
        on_top = CoverAndSurcharge(model, analysis.on_mesh.mesh, places.positions, above)
        gap = on_top.thickness(ParameterPoint(values, ())).value
        low, high = int(np.argmin(gap)), int(np.argmax(gap))
        if gap[low] < 0:
            message = _gap_text(places.positions[low], -gap[low], "below")
            hint = "Correct 'surface', or leave it out: the ground then ends with the mesh."
        elif gap[high] > 0 and model.cover is None:
            message = _gap_text(places.positions[high], gap[high], "above")
            message += ", and 'cover', the unit weight between, is missing"
            hint = "Add 'cover: 20 kN/m3', correct 'surface', or leave it out."
        else:
            continue
        key = (*path, "surface")
        faults.append(case.source.fault(key, "surface", message, hint))
    return faults


def overburden_notes(analysis: StagedAnalysis, values: Values) -> list[str]:
    """What the weight above comes to in the groups with a geostatic stress, a sentence.

    Args:
        analysis: of the case.
        values: parameters by name, SI.
    """
    points, sequence = analysis.systems.discretization.points, analysis.sequence
    wanted = [g for _, _, groups in _geostatic_zones(analysis) for g in groups]
    wanted = [g for g in sequence.states[0].materials if g in wanted]
    if not wanted:
        return []
    stress = analysis.in_situ.columns(ParameterPoint(values, ()))[
        analysis.case.analysis.dim - 1, :, 0
    ]
    group_of_point = sequence.group_of[points.element]
    ranges = []
    for g in wanted[:_SHOWN]:
        vertical = -stress[group_of_point == g] / 1e3
        ranges.append(f"'{sequence.groups[g]}' {vertical.min():.3g} .. {vertical.max():.3g} kPa")
    more = f" and {len(wanted) - _SHOWN} more groups" if len(wanted) > _SHOWN else ""
    effective = "" if analysis.case.water is None else "effective "
    return [
        f"vertical {effective}in-situ stress by the weight above, at the start values, in "
        f"compression: {', '.join(ranges)}{more}"
    ]


def water_notes(analysis: StagedAnalysis, values: Values) -> list[str]:
    """Ground below the water table that its pressure would lift, a sentence.

    Args:
        analysis: of the case.
        values: parameters by name, SI.
    """
    sequence, points = analysis.sequence, analysis.systems.discretization.points
    water, present = sequence.states[0].water, analysis.systems[0].present
    if water is None:
        return []
    point = ParameterPoint(values, ())
    pressure = PorePressure(water, analysis.on_mesh.mesh, points.position).at(point).value
    wet = is_wet(water, sequence.group_of[points.element], sequence.groups) & present
    wet &= pressure > 0.0
    up = analysis.case.analysis.dim - 1
    vertical = analysis.virgin(point)[0][up, :, 0]
    lifted = wet & (vertical > _LIFTED * pressure.max(initial=0.0)) & (vertical < pressure)
    if not lifted.any():
        return []
    worst = int(np.argmax(np.where(lifted, vertical, -np.inf)))
    part = np.count_nonzero(lifted) / np.count_nonzero(wet)
    kPa = 1e-3 * float(vertical[worst]), 1e-3 * float(pressure[worst])
    return [
        f"the water lifts the ground: at the start values the vertical effective in-situ stress is "
        f"tension in {max(100.0 * part, 1.0):.0f} % of the ground below the water table, up to "
        f"{kPa[0]:.3g} kPa near {format_point(points.position[worst])}, where the water has "
        f"{kPa[1]:.3g} kPa. If the table is above the ground, its weight on the ground is missing "
        "(a surcharge); else check the level of the table, its unit and the densities"
    ]


def _gap_text(position: Floats, gap: float, side: str) -> str:
    axis = "x" if len(position) == 2 else "(x, y)"
    plan = f"{position[0]:.4g}" if len(position) == 2 else format_point(position[:2])[:-2]
    return f"at {axis} = {plan} m the surface lies {gap:.4g} m {side} the top of the mesh"


def _geostatic_zones(
    analysis: StagedAnalysis,
) -> Iterator[tuple[KeyPath, GeostaticStress, list[int]]]:
    """Geostatic stresses with their keys and the groups that have them."""
    case, names = analysis.case, analysis.sequence.groups
    rest = [g for g, name in enumerate(names) if name not in case.in_situ_of]
    if isinstance(case.in_situ, GeostaticStress):
        yield ("in_situ",), case.in_situ, rest
    for name, model in case.in_situ_of.items():
        if isinstance(model, GeostaticStress):
            yield ("in_situ", "groups", name), model, [names.index(name)]


def _weight(unit_weight: float) -> str:
    return f"{unit_weight / 1e3:.4g} kN/m3"


def _listed(groups: Sequence[str]) -> str:
    names = [f"'{name}'" for name in groups]
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"

"""Whether a case fits its mesh: everything that is wrong at once, what to know, and what was found.

Each room checks its own (`ground`, `yielding`, `in_situ`, `actions`, `structures`, `gauges`), the
mesh by itself `mesh_checks`; here
their findings come together. Where all groups are known, so is which ground is there when, and all
is said at once; where the case names groups that the mesh lacks, what does not depend on them is
said beside: points that lie outside the mesh. The same holds for a case of which parts are known
to be wrong already. What was prepared is handed on (`CaseOnMesh`): a model need not seek it.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Protocol

import numpy as np

from geoident.errors import Fault, InputError, ModelError
from geoident.fem.interfaces import SplitMesh, split
from geoident.fem.kinematics import kinematics_of
from geoident.fem.location import format_point
from geoident.fem.measure import suspected_unit
from geoident.fem.mechanism import LooseBody, loose_body
from geoident.fem.orientation import oriented, turned_elements
from geoident.forward.actions.motions import motion_faults
from geoident.forward.actions.supports import (
    fixed_dofs,
    load_faults,
    load_place_faults,
    support_faults,
)
from geoident.forward.axisymmetric_checks import revolution_faults
from geoident.forward.consolidation.checks import (
    consolidation_faults,
    drained_group_faults,
    inadmissible_water,
    leaking_walls,
)
from geoident.forward.gauges.kinds import gauges_outside, place_gauges, reading_faults
from geoident.forward.gauges.observation import PlacedGauges
from geoident.forward.gauges.placement import zeroed_too_early
from geoident.forward.ground.checks import section_faults
from geoident.forward.ground.elasticity import inadmissible
from geoident.forward.ground.field import field_faults
from geoident.forward.hardening.soils import impossible_soil
from geoident.forward.heat.checks import (
    heat_faults,
    heat_group_faults,
    inadmissible_film,
    inadmissible_heat,
)
from geoident.forward.in_situ.growth import growth_faults
from geoident.forward.in_situ.stress import (
    NEGLIGIBLE_IMBALANCE,
    surface_faults,
    zone_faults,
)
from geoident.forward.in_situ.water import PorePressure
from geoident.forward.mesh_checks import mesh_faults, mesh_notes, parted_from
from geoident.forward.of_mesh import OfMesh
from geoident.forward.openings.face import face_faults
from geoident.forward.stages import (
    CaseOnMesh,
    ConstructionSequence,
    group_faults,
)
from geoident.forward.structures.checks import (
    lining_faults,
    structure_faults,
    structure_notes,
    structure_place_faults,
)
from geoident.forward.structures.grouted import BarLines, bar_lines, with_bars
from geoident.forward.structures.interfaces import inadmissible_interface, interface_faults
from geoident.forward.structures.members import inadmissible as impossible_structure
from geoident.forward.structures.placing import shell_groups, with_shells
from geoident.forward.yielding.checks import (
    locking_notes,
    no_stress_left,
    yield_faults,
    yield_notes,
)
from geoident.model.actions import WaterPressure
from geoident.model.case import Case, KeyPath, format_path
from geoident.model.dual import ParameterPoint
from geoident.model.gauges import named_channels
from geoident.model.mesh import Mesh, nodes_in
from geoident.model.parameter import Scalar, Values
from geoident.model.structures import Beam, Shell


def check_on_mesh(case: Case, mesh: Mesh) -> tuple[CaseOnMesh, PlacedGauges]:
    """Make sure that a case fits its mesh; nothing is assembled or solved.

    Returns:
        The case on its mesh, and its gauges there.

    Raises:
        InputError: everything in the case that does not fit the mesh, at once.
        ModelError: a piece of the ground that no support holds.
    """
    on_mesh = _on(mesh, case)
    faults = _group_faults(on_mesh)
    if faults:
        raise InputError([*faults, *_points_outside(on_mesh)])
    gauges, faults = _all_faults(on_mesh)
    if faults or gauges is None:
        raise InputError(faults)
    _refuse_mechanisms(on_mesh.unsplit)
    return on_mesh, gauges


_upright_of = OfMesh[Mesh]()
_turning_of = OfMesh[Mesh]()
_barred_of = OfMesh[Mesh]()
_split_of = OfMesh[SplitMesh]()
_loose_body_of = OfMesh[LooseBody | None]()


def _on(mesh: Mesh, case: Case) -> CaseOnMesh:
    kinematics = kinematics_of(case.analysis)
    groups, bars = shell_groups(case, mesh), bar_lines(case)
    upright = _upright_of(mesh, case.analysis, lambda: oriented(mesh, kinematics))
    turning = _turning_of(upright, groups, lambda: with_shells(upright, groups))
    whole = CaseOnMesh(case, turning, turned=turned_elements(mesh, upright), given=mesh)
    along = tuple(one.along for one in case.interfaces.values())
    if not along:
        return replace(whole, mesh=_with_bars(turning, bars))
    between = tuple(one.group for one in case.structures.values() if isinstance(one, Beam | Shell))
    parted = _split_of(upright, (along, between), lambda: split(upright, along, between))
    turning = _turning_of(parted.mesh, groups, lambda: with_shells(parted.mesh, groups))
    return replace(
        whole,
        mesh=_with_bars(turning, bars),
        joints=parted.joints,
        before=whole,
        original=parted.original,
    )


def _with_bars(mesh: Mesh, bars: BarLines) -> Mesh:
    return _barred_of(mesh, bars, lambda: with_bars(mesh, bars)) if bars else mesh


def _all_faults(on_mesh: CaseOnMesh) -> tuple[PlacedGauges | None, list[Fault]]:
    """The gauges on a mesh that has all groups, and all that is wrong.

    Gauges on structures that lack ground cannot be judged; there are no gauges then.
    """
    structures = structure_place_faults(on_mesh)
    places = (
        motion_faults, load_place_faults, zone_faults, _field_faults, growth_faults,
        _stress_without_ground, face_faults, lining_faults, consolidation_faults,
        heat_faults,
    )  # fmt: skip
    faults = mesh_faults(on_mesh.unsplit)
    faults += [*(fault for faults_of in places for fault in faults_of(on_mesh)), *structures]
    if structures:
        return None, [*faults, *_points_outside(on_mesh)]
    gauges, gauge_faults = place_gauges(on_mesh)
    return gauges, [
        *faults,
        *gauge_faults,
        *reading_faults(on_mesh.case, gauges, gauge_faults),
    ]


def _points_outside(on_mesh: CaseOnMesh) -> list[Fault]:
    """Points that lie outside the mesh, whichever ground may be there when."""
    return [*gauges_outside(on_mesh), *_fields_outside(on_mesh)]


def notes_on_mesh(
    on_mesh: CaseOnMesh,
    gauges: PlacedGauges,
    *,
    edges_held: bool,
    n_outside: int,
    in_tension: bool,
) -> list[str]:
    """What the user should know of how the case was understood.

    Args:
        on_mesh: the case on its mesh.
        gauges: those of the case, on its mesh.
        edges_held: whether tractions on edges hold the in-situ stress where no support does.
        n_outside: strain points beside the faces that give a level of the ground or of the water.
        in_tension: whether most of the virgin ground is in tension at the start values.
    """
    case = on_mesh.case
    notes = []
    on_axis = np.count_nonzero(on_mesh.kinematics.on_axis(on_mesh.mesh.points))
    if on_axis:
        notes.append(f"{on_axis} nodes on the axis of revolution x = 0 are held radially (u_r = 0)")
    if edges_held:
        notes.append(
            "the in-situ stress is held at the edges of the model by tractions "
            "(in_situ: held: true)"
        )
    if gauges.snapped:
        notes.append(
            "points just outside the mesh, taken by the nearest element: "
            + named_channels(gauges.snapped)
        )
    if gauges.as_built:
        notes.append(
            "readings that count from the placing of their ground on, what its own placing does "
            f"included: {named_channels(gauges.as_built)}"
        )
    notes += zeroed_too_early(on_mesh)
    if n_outside:
        notes.append(
            f"{n_outside} strain points lie beside the faces that give the level of the ground or "
            "of the water; the level of the nearest node of these faces was taken"
        )
    if any(state.water is not None for state in on_mesh.sequence.states):
        notes.append("there is water in the pores: all stresses are effective stresses")
    notes += mesh_notes(on_mesh.unsplit)
    notes += _odd_notes(on_mesh, in_tension=in_tension) + _flooded_notes(on_mesh)
    notes += yield_notes(case)
    notes += locking_notes(on_mesh)
    notes += structure_notes(on_mesh)
    notes += leaking_walls(on_mesh)
    return notes


def imbalance_notes(imbalance: float) -> list[str]:
    """What to know of an in-situ stress that is out of balance by a part of the largest force."""
    if imbalance <= NEGLIGIBLE_IMBALANCE:
        return []
    return [
        f"the in-situ stress is out of balance by {100 * imbalance:.3g} % of the largest nodal "
        "force; one equilibrium step was made, and its displacements are not counted"
    ]


class MadeOf(Protocol):
    """Anything with the names of the materials of the ground, such as a construction sequence."""

    @property
    def materials(self) -> tuple[str, ...]:
        """Names of the materials of the ground in any state."""


def inadmissible_numbers(case: Case, sequence: MadeOf, values: Values) -> str | None:
    """Why parameter values are outside the domain of a case, a sentence, or None if they are not.

    Args:
        case: the case.
        sequence: such as its states; materials that none of them uses do not count.
        values: parameter values by name, SI.
    """
    for material in (case.materials[name] for name in sorted(sequence.materials)):
        fault = inadmissible(material, values) or no_stress_left(case, material, values)
        if fault is None and material.soil is not None:
            fault = impossible_soil(material, values)
        fault = fault or inadmissible_water(case, material.name, values)
        fault = fault or inadmissible_heat(case, material.name, values)
        if fault is not None:
            return fault
    fault = inadmissible_film(case, values) or impossible_structure(case, values)
    return fault or inadmissible_interface(case, values)


def _odd_notes(on_mesh: CaseOnMesh, *, in_tension: bool) -> list[str]:
    """Notes on what is allowed but seldom meant."""
    case, notes = on_mesh.case, []
    densities = [case.materials[name].density for name in on_mesh.sequence.materials]
    if case.gravity is not None and all(density == Scalar(0.0) for density in densities):
        notes.append("there is gravity, but no material has a density: nothing weighs")
    notes += _idle_densities(on_mesh) if case.gravity is None else []
    lasting = [stage.name for stage in case.stages if stage.lasts and not stage.goes_on]
    if lasting and case.in_steps is None:
        notes.append(
            f"{', '.join(map(repr, lasting))} last{'s' * (len(lasting) == 1)}, and nothing in the "
            "ground takes time: give its material 'hydraulic' (water that takes time to leave) or "
            "'creep', the case 'initial_temperature' (heat), or remove 'lasts'"
        )
    notes += [
        f"the hydration of {name!r} has no effect: it warms only where heat is conducted, and the "
        "case has no 'initial_temperature'"
        for name in on_mesh.sequence.materials
        if case.materials[name].hydration is not None and not case.conducts
    ]
    notes += [
        f"no group is of the material {name!r}: its constants, and parameters that only they "
        "follow, have no effect"
        for name in case.materials
        if name not in on_mesh.sequence.materials
    ]
    if suspicion := suspected_unit(
        on_mesh.mesh.points.min(axis=0), on_mesh.mesh.points.max(axis=0)
    ):
        notes.append(suspicion)
    if in_tension:
        notes.append(
            "at the start values the virgin ground is in tension: stresses are positive in "
            "tension, the vertical stress of Heim's model is positive in compression"
        )
    return notes


_FLOODS = 10e3
"""Pressure of water at new faces, Pa, from which on it is worth a note: a metre of it."""


def _flooded_notes(on_mesh: CaseOnMesh) -> list[str]:
    """Stages that only excavate below water that stays, so that nothing holds its pressure."""
    case, mesh, sequence = on_mesh.case, on_mesh.mesh, on_mesh.sequence
    point, stages, most = ParameterPoint(case.start, ()), list[str](), 0.0
    for state in () if case.consolidates else sequence.states[1:]:
        water = state.water
        held = any(isinstance(load, WaterPressure) for load in state.loads.values())
        if water is None or water.falls is not None or held or state.placed or state.built:
            continue
        wet = [
            n for n in state.leaving if water.groups is None or sequence.groups[n] in water.groups
        ]
        nodes = nodes_in(mesh.blocks, np.isin(sequence.group_of, wet))
        pressure = PorePressure(water, mesh, mesh.points[nodes]).at(point).value.max(initial=0.0)
        if pressure > _FLOODS:
            stages.append(repr(state.name))
            most = max(most, float(pressure))
    if not stages:
        return []
    return [
        f"{', '.join(stages)} excavate{'s' * (len(stages) == 1)} below the water, which stays as "
        f"it is in the ground around: nothing holds its pressure (up to {most / 1e3:.3g} kPa) at "
        "the new faces, and a floor heaves by it. Lower it in the stage (water: {table: ..}), let "
        "it fall along a line ('falls'), or load the faces with 'water'"
    ]


def _idle_densities(on_mesh: CaseOnMesh) -> list[str]:
    """Notes on free densities in a case without gravity."""
    sought: dict[str, list[str]] = {}
    for name in sorted(on_mesh.sequence.materials):
        parameter = on_mesh.case.materials[name].density.parameter
        if parameter is not None:
            sought.setdefault(parameter, []).append(name)
    return [
        f"the density of {', '.join(map(repr, names))} follows from {parameter} and has no effect: "
        "a density acts only with gravity, and the case has none (gravity: 9.81 m/s2)"
        for parameter, names in sought.items()
    ]


def _field_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Measured values of fields at points that are not in their material."""
    return field_faults(on_mesh.case, on_mesh.not_in)


def _fields_outside(on_mesh: CaseOnMesh) -> list[Fault]:
    """Measured values of fields at points that are not in the mesh."""

    def outside(_: str, point: tuple[float, ...]) -> str | None:
        place = on_mesh.kinematics.in_section(point)[0]
        return None if on_mesh.locator.sites(place) else on_mesh.not_in_mesh()

    return field_faults(on_mesh.case, outside)


def _group_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """What names groups that the mesh lacks, or asks of a section what it cannot do."""
    return [
        *revolution_faults(on_mesh),
        *section_faults(on_mesh.case),
        *yield_faults(on_mesh.case),
        *group_faults(on_mesh),
        *support_faults(on_mesh),
        *load_faults(on_mesh),
        *drained_group_faults(on_mesh),
        *heat_group_faults(on_mesh),
        *surface_faults(on_mesh),
        *structure_faults(on_mesh),
        *interface_faults(on_mesh),
    ]


def _refuse_mechanisms(on_mesh: CaseOnMesh) -> None:
    """Refuse states without ground, and with pieces that can move freely.

    Raises:
        InputError: no ground is present at a stage.
        ModelError: a piece of the ground can move freely.
    """
    mesh, sequence, source = on_mesh.mesh, on_mesh.sequence, on_mesh.case.source
    checked = set()
    for n, state in enumerate(sequence.states):
        present, fixed = sequence.present(n), fixed_dofs(on_mesh, n)
        if not present.any():
            if sequence.states[state.base].materials or not sequence.materials:
                raise InputError([_no_ground(on_mesh, n)])
            continue  # fill on a rigid base is still to come
        what = present.tobytes() + fixed.tobytes()
        if what in checked:
            continue
        checked.add(what)
        loose = _loose_body_of(
            mesh,
            (on_mesh.kinematics.rigid, present.tobytes(), fixed.tobytes()),
            partial(loose_body, mesh, on_mesh.table, on_mesh.kinematics, present, fixed),
        )
        if loose is None:
            continue
        place: KeyPath = ("stages", n - 1) if n else ("supports",)
        hint = (
            "See whether what this stage takes away cuts the piece loose, or hold it by 'supports'."
            if n
            else "Hold it by 'supports': groups on its edge, with the axes that they hold."
        )
        hint = parted_from(on_mesh, loose.elements) or hint
        msg = f"at stage '{state.name}' {_loose_text(loose, sequence)}"
        raise ModelError(msg, hint, location=source.locate(place), path=format_path(place))


def _stress_without_ground(on_mesh: CaseOnMesh) -> list[Fault]:
    """An in-situ stress where nothing is there before the first stage that could have it."""
    case = on_mesh.case
    if case.in_situ is None or on_mesh.sequence.states[0].materials:
        return []
    message = "no ground is there before the first stage that could have an in-situ stress"
    hint = "Remove 'in_situ': what is placed has none; or give a group a material under 'groups'."
    return [case.source.fault(("in_situ",), "absent-group", message, hint)]


def _no_ground(on_mesh: CaseOnMesh, n: int) -> Fault:
    """The fault of a state without any ground."""
    if n:
        place: KeyPath = ("stages", n - 1)
        message = f"after stage '{on_mesh.sequence.states[n].name}' no ground is present"
        hint = "Something has to stay: leave out what the stage takes away last."
    else:
        place, message = ("groups",), "no ground is present before the first stage"
        hint = (
            "Give one group a material from the beginning, or place one by 'install' in the first "
            "stage (fill on a rigid base: 'supports' hold its foot)."
        )
    return on_mesh.case.source.fault(place, "no-ground", message, hint)


def _loose_text(loose: LooseBody, sequence: ConstructionSequence) -> str:
    """The loose elements, their place and their motion, for a message."""
    names = sorted({sequence.groups[g] for g in sequence.group_of[loose.elements]})
    axes = " and ".join(a for a, x in zip("xyz", loose.motion, strict=False) if x)
    motion = f"move along {axes}" if axes else "turn"
    count = len(loose.elements)
    return (
        f"{count} element{'s' * (count > 1)} of {', '.join(map(repr, names))} near"
        f" {format_point(loose.centre)} can {motion} freely: nothing holds the piece"
    )

"""Whether a case fits its mesh: everything that is wrong at once, what to know, and what was found.

Each room checks its own (`ground`, `yielding`, `in_situ`, `actions`, `structures`, `gauges`); here
their findings come together, in three rounds, since each round needs what the round before made
sure of: groups that the mesh has; ground that is there when something needs it; gauges that can be
read when they were. What the rounds prepared is handed on, so that a model need not seek it again.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.errors import Fault, InputError, Location, ModelError
from geoident.fem.faces import FaceTable, face_table, nonconforming
from geoident.fem.kinematics import Kinematics, kinematics_of
from geoident.fem.location import Locator, format_point
from geoident.fem.mechanism import LooseBody, loose_body
from geoident.fem.orientation import oriented
from geoident.forward.actions.supports import (
    fixed_dofs,
    load_faults,
    load_place_faults,
    support_faults,
)
from geoident.forward.axisymmetric_checks import revolution_faults
from geoident.forward.gauges.observation import Observation, observe, reading_faults
from geoident.forward.ground.checks import section_faults
from geoident.forward.ground.elasticity import inadmissible
from geoident.forward.in_situ.stress import (
    NEGLIGIBLE_IMBALANCE,
    edges_held,
    in_situ_models,
    surface_faults,
    zone_faults,
)
from geoident.forward.stages import ConstructionSequence, construction_sequence, group_faults
from geoident.forward.structures.checks import (
    structure_faults,
    structure_notes,
    structure_place_faults,
)
from geoident.forward.structures.members import inadmissible as impossible_structure
from geoident.forward.yielding.checks import no_stress_left, yield_faults, yield_notes
from geoident.model.arrays import Bools
from geoident.model.case import Case, KeyPath, format_path
from geoident.model.mesh import Mesh
from geoident.model.parameter import Scalar, Values


@dataclass(frozen=True)
class CaseOnMesh:
    """A case and a mesh that fit each other, with what finding that out has prepared.

    Args:
        case: the case.
        mesh: its mesh, every element turned so that its volume is positive.
        kinematics: of the analysis.
        table: the faces of the mesh.
        locator: finds elements by points.
        sequence: the states of construction on the groups of the mesh.
        observation: the gauges on the mesh.
        fixed: (n_dofs,) degrees of freedom held by supports or by the axis of revolution.
    """

    case: Case
    mesh: Mesh
    kinematics: Kinematics
    table: FaceTable
    locator: Locator
    sequence: ConstructionSequence
    observation: Observation
    fixed: Bools


def check_on_mesh(case: Case, mesh: Mesh) -> CaseOnMesh:
    """Make sure that a case fits its mesh; nothing is assembled or solved.

    Raises:
        InputError: everything in the case that does not fit the mesh, at once.
        ModelError: a piece of the ground that no support holds.
    """
    kinematics = kinematics_of(case.analysis)
    mesh = oriented(mesh, kinematics)
    table = face_table(mesh)
    _raise_any(_group_faults(case, mesh, table))
    sequence = construction_sequence(case, mesh)
    locator = Locator(mesh)
    _raise_any(
        [
            *load_place_faults(case, mesh, table, locator, sequence),
            *zone_faults(case, sequence),
            *structure_place_faults(case, mesh, sequence, locator),
        ]
    )
    observation, faults = observe(case, mesh, locator, sequence)
    _raise_any(faults or reading_faults(case, observation))
    fixed = fixed_dofs(case, mesh)
    found = CaseOnMesh(case, mesh, kinematics, table, locator, sequence, observation, fixed)
    _refuse_mechanisms(found)
    return found


def notes_on_mesh(found: CaseOnMesh, *, n_outside: int, in_tension: bool) -> list[str]:
    """What the user should know of how the case was understood.

    Args:
        found: the case on its mesh.
        n_outside: strain points beside the faces that give a level of the ground or of the water.
        in_tension: whether most of the virgin ground is in tension at the start values.
    """
    case, sequence = found.case, found.sequence
    notes = []
    on_axis = np.count_nonzero(found.kinematics.on_axis(found.mesh.points))
    if on_axis:
        notes.append(f"{on_axis} nodes on the axis of revolution x = 0 are held radially (u_r = 0)")
    if any(edges_held(model) for _, model in in_situ_models(case)):
        notes.append(
            "the in-situ stress is held at the edges of the model by tractions "
            "(in_situ: held: true)"
        )
    if found.observation.snapped:
        notes.append(
            "points just outside the mesh, taken by the nearest element: "
            + ", ".join(found.observation.snapped)
        )
    if n_outside:
        notes.append(
            f"{n_outside} strain points lie beside the faces that give the level of the ground or "
            "of the water; the level of the nearest node of these faces was taken"
        )
    if any(state.water is not None for state in sequence.states):
        notes.append("there is water in the pores: all stresses are effective stresses")
    notes += _conformity_notes(found)
    notes += _odd_notes(case, sequence, in_tension=in_tension)
    notes += yield_notes(case)
    notes += structure_notes(case, found.mesh, sequence, found.fixed)
    return notes


def _conformity_notes(found: CaseOnMesh) -> list[str]:
    """Where elements touch without sharing a face."""
    centres = nonconforming(found.mesh, found.table)
    if not len(centres):
        return []
    n = len(centres)
    faces = f"{n} quadrilateral faces lie" if n > 1 else "1 quadrilateral face lies"
    return [
        f"{faces} against triangles, {'the first ' if n > 1 else ''}near "
        f"{format_point(centres[0])}: elements that do not share whole faces can part there; "
        "put pyramids between hexahedra and tetrahedra, as gmsh does"
    ]


def imbalance_notes(imbalance: float) -> list[str]:
    """What to know of an in-situ stress that is out of balance by a part of the largest force."""
    if imbalance <= NEGLIGIBLE_IMBALANCE:
        return []
    return [
        f"the in-situ stress is out of balance by {100 * imbalance:.3g} % of "
        "the largest nodal force; one equilibrium step was made, its motion is not counted"
    ]


def inadmissible_numbers(case: Case, sequence: ConstructionSequence, values: Values) -> str | None:
    """Why parameter values are outside the domain of a case, a sentence, or None if they are not.

    Args:
        case: the case.
        sequence: its states; materials that none of them uses do not count.
        values: parameter values by name, SI.
    """
    for material in (case.materials[name] for name in sorted(sequence.materials)):
        found = inadmissible(material, values) or no_stress_left(case, material, values)
        if found is not None:
            return found
    return impossible_structure(case, values)


def _odd_notes(case: Case, sequence: ConstructionSequence, *, in_tension: bool) -> list[str]:
    """What is allowed, and seldom meant."""
    notes = []
    densities = [case.materials[name].density for name in sequence.materials]
    if case.gravity is not None and all(density == Scalar(0.0) for density in densities):
        notes.append("there is gravity, but no material has a density: nothing weighs")
    if in_tension:
        notes.append(
            "at the start values the virgin ground is in tension: stresses are positive in "
            "tension, the vertical stress of Heim's model is positive in compression"
        )
    return notes


def _group_faults(case: Case, mesh: Mesh, table: FaceTable) -> list[Fault]:
    """What names groups that the mesh lacks, or asks of a section what it cannot do."""
    return [
        *revolution_faults(case, mesh),
        *section_faults(case),
        *yield_faults(case),
        *group_faults(case, mesh),
        *support_faults(case, mesh),
        *load_faults(case, mesh, table),
        *surface_faults(case, mesh),
        *structure_faults(case, mesh),
    ]


def _refuse_mechanisms(found: CaseOnMesh) -> None:
    """Refuse states without ground, and with pieces that can move freely.

    Raises:
        InputError: no ground is present at a stage.
        ModelError: a piece of the ground can move freely.
    """
    mesh, sequence, source = found.mesh, found.sequence, found.case.source
    checked = set()
    for n, state in enumerate(sequence.states):
        present = sequence.present(n)
        if present.tobytes() in checked:
            continue
        checked.add(present.tobytes())
        if not present.any():
            msg = f"at stage '{state.name}' no ground is present"
            raise InputError([Fault("no-ground", msg, "see 'groups'", Location(mesh.file))])
        loose = loose_body(mesh, found.table, found.kinematics, present, found.fixed)
        if loose is None:
            continue
        place: KeyPath = ("stages", n - 1) if n else ("supports",)
        hint = (
            "See whether what this stage takes away cuts the piece loose, or hold it by 'supports'."
            if n
            else "Hold it by 'supports': groups on its edge, with the axes that they hold."
        )
        msg = f"at stage '{state.name}' {_loose_text(loose, sequence)}"
        raise ModelError(msg, hint, location=source.locate(place), path=format_path(place))


def _loose_text(loose: LooseBody, sequence: ConstructionSequence) -> str:
    """What moves, where, and how."""
    names = sorted({sequence.groups[g] for g in sequence.group_of[loose.elements]})
    axes = " and ".join(a for a, x in zip("xyz", loose.motion, strict=False) if x)
    motion = f"move along {axes}" if axes else "turn"
    count = len(loose.elements)
    return (
        f"{count} element{'s' * (count > 1)} of {', '.join(map(repr, names))} near"
        f" {format_point(loose.centre)} can {motion} freely: nothing holds the piece"
    )


def _raise_any(faults: list[Fault]) -> None:
    if faults:
        raise InputError(faults)

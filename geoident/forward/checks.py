"""Whether a case fits its mesh: everything that is wrong at once, what to know, and what was found.

Each room checks its own (`ground`, `yielding`, `in_situ`, `actions`, `structures`, `gauges`); here
their findings come together, in three rounds, since each round needs what the round before made
sure of: groups that the mesh has; ground that is there when something needs it; gauges that can be
read when they were. What the rounds prepared is handed on (`CaseOnMesh`): a model need not seek it.
"""

from __future__ import annotations

import numpy as np

from geoident.errors import Fault, InputError, Location, ModelError
from geoident.fem.faces import hanging_nodes, nonconforming
from geoident.fem.kinematics import kinematics_of
from geoident.fem.location import format_point
from geoident.fem.measure import coinciding_nodes, suspected_unit
from geoident.fem.mechanism import LooseBody, loose_body
from geoident.fem.orientation import oriented, overlapping, turned_elements
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
from geoident.forward.ground.field import field_faults
from geoident.forward.in_situ.stress import (
    NEGLIGIBLE_IMBALANCE,
    edges_held,
    in_situ_models,
    surface_faults,
    zone_faults,
)
from geoident.forward.stages import (
    CaseOnMesh,
    ConstructionSequence,
    element_number,
    group_faults,
)
from geoident.forward.structures.checks import (
    structure_faults,
    structure_notes,
    structure_place_faults,
)
from geoident.forward.structures.members import inadmissible as impossible_structure
from geoident.forward.yielding.checks import no_stress_left, yield_faults, yield_notes
from geoident.model.case import Case, KeyPath, format_path
from geoident.model.gauges import named_channels
from geoident.model.mesh import Mesh, nodes_in
from geoident.model.parameter import Scalar, Values


def check_on_mesh(case: Case, mesh: Mesh) -> tuple[CaseOnMesh, Observation]:
    """Make sure that a case fits its mesh; nothing is assembled or solved.

    Returns:
        The case on its mesh, and its gauges there.

    Raises:
        InputError: everything in the case that does not fit the mesh, at once.
        ModelError: a piece of the ground that no support holds.
    """
    upright = oriented(mesh, kinematics_of(case.analysis))
    on_mesh = CaseOnMesh(case, upright, turned=turned_elements(mesh, upright))
    _raise_any(_group_faults(on_mesh))
    _raise_any(_tangle_faults(on_mesh))
    places = load_place_faults, zone_faults, structure_place_faults, _field_faults
    _raise_any([fault for faults_of in places for fault in faults_of(on_mesh)])
    observation, faults = observe(on_mesh)
    _raise_any(faults or reading_faults(case, observation))
    _refuse_mechanisms(on_mesh)
    return on_mesh, observation


def notes_on_mesh(
    on_mesh: CaseOnMesh, observation: Observation, *, n_outside: int, in_tension: bool
) -> list[str]:
    """What the user should know of how the case was understood.

    Args:
        on_mesh: the case on its mesh.
        observation: its gauges there.
        n_outside: strain points beside the faces that give a level of the ground or of the water.
        in_tension: whether most of the virgin ground is in tension at the start values.
    """
    case = on_mesh.case
    notes = []
    on_axis = np.count_nonzero(on_mesh.kinematics.on_axis(on_mesh.mesh.points))
    if on_axis:
        notes.append(f"{on_axis} nodes on the axis of revolution x = 0 are held radially (u_r = 0)")
    if any(edges_held(model) for _, model in in_situ_models(case)):
        notes.append(
            "the in-situ stress is held at the edges of the model by tractions "
            "(in_situ: held: true)"
        )
    if observation.snapped:
        notes.append(
            "points just outside the mesh, taken by the nearest element: "
            + named_channels(observation.snapped)
        )
    if n_outside:
        notes.append(
            f"{n_outside} strain points lie beside the faces that give the level of the ground or "
            "of the water; the level of the nearest node of these faces was taken"
        )
    if any(state.water is not None for state in on_mesh.sequence.states):
        notes.append("there is water in the pores: all stresses are effective stresses")
    notes += _turned_notes(on_mesh)
    notes += _conformity_notes(on_mesh)
    notes += _duplicate_notes(on_mesh)
    notes += _hanging_notes(on_mesh)
    notes += _odd_notes(on_mesh, in_tension=in_tension)
    notes += yield_notes(case)
    notes += structure_notes(on_mesh)
    return notes


def _tangle_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Elements that are present together and lie on the same side of the face that they share."""
    mesh, sequence = on_mesh.mesh, on_mesh.sequence
    pairs = overlapping(mesh, on_mesh.table)
    states = range(len(sequence.states))
    together = np.zeros(len(pairs), dtype=np.bool_)
    for present in {sequence.present(n).tobytes(): sequence.present(n) for n in states}.values():
        together |= present[pairs].all(axis=1)
    pairs = pairs[together]
    if not len(pairs):
        return []
    members = [element_number(mesh, int(e)) for e in pairs.ravel()]
    named = [f"{a} and {b}" for a, b in zip(members[::2], members[1::2], strict=True)][:_NAMED]
    more = f" and {len(pairs) - _NAMED} more pairs" if len(pairs) > _NAMED else ""
    one, other = (nodes_in(mesh.blocks, np.array([e])) for e in pairs[0])
    nodes = np.intersect1d(one, other)
    turned = np.isin(members, on_mesh.turned).any()
    why = ", after some were turned that had their nodes clockwise" if turned else ""
    message = (
        f"the mesh is tangled: elements {', '.join(named)}{more} lie on the same side of the face "
        f"that they share{why} (the first near {format_point(mesh.points[nodes].mean(axis=0))})"
    )
    hint = "look at the mesh there: a node in the wrong place, or two parts on top of each other"
    return [Fault("tangled-mesh", message, hint, Location(mesh.file))]


def _turned_notes(on_mesh: CaseOnMesh) -> list[str]:
    """Which elements were turned."""
    turned = on_mesh.turned
    if not len(turned):
        return []
    way = "clockwise" if on_mesh.mesh.dim == 2 else "inside out"
    if len(turned) == on_mesh.mesh.n_elements:
        return [f"all elements of the mesh are numbered {way}; they were turned"]
    named = ", ".join(str(n) for n in turned[:_NAMED])
    more = f" and {len(turned) - _NAMED} more" if len(turned) > _NAMED else ""
    which = f"elements {named}{more} are" if len(turned) > 1 else f"element {named} is"
    return [f"{which} numbered {way}, other than the rest; they were turned"]


def _duplicate_notes(on_mesh: CaseOnMesh) -> list[str]:
    """Where nodes of different elements stand at one place, so that the ground can part there."""
    pairs = coinciding_nodes(on_mesh.mesh)
    if not len(pairs):
        return []
    n, place = len(pairs), format_point(on_mesh.mesh.points[pairs[0, 0]])
    what = (
        f"{n} pairs of nodes stand at one place each" if n > 1 else "two nodes stand at one place"
    )
    return [
        f"{what} ({'the first ' if n > 1 else ''}near {place}): elements "
        "that do not share a node are not tied there and can part or overlap; if no slit is meant, "
        "merge them (gmsh: Coherence Mesh)"
    ]


def _hanging_notes(on_mesh: CaseOnMesh) -> list[str]:
    """Where nodes stand on elements that do not have them."""
    mesh = on_mesh.mesh
    nodes = hanging_nodes(mesh, on_mesh.table)
    if not len(nodes):
        return []
    n, place = len(nodes), format_point(mesh.points[nodes[0]])
    what = f"{n} nodes stand" if n > 1 else "a node stands"
    return [
        f"{what} inside the side of an element that does not have {'them' if n > 1 else 'it'} "
        f"({'the first ' if n > 1 else ''}near {place}): the elements are not tied there and can "
        "part or overlap; let neighbours share whole sides (gmsh: fragment or Coherence before "
        "meshing)"
    ]


_NAMED = 5


def _conformity_notes(on_mesh: CaseOnMesh) -> list[str]:
    """Where elements touch without sharing a face."""
    centres = nonconforming(on_mesh.mesh, on_mesh.table)
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


def _odd_notes(on_mesh: CaseOnMesh, *, in_tension: bool) -> list[str]:
    """What is allowed, and seldom meant."""
    case, notes = on_mesh.case, []
    densities = [case.materials[name].density for name in on_mesh.sequence.materials]
    if case.gravity is not None and all(density == Scalar(0.0) for density in densities):
        notes.append("there is gravity, but no material has a density: nothing weighs")
    if said := suspected_unit(on_mesh.mesh.points.min(axis=0), on_mesh.mesh.points.max(axis=0)):
        notes.append(said)
    if in_tension:
        notes.append(
            "at the start values the virgin ground is in tension: stresses are positive in "
            "tension, the vertical stress of Heim's model is positive in compression"
        )
    return notes


def _field_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Measured values of fields at points that are not in their material."""
    return field_faults(on_mesh.case, on_mesh.not_in)


def _group_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """What names groups that the mesh lacks, or asks of a section what it cannot do."""
    return [
        *revolution_faults(on_mesh),
        *section_faults(on_mesh.case),
        *yield_faults(on_mesh.case),
        *group_faults(on_mesh),
        *support_faults(on_mesh),
        *load_faults(on_mesh),
        *surface_faults(on_mesh),
        *structure_faults(on_mesh),
    ]


def _refuse_mechanisms(on_mesh: CaseOnMesh) -> None:
    """Refuse states without ground, and with pieces that can move freely.

    Raises:
        InputError: no ground is present at a stage.
        ModelError: a piece of the ground can move freely.
    """
    mesh, sequence, source = on_mesh.mesh, on_mesh.sequence, on_mesh.case.source
    fixed = fixed_dofs(on_mesh)
    checked = set()
    for n, state in enumerate(sequence.states):
        present = sequence.present(n)
        if present.tobytes() in checked:
            continue
        checked.add(present.tobytes())
        if not present.any():
            msg = f"at stage '{state.name}' no ground is present"
            raise InputError([Fault("no-ground", msg, "see 'groups'", Location(mesh.file))])
        loose = loose_body(mesh, on_mesh.table, on_mesh.kinematics, present, fixed)
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

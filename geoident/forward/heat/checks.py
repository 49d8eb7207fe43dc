"""Whether heat can flow in a case on its mesh where its keys say so."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from geoident.errors import Fault
from geoident.fem.faces import free_patches
from geoident.forward.heat.conduction import given_nodes
from geoident.forward.stages import CaseOnMesh
from geoident.model.case import Case, KeyPath
from geoident.model.heat import HeatFace
from geoident.model.mesh import nodes_in
from geoident.model.parameter import Values


@dataclass(frozen=True)
class _Said:
    """Where a case says what heat flows through a group, and from which state on."""

    path: KeyPath
    name: str
    face: HeatFace
    state: int


def heat_group_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Groups that the mesh does not have, and an exchange where there is no area."""
    mesh, faults = on_mesh.mesh, list[Fault]()
    known = {**mesh.facet_groups, **mesh.node_groups}
    for said in _all(on_mesh.case):
        if said.name not in {**known, **mesh.groups}:
            named = f"group '{said.name}'"
            faults.append(
                on_mesh.missing_group(said.path, named, "groups of faces and nodes", known)
            )
        elif said.face.film is not None and said.name not in mesh.facet_groups:
            what = "nodes" if said.name in mesh.node_groups else "elements"
            faults.append(
                on_mesh.case.source.fault(
                    (*said.path, "film"),
                    "no-area",
                    f"heat is exchanged through an area, and '{said.name}' is a group of {what}",
                    "Name a group of faces, or remove 'film': the nodes have the temperature.",
                )
            )
    return faults


def heat_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Faces and nodes through which no heat ever flows."""
    return [*_nowhere(on_mesh)] if on_mesh.case.conducts else []


def inadmissible_heat(case: Case, name: str, values: Values) -> str | None:
    """Why the heat of a material is not admissible, a sentence; None if it is."""
    material = case.materials[name]
    numbers = {
        "conductivity": material.conductivity,
        "heat capacity": material.heat_capacity,
        "specific heat": material.specific_heat,
    }
    for what, scalar in numbers.items():
        if scalar is not None and not scalar.value(values) > 0.0:
            return f"the {what} of {name} is {scalar.value(values):.4g}, it must be positive"
    breach = None if material.hydration is None else material.hydration.breach(values)
    return None if breach is None else f"of {name} {breach}"


def inadmissible_film(case: Case, values: Values) -> str | None:
    """Why an exchange is not admissible, a sentence; None if all are."""
    for said in _all(case):
        film = said.face.film
        if film is not None and not film.value(values) >= 0.0:
            return f"the film of {said.name} is {film.value(values):.4g} W/m2K, it must be positive"
    return None


def _nowhere(on_mesh: CaseOnMesh) -> Iterator[Fault]:
    mesh, sequence = on_mesh.mesh, on_mesh.sequence
    for said in _all(on_mesh.case):
        states = [
            n
            for n, state in enumerate(sequence.states)
            if state.heat.get(said.name) is said.face and n
        ]
        if any(_touches(on_mesh, said, state) for state in states) or not states:
            continue
        message = f"no ground is at '{said.name}' while heat would flow there"
        hint = "Correct the name of the group, or say it from the stage on that places the ground."
        if said.face.film is not None and said.name in mesh.facet_groups:
            message = f"'{said.name}' is no free face while it would exchange heat"
            hint = "An exchange with air or water needs faces with ground on one side only."
        yield on_mesh.case.source.fault(said.path, "no-area", message, hint)


def _touches(on_mesh: CaseOnMesh, said: _Said, state: int) -> bool:
    """Whether heat flows through a group at a state."""
    mesh, present = on_mesh.mesh, on_mesh.sequence.present(state)
    if said.face.film is not None:
        return bool(free_patches(mesh, on_mesh.table, said.name, present))
    nodes = given_nodes(on_mesh, said.name, said.state, state)
    return bool(np.isin(nodes, nodes_in(mesh.blocks, present)).any())


def _all(case: Case) -> Iterator[_Said]:
    """Everything that a case says of heat through groups."""
    places: list[tuple[KeyPath, Mapping[str, HeatFace | None]]] = [(("heat",), case.heat)]
    places += [(("stages", n, "heat"), stage.heat) for n, stage in enumerate(case.stages)]
    for state, (path, faces) in enumerate(places):
        for name, face in faces.items():
            if face is not None:
                yield _Said((*path, name), name, face, state)

"""Interfaces in the sequence of stages: where their points are, and when they stand.

The faces of an interface are sorted by the two groups of the ground at their sides: a *part* stands
as long as both are there. What is placed free of stress begins without traction there; what both
have since the virgin state begins with the traction of the in-situ stress on the face.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.errors import Fault
from geoident.fem.faces import load_faces
from geoident.fem.interfaces import JointPoints, joint_points
from geoident.forward.stages import CaseOnMesh, ConstructionState, listed
from geoident.model.case import Case, KeyPath
from geoident.model.interfaces import Interface
from geoident.model.parameter import Scalar, Values
from geoident.model.structures import Beam, Shell


@dataclass(frozen=True, eq=False)
class InterfacePart:
    """Those faces of an interface that lie between two groups.

    Args:
        name: of the interface, with the two groups if it has several parts.
        interface: its name.
        given: what the case says of it.
        groups: the indices of the two groups, ascending; one twice if it is on both sides.
        points: its points.
    """

    name: str
    interface: str
    given: Interface
    groups: tuple[int, int]
    points: JointPoints

    def stands(self, state: ConstructionState) -> bool:
        """Whether the ground of both sides is there."""
        return all(group in state.materials for group in self.groups)


def interface_parts(on_mesh: CaseOnMesh) -> list[InterfacePart]:
    """All parts of interfaces that ever stand."""
    parts, sequence = [], on_mesh.sequence
    for name, given in on_mesh.case.interfaces.items():
        faces = on_mesh.joints.get(given.along, ())
        pairs = [np.sort(sequence.group_of[one.elements], axis=1) for one in faces]
        of_name = []
        for first, second in np.unique(np.concatenate([np.empty((0, 2), int), *pairs]), axis=0):
            between = (int(first), int(second))
            if not any(set(between) <= state.materials.keys() for state in sequence.states):
                continue
            own = [
                one.of((pair == between).all(axis=1))
                for one, pair in zip(faces, pairs, strict=True)
                if (pair == between).all(axis=1).any()
            ]
            points = joint_points(on_mesh.mesh, own, on_mesh.kinematics)
            sides = f"{name} ({sequence.groups[between[0]]}/{sequence.groups[between[1]]})"
            of_name.append((sides, between, points))
        parts += [
            InterfacePart(sides if len(of_name) > 1 else name, name, given, between, points)
            for sides, between, points in of_name
        ]
    return parts


def interface_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Interfaces whose group the mesh lacks, or that have no ground on both sides."""
    case, mesh, faults = on_mesh.case, on_mesh.mesh, []
    shell = next((n for n, one in case.structures.items() if isinstance(one, Shell)), None)
    if case.interfaces and shell is not None:
        message = "shells and interfaces in one case are not computed yet"
        hint = "Leave out the interfaces, or model the lining by elements."
        return [
            case.source.fault(
                ("structures", shell), code="beside-interface", message=message, hint=hint
            )
        ]
    for name, given in case.interfaces.items():
        path: KeyPath = ("interfaces", name, "along")
        what = "edges" if mesh.dim == 2 else "surfaces"
        if given.along not in mesh.facet_groups:
            wanted = f"group '{given.along}' of {what}"
            faults.append(
                on_mesh.missing_group(path, wanted, f"groups of {what}", mesh.facet_groups)
            )
        elif not on_mesh.joints.get(given.along):
            message = f"the group '{given.along}' has no ground on both sides anywhere"
            hint = f"An interface lies inside the mesh; its {what}: {listed(mesh.facet_groups)}."
            faults.append(case.source.fault(path, code="no-interface", message=message, hint=hint))
    return faults or _unsupported(on_mesh)


def _unsupported(on_mesh: CaseOnMesh) -> list[Fault]:
    """What cases with interfaces do not have yet."""
    case, sequence, faults = on_mesh.case, on_mesh.sequence, []

    def refuse(path: KeyPath, message: str, hint: str) -> None:
        fault = case.source.fault(path, code="beside-interface", message=message, hint=hint)
        faults.append(fault)

    if not case.interfaces:
        return []
    if case.conducts:
        message = "heat that is conducted across interfaces is not computed yet"
        refuse(("interfaces",), message, "Leave out the interfaces, or 'heat' of the ground.")
    for name, material in case.materials.items():
        if material.soil is not None:
            message = f"interfaces beside {material.soil.description} are not computed yet"
            refuse(("materials", name, "yield"), message, "Use 'mohr-coulomb', or no interfaces.")
    along = {given.along for given in case.interfaces.values()}
    for name, structure in case.structures.items():
        if isinstance(structure, Beam) and _shares(on_mesh, structure.group, along):
            message = (
                f"the structure '{name}' lies on an interface: between which sides is not said"
            )
            hint = "Model the wall by elements with an interface on each side, or move one of both."
            refuse(("structures", name, "on"), message, hint)
    beside = {
        int(group)
        for faces in on_mesh.joints.values()
        for one in faces
        for group in sequence.group_of[one.elements].ravel()
    }
    for n, state in enumerate(sequence.states[1:]):
        partly = {g for g, part in state.release.items() if part != Scalar(1.0)} & beside
        for group in sorted(partly & state.leaving) if case.consolidates else ():
            name = sequence.groups[group]
            message = (
                f"'{name}' borders on an interface, its stress is released in parts, and water "
                "takes time to leave the ground, which is not computed together yet"
            )
            hint = "Excavate it whole, without 'release' or 'distance'; or move the interface."
            refuse(("stages", n), message, hint)
    return faults


def _shares(on_mesh: CaseOnMesh, group: str, along: set[str]) -> bool:
    """Whether a group of lines has faces of an interface."""
    mesh, table = on_mesh.mesh, on_mesh.table
    if group not in mesh.facet_groups:
        return False
    cut = [load_faces(mesh, table, name) for name in sorted(along & mesh.facet_groups.keys())]
    return bool(np.isin(load_faces(mesh, table, group), np.concatenate(cut)).any())


def inadmissible_interface(case: Case, values: Values) -> str | None:
    """Which number of an interface is impossible at parameter values, or None."""
    for name, given in case.interfaces.items():
        reason = given.breach(values)
        if reason:
            return f"of the interface '{name}' {reason}"
    return None

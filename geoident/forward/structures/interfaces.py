"""Interfaces in the sequence of stages: where their points are, and when they stand.

The faces of an interface are sorted by the two groups of the ground at their sides: a *part* stands
as long as both are there. What is placed free of stress begins without traction there; what both
have since the virgin state begins with the traction of the in-situ stress on the face.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from geoident.errors import Fault
from geoident.fem.interfaces import JointFaces, JointPoints, joint_points
from geoident.forward.stages import CaseOnMesh, ConstructionState, listed
from geoident.model.case import Case, KeyPath
from geoident.model.interfaces import Interface
from geoident.model.parameter import Values
from geoident.model.structures import Beam, Shell


@dataclass(frozen=True, eq=False)
class InterfacePart:
    """Those faces of an interface that lie between two groups.

    Args:
        name: of the interface, with the two groups if it has several parts.
        interface: its name.
        given: what the case says of it.
        groups: the indices of the two groups, ascending; one twice if it is on both sides. Beside
            a beam that of the own side first.
        points: its points.
        beams: the structures that are between the two sides; then it holds one side and these.
    """

    name: str
    interface: str
    given: Interface
    groups: tuple[int, int]
    points: JointPoints
    beams: frozenset[str] = frozenset()

    @property
    def beside(self) -> tuple[int, ...]:
        """The groups that it touches: of one side beside a beam."""
        return self.groups[:1] if self.beams else self.groups

    def stands(self, state: ConstructionState) -> bool:
        """Whether what it holds together is there: of beams the ground beyond them stands for it.

        Before a wall is built its nodes hang between the interfaces of both sides.
        """
        own, other = (group in state.materials for group in self.groups)
        return own and (other or not self.beams.isdisjoint(state.structures))

    def is_limited(self, state: ConstructionState) -> bool:
        """Whether its limits hold: where a wall comes to stand nothing parts the ground before."""
        return not self.beams or not self.beams.isdisjoint(state.structures)


def beams_on(case: Case, faces: JointFaces) -> frozenset[str]:
    """The structures that are between the two sides of some faces."""
    structures = case.structures.items()
    return frozenset(
        name
        for name, one in structures
        if isinstance(one, Beam | Shell) and one.group in faces.beams
    )


def interface_parts(on_mesh: CaseOnMesh) -> list[InterfacePart]:
    """All parts of interfaces that ever stand."""
    parts, sequence = [], on_mesh.sequence
    for name, given in on_mesh.case.interfaces.items():
        own: dict[tuple[frozenset[str], tuple[int, int]], list[JointFaces]] = {}
        for faces in on_mesh.joints.get(given.along, ()):
            beams = beams_on(on_mesh.case, faces)
            pairs = sequence.group_of[faces.elements]
            pairs = pairs[:, [faces.side, 1 - faces.side]] if beams else np.sort(pairs, axis=1)
            for first, second in np.unique(pairs, axis=0).tolist():
                some = faces.of((pairs == (first, second)).all(axis=1))
                own.setdefault((beams, (first, second)), []).append(some)
        of_name = []
        for (beams, groups), some_faces in sorted(own.items(), key=lambda one: one[0][1]):
            sides = f"{name} ({'/'.join(sequence.groups[group] for group in groups)})"
            points = joint_points(on_mesh.mesh, some_faces, on_mesh.kinematics)
            part = InterfacePart(sides, name, given, groups, points, beams)
            if any(part.stands(state) for state in sequence.states):
                of_name.append(part)
        parts += of_name if len(of_name) > 1 else [replace(part, name=name) for part in of_name]
    return parts


def interface_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Interfaces whose group the mesh lacks, or that have no ground on both sides."""
    case, mesh, faults = on_mesh.case, on_mesh.mesh, []
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
            faults.append(case.source.fault(path, "no-interface", message, hint))
    return faults


def inadmissible_interface(case: Case, values: Values) -> str | None:
    """Which number of an interface is impossible at parameter values, or None."""
    for name, given in case.interfaces.items():
        reason = given.breach(values)
        if reason:
            return f"of the interface '{name}' {reason}"
    return None

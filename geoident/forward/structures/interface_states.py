"""Collects tractions, openings and slips of interfaces during an analysis."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from geoident.forward.stages import ConstructionSequence
from geoident.forward.structures.interface_limits import coulomb_cone
from geoident.forward.structures.interfaces import InterfacePart
from geoident.forward.structures.members import Structures
from geoident.model.arrays import Bools, Floats
from geoident.model.dual import ParameterPoint
from geoident.model.interfaces import Interface
from geoident.model.parameter import Values
from geoident.model.results.interfaces import InterfaceStates

_AT_LIMIT = 1e-7
"""Of the tractions and strengths at work: how far off its limit one may be that is on it."""

_STRAIGHT = 0.95
"""Length of the mean of unit normals from which on a wall has its ground in one direction."""


class InterfaceRecorder:
    """Records the jumps of interfaces since both sides are there, and their tractions.

    Args:
        structures: the interfaces among them.
        sequence: the states of construction.
        values: parameters by name, SI.
    """

    def __init__(
        self, structures: Structures, sequence: ConstructionSequence, values: Values
    ) -> None:
        self._structures, self._sequence = structures, sequence
        self._parts = structures.joints
        self._point = ParameterPoint(values, ())
        self._moved: list[Floats] = []
        """(n_rows,) jumps of the displacements since the sides were placed, by state."""
        self._begun: list[Floats] = []
        """(n_rows,) those with which the interfaces began."""
        self._tables: list[Floats] = []

    def add(self, number: int, u: Floats, members: Floats) -> None:
        """Record a state.

        Args:
            number: of the state.
            u: (n_dofs,) displacements since placing, m.
            members: (n_rows,) forces in structures, Pa.
        """
        state = self._sequence.states[number]
        moved = self._structures.strain(u)
        begun = np.zeros(len(moved))
        if number:
            anew = self._structures.begins_anew(state)
            begun = np.where(anew, self._moved[state.base], self._begun[state.base])
        self._moved.append(moved)
        self._begun.append(begun)
        tables = []
        for part in self._parts:
            assert part.joint is not None
            n = len(part.members)
            traction = members[part.rows].reshape(-1, n)
            jump = (moved - begun)[part.rows].reshape(-1, n)
            table = np.stack(
                [
                    traction[0],
                    _along(traction),
                    jump[0],
                    _along(jump),
                    *self._limits(part.joint.given, traction, part.joint.is_limited(state)),
                ]
            )
            nothing = ~part.joint.points.parted | (not part.stands(state))
            table[:4, nothing], table[4:, nothing] = np.nan, 0.0
            tables.append(table)
        self._tables.append(np.concatenate(tables, axis=1))

    def _limits(self, given: Interface, traction: Floats, limited: bool) -> tuple[Bools, Bools]:
        """(n,) where tractions (dim, n) are at the limit of shear, and at that of tension."""
        count = traction.shape[1]
        if not (limited and given.yields and np.isfinite(traction).all()):
            return np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
        law = coulomb_cone(given, self._point, len(traction) - 1)
        slips, parts = law.excess(traction) >= -_AT_LIMIT * law.scale(traction)
        return slips & ~parts, parts

    def table(self) -> InterfaceStates | None:
        """All that was recorded, without the virgin state; None without interfaces."""
        if not self._parts:
            return None
        table = np.stack(self._tables[1:], axis=-1)
        names: list[str] = []
        faces, count = [], dict[str, int]()
        joints = [part.joint for part in self._parts if part.joint is not None]
        for joint in joints:
            name, face = joint.interface, joint.points.face
            faces.append(1 + count.get(name, 0) + face)
            count[name] = count.get(name, 0) + int(face.max()) + 1
            names += [name] * len(face)
        points = [joint.points for joint in joints]
        return InterfaceStates(
            interfaces=tuple(names),
            sides=_sides(joints),
            faces=np.concatenate(faces),
            stages=tuple(state.name for state in self._sequence.states[1:]),
            points=np.concatenate([one.position for one in points]),
            normals=np.concatenate([one.normal for one in points]),
            areas=np.concatenate([one.members.weight[: len(one.face)] for one in points]),
            normal_traction=table[0],
            shear_traction=table[1],
            opening=table[2],
            slip=table[3],
            slips=table[4] > 0.0,
            parts=table[5] > 0.0,
        )


def _sides(joints: Sequence[InterfacePart]) -> tuple[str, ...]:
    """Where the ground of each point is, seen from the beam or shell; see `InterfaceStates`."""
    names = np.concatenate([np.full(len(one.points.face), one.interface) for one in joints])
    points = [one.points for one in joints]
    touches, normals, positions = (
        np.concatenate([getattr(one, key) for one in points])
        for key in ("touches", "normal", "position")
    )
    sides = np.full(len(names), "", dtype="<U7")
    for name, other in product(dict.fromkeys(names.tolist()), (False, True)):
        own = np.flatnonzero((names == name) & (touches == [not other, other]).all(axis=1))
        if not len(own):
            continue
        towards = normals[own] * (1.0 if other else -1.0)
        mean = towards.mean(axis=0)
        axis = int(np.argmax(np.abs(mean)))
        if np.linalg.norm(mean) > _STRAIGHT:
            sides[own] = f"{'-+'[int(mean[axis] > 0.0)]}{'xyz'[axis]}"
        else:
            out = ((positions[own] - positions[own].mean(axis=0)) * towards).sum() > 0.0
            sides[own] = "outside" if out else "inside"
    return tuple(sides.tolist())


def _along(components: Floats) -> Floats:
    """(n,) the component along a line of (2, n), or the size along a face of (3, n)."""
    return np.asarray(components[1] if len(components) == 2 else np.hypot(*components[1:]))

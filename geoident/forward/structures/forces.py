"""Collects the forces in linings and bolts during an analysis."""

from __future__ import annotations

import numpy as np

from geoident.forward.stages import ConstructionSequence, ConstructionState
from geoident.forward.structures.members import StructureMembers, Structures, bar_share
from geoident.model.arrays import Floats
from geoident.model.dual import ParameterPoint
from geoident.model.parameter import Values
from geoident.model.results.result import MemberForces
from geoident.model.structures import Bars, Beam


class MemberRecorder:
    """Turns the member forces q = (N, M at mid-length, Q) into forces at the ends, by state.

    Args:
        structures: linings and bolts.
        sequence: the states of construction.
        values: parameters by name, SI.
    """

    def __init__(
        self, structures: Structures, sequence: ConstructionSequence, values: Values
    ) -> None:
        self._structures = structures
        self._sequence = sequence
        self._values = values
        self._axial: list[Floats] = []
        self._moment: list[Floats] = []
        self._shear: list[Floats] = []
        self._hoop: list[Floats] = []
        self._prestress: list[Floats] = []

    def add(self, number: int, members: Floats) -> None:
        """Record the forces (n_rows, ...) at a state; column 0 of them counts."""
        state = self._sequence.states[number]
        parts, given = [], []
        for part in self._structures.parts:
            at_ends = self._at_ends(part, members[:, 0])
            parts.append(
                at_ends if part.name in state.structures else np.full_like(at_ends, np.nan)
            )
            given.append(self._given(part, state))
        table = np.concatenate(parts, axis=1)
        self._axial.append(table[0])
        self._moment.append(table[1:3])
        self._shear.append(table[3])
        self._hoop.append(table[4])
        self._prestress.append(np.concatenate(given))

    def table(self) -> MemberForces | None:
        """All that was recorded, without the virgin state; None if nothing ever stands."""
        parts = self._structures.parts
        if not parts:
            return None
        return MemberForces(
            structures=tuple(part.name for part in parts for _ in range(len(part.members))),
            numbers=np.concatenate([np.arange(1, len(part.members) + 1) for part in parts]),
            stages=tuple(state.name for state in self._sequence.states[1:]),
            ends=np.concatenate([part.members.ends for part in parts]),
            axial=np.stack(self._axial[1:], axis=-1),
            moment=np.stack(self._moment[1:], axis=-1).swapaxes(0, 1),
            shear=np.stack(self._shear[1:], axis=-1),
            hoop=np.stack(self._hoop[1:], axis=-1),
            prestress=np.stack(self._prestress[1:], axis=-1),
            per_metre=np.concatenate(
                [np.full(len(part.members), isinstance(part.structure, Beam)) for part in parts]
            ),
        )

    def _at_ends(self, part: StructureMembers, forces: Floats) -> Floats:
        """N, M at the first and second end, Q, N_t: (5, n_members); of a bar only N, of one bar."""
        missing = np.full(len(part.members), np.nan)
        if isinstance(part.structure, Bars):
            share = bar_share(part.structure, ParameterPoint(self._values, ())).value
            return np.stack([forces[part.rows] * share, missing, missing, missing, missing])
        section = part.section_forces(forces)
        hoop = missing if part.members.nu is None else section.hoop
        return np.stack([section.axial, section.first, section.second, section.shear, hoop])

    def _given(self, part: StructureMembers, state: ConstructionState) -> Floats:
        """Axial forces (n_members,) that a jack gives at a state, tension positive, N; else NaN."""
        force = np.nan
        if isinstance(part.structure, Bars) and part.name in state.stressed:
            force = part.structure.sense * state.stressed[part.name].value(self._values)
        return np.full(len(part.members), force)

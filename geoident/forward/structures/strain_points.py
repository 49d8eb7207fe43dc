"""Members that yield in a state, as strain points beside those of the ground.

A member is a point of weight L with the stresses (N, M, Q L / sqrt(12)) of `limits`; a bar has the
first only, and what a stress of the ground has more is zero. Rotations of beams are unknowns here:
where a beam yields they do not follow the displacements as in `fem.structures`, but are those at
which the potential of the stage is least.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.forward.structures.members import StructureMembers
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.interfaces import Interface
from geoident.model.structures import Structure

STRESSES = 3
"""Stresses of a member of a beam."""


@dataclass(frozen=True, eq=False)
class YieldingPart:
    """The members of one structure that yields.

    Args:
        name: of the structure.
        points: where they stand among those of all structures that yield.
        rows: (c, n) numbers of the rows of `Structures` that are their c stresses.
        scale: (c, n) stress per force q of a row, and strain per strain of it.
        ends: (n, 2, dim) of the members, m.
        structure: what the case says of it.
        what: it is, for a message.
    """

    name: str
    points: slice
    rows: Ints
    scale: Floats
    ends: Floats
    structure: Structure | Interface
    what: str = "the structure"


class MemberPoints:
    """Strain points of the members that yield in a state.

    Args:
        structures: those that yield and work with their stiffness.
        n_rows: of all structures.
        n_strain: components s of a strain of the ground.

    Attributes:
        parts: the structures.
        weight: (m,) of the members.
        n_turns: number of rotations.
        yields: (n_rows,) rows that are stresses of these points.
    """

    def __init__(self, structures: Sequence[StructureMembers], n_rows: int, n_strain: int) -> None:
        parts: list[YieldingPart] = []
        motions, turns, weights = [], [], []
        first = 0
        for one in structures:
            members, n = one.members, len(one.members)
            rows = np.arange(one.rows.start, one.rows.stop).reshape(-1, n)
            scale = np.ones(rows.shape)
            motion, turning = members.operator, sp.csr_array((len(members.weight), 0))
            if members.turning is not None:
                scale[2] = members.length / np.sqrt(12.0)
                motion, turning = members.turning.motion, members.turning.turns
            by = sp.diags_array(scale.ravel())
            what = "the structure" if one.joint is None else "the interface"
            own = slice(first, first + n)
            parts.append(
                YieldingPart(one.name, own, rows, scale, members.ends, one.structure, what)
            )
            motions.append(sp.csr_array(by @ motion))
            turns.append(sp.csr_array(by @ turning))
            weights.append(members.weight[:n])
            first += n
        self.parts, self._n_strain = tuple(parts), n_strain
        self.weight = np.concatenate(weights)
        self.n_turns = sum(one.shape[1] for one in turns)
        self.yields: Bools = np.zeros(n_rows, dtype=bool)
        for part in parts:
            self.yields[part.rows] = True
        order = self._by_component()
        self.motion = sp.csr_array(order @ sp.csr_array(sp.vstack(motions)))
        self.turns = sp.csr_array(order @ sp.csr_array(sp.block_diag(turns)))

    def __len__(self) -> int:
        return len(self.weight)

    def _by_component(self) -> sp.csr_array:
        """(3 m, rows): the rows of structure after structure, as rows of one component of all."""
        m = len(self)
        place = [
            (np.arange(len(part.rows))[:, None] * m + np.arange(m)[part.points]).ravel()
            for part in self.parts
        ]
        where = np.concatenate(place)
        entries = (np.ones(len(where)), (where, np.arange(len(where))))
        return sp.csr_array(entries, shape=(STRESSES * m, len(where)))

    def strain(self, u: Floats, turns: Floats) -> Floats:
        """Strains (s, m, ...) of displacements (n_dofs, ...) and rotations (n_turns, ...)."""
        rows = np.asarray(self.motion @ u + self.turns @ turns)
        return self._filled(rows.reshape(STRESSES, len(self), *u.shape[1:]))

    def forces(self, stress: Floats, weight: Floats) -> tuple[Floats, Floats]:
        """Forces (n_dofs, ...) and moments (n_turns, ...) of stresses (s, m, ...)."""
        weighted = stress[:STRESSES] * weight.reshape(-1, *(1,) * (stress.ndim - 2))
        rows = weighted.reshape(STRESSES * len(self), *stress.shape[2:])
        return np.asarray(self.motion.T @ rows), np.asarray(self.turns.T @ rows)

    def of_rows(self, rows: Floats) -> Floats:
        """Stresses or strains (s, m, k) of forces q or strains (n_rows, k) of all structures."""
        result = np.zeros((STRESSES, len(self), rows.shape[1]))
        for part in self.parts:
            result[: len(part.rows), part.points] = rows[part.rows] * part.scale[..., None]
        return self._filled(result)

    def into_rows(self, stress: Floats, rows: Floats) -> None:
        """Write stresses (s, m, k) into the forces q (n_rows, k) of all structures."""
        for part in self.parts:
            of_part = stress[: len(part.rows), part.points]
            rows[part.rows] = of_part / part.scale[..., None]

    def _filled(self, components: Floats) -> Floats:
        """(s, m, ...) of the three components (3, m, ...) of a beam."""
        result = np.zeros((self._n_strain, *components.shape[1:]))
        result[:STRESSES] = components
        return result

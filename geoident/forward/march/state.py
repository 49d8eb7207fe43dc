"""What travels through the march: stress and forces carried, one stage to be solved, its end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from geoident.forward.ground_at import GroundAt
from geoident.forward.march.systems import StageSystem
from geoident.forward.stages import ConstructionState, Index
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import ParameterPoint


@dataclass(frozen=True)
class UnitForces:
    """Forces along the readings, beside those of the case.

    Args:
        forces: (n_dofs, g) unit force along each reading, N.
        active: (n_states, g) how it acts in each state: 1, not at all, 0, or against it, -1.
        multipliers: (g,) the forces act on the state, so many times; None: each unit force has a
            further column, which carries its response.
    """

    forces: Floats
    active: Floats
    multipliers: Floats | None = None

    @property
    def n_columns(self) -> int:
        """Number of further columns."""
        return 0 if self.multipliers is not None else int(self.forces.shape[1])

    def add_to(self, forces: Floats, state: int) -> None:
        """Add to the forces (n_dofs, 1 + n + k) of a state."""
        if self.multipliers is not None:
            forces[:, 0] += self.forces @ (self.active[state] * self.multipliers)
        elif self.n_columns:
            forces[:, -self.n_columns :] = self.forces * self.active[state]


@dataclass(frozen=True)
class StageEnd:
    """The state of equilibrium at the end of a stage. Arrays are the march's own: copy to keep.

    Args:
        state: index of the state.
        u: (n_dofs, 1 + n + k) displacements since placing, m, and their derivatives.
        stress: (n_strain, n_points, 1 + n + k), Pa.
        members: (n_rows, 1 + n + k) forces in linings and bolts (`structures`).
        yielded: (n_points,) strain points that flow plastically in this state.
    """

    state: int
    u: Floats
    stress: Floats
    members: Floats
    yielded: Bools


@dataclass(frozen=True)
class Carried:
    """What ground and structures carry from one stage to the next, changed in place.

    Args:
        stress: (n_strain, n_points, k), Pa.
        members: (n_rows, k) forces in linings and bolts.
        hardened: material to the multipliers (y, n_points, k) of its planes so far, where they
            count because it hardens.
    """

    stress: Floats
    members: Floats
    hardened: dict[str, Floats] = field(default_factory=dict)

    def columns(self, part: slice) -> Carried:
        """Some of its columns, not copied."""
        return Carried(self.stress[..., part], self.members[:, part])

    def clear(self, points: Bools | Ints | slice) -> None:
        """Points (n_points,), or (k,) by number, that are gone or placed anew carry nothing.

        They have not hardened either.
        """
        self.stress[:, points] = 0.0
        for multipliers in self.hardened.values():
            multipliers[:, points] = 0.0

    def multipliers(self, material: str, points: Index, columns: slice | int) -> Floats | None:
        """Multipliers so far (y, q, ...); None for none.

        Args:
            material: its name.
            points: (q,) strain points.
            columns: of what is carried.
        """
        found = self.hardened.get(material)
        return None if found is None else found[:, points, columns]

    def add_multipliers(self, material: str, points: Index, columns: slice, more: Floats) -> None:
        """Add multipliers of a material that hardens.

        Args:
            material: its name.
            points: (q,) strain points.
            columns: c of what is carried.
            more: (y, q, c) what is added.
        """
        if material not in self.hardened:
            shape = (more.shape[0], *self.stress.shape[1:])
            self.hardened[material] = np.zeros(shape)
        self.hardened[material][:, points, columns] += more

    def copy(self) -> Carried:
        """A copy of its own."""
        hardened = {name: values.copy() for name, values in self.hardened.items()}
        return Carried(self.stress.copy(), self.members.copy(), hardened)

    def restore(self, kept: Carried) -> None:
        """Take over the values of a copy."""
        self.stress[:], self.members[:] = kept.stress, kept.members
        self.hardened.clear()
        self.hardened.update({name: values.copy() for name, values in kept.hardened.items()})


class BaseStates:
    """Keeps what later states build on, as long as they need it, and no longer.

    Args:
        states: of the march.
    """

    def __init__(self, states: Sequence[ConstructionState]) -> None:
        self._bases = [state.base for state in states]
        self._last_use = {base: n for n, base in enumerate(self._bases) if base != n - 1}
        self._kept: dict[int, tuple[Floats, Carried]] = {}

    def go_to(self, state: int, u: Floats, carried: Carried) -> None:
        """Put the displacements and stresses in place on which a state builds.

        Args:
            state: index of the state.
            u: (n_dofs, 1 + n + k), overwritten.
            carried: overwritten.
        """
        base = self._bases[state]
        if base == state - 1 or state == 0:
            return
        u[:], kept = self._kept[base]
        carried.restore(kept)
        if self._last_use[base] == state:
            del self._kept[base]

    def leave(self, state: int, u: Floats, carried: Carried) -> None:
        """Copy them where a later state builds on this one, but not the next.

        Args:
            state: index of the state.
            u: (n_dofs, 1 + n + k).
            carried: at its end.
        """
        if self._last_use.get(state, -1) > state:
            self._kept[state] = u.copy(), carried.copy()


@dataclass(frozen=True)
class StageTask:
    """One stage to be solved.

    Args:
        number: of the state.
        system: its equations.
        state: what is there.
        point: the parameters, and those to differentiate by.
        ground: moduli and yield laws there.
        carried: before the stage, without what left; thermal strains are in it. Changed in place.
        forces: (n_dofs, 1 + n + k).
        moduli: (n_rows, 1 + n) of structures.
        thermal: (n_points, 1 + n) normal strains, or None.
    """

    number: int
    system: StageSystem
    state: ConstructionState
    point: ParameterPoint
    ground: GroundAt
    carried: Carried
    forces: Floats
    moduli: Floats
    thermal: Floats | None

    @property
    def n(self) -> int:
        """Number of parameters to differentiate by."""
        return len(self.point.names)

    def elasticity(self) -> dict[str, Floats]:
        """E (s, s) of every material that is there, Pa."""
        return {
            m: np.ascontiguousarray(self.ground.elasticity(m).value) for m in self.system.points_of
        }

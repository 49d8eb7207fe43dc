"""What travels through the march: forces that push, what is borne, where it stands."""

from __future__ import annotations

from dataclasses import dataclass, field

from geoident.model.arrays import Bools, Floats, Ints


@dataclass(frozen=True)
class Push:
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
class Standing:
    """Where the march stands at the end of a state. Arrays are the march's own: copy to keep.

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
class Borne:
    """What ground and structures bear, changed in place.

    Args:
        stress: (n_strain, n_points, k), Pa.
        members: (n_rows, k) forces in linings and bolts.
        hardened: material to the multipliers (y, n_points, k) of its planes so far, where they
            count because it hardens.
    """

    stress: Floats
    members: Floats
    hardened: dict[str, Floats] = field(default_factory=dict)

    def columns(self, part: slice) -> Borne:
        """Some of its columns, not copied."""
        return Borne(self.stress[..., part], self.members[:, part])

    def clear(self, points: Bools | Ints | slice) -> None:
        """Strain points that are gone or placed anew bear nothing and have not hardened."""
        self.stress[:, points] = 0.0
        for multipliers in self.hardened.values():
            multipliers[:, points] = 0.0

    def copy(self) -> Borne:
        """A copy of its own."""
        hardened = {name: values.copy() for name, values in self.hardened.items()}
        return Borne(self.stress.copy(), self.members.copy(), hardened)

    def restore(self, kept: Borne) -> None:
        """Take over the values of a copy."""
        self.stress[:], self.members[:] = kept.stress, kept.members
        self.hardened.clear()
        self.hardened.update({name: values.copy() for name, values in kept.hardened.items()})

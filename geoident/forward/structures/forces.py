"""Collects the forces in linings and bolts during an analysis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoident.fem.shells import ShellMembers
from geoident.forward.stages import ConstructionSequence
from geoident.forward.structures.capacity import utilisation
from geoident.forward.structures.grouted import across_moments, bar_share
from geoident.forward.structures.limits import limits
from geoident.forward.structures.members import StructureMembers, Structures
from geoident.forward.structures.strain_points import STRESSES, MemberPoints
from geoident.model.arrays import Floats
from geoident.model.dual import ParameterPoint
from geoident.model.interfaces import Interface
from geoident.model.parameter import Values
from geoident.model.results.result import MemberForces
from geoident.model.results.shells import ShellForces, along
from geoident.model.structures import (
    Bars,
    Beam,
    GroutedBars,
    PileBending,
    PileContacts,
    PileToes,
    Shell,
)

_DIRECTIONS = np.radians(np.arange(0.0, 180.0, 5.0))
"""Of the sections of a shell, from axis 1; axis 2 is in the middle."""

_ROUNDING = 1e-9
"""Of the terms of a yield function: what is left of one that is zero."""

_AT_LIMIT = 1e-6
"""Off 1, of a utilisation at the limit: that of a member that yields."""


def members_of(part: StructureMembers) -> ShellMembers:
    """The members of a shell."""
    assert isinstance(part.members, ShellMembers)
    return part.members


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
        self._tables: list[Floats] = []
        self._parts = [
            part
            for part in structures.bars_and_beams
            if isinstance(part.structure, PileToes)
            or not isinstance(part.structure, PileContacts | PileBending)
        ]
        self._of_shells: list[list[Floats]] = []

    def add(self, number: int, members: Floats) -> None:
        """Record the forces (n_rows, ...) at a state; column 0 of them counts."""
        state = self._sequence.states[number]
        tables = []
        for part in self._parts:
            table = self._of_part(part, members[:, 0])
            if not part.stands(state):
                table[:] = np.nan
            if isinstance(part.structure, Bars) and part.stressed_in(state):
                force = state.stressed[part.given_as].value(self._values)
                table[5] = part.structure.sense * force
            tables.append(table)
        if tables:
            self._tables.append(np.concatenate(tables, axis=1))
        self._of_shells.append(
            [
                members_of(part).face_forces(members[part.rows, 0])
                * (1.0 if part.name in state.structures else np.nan)
                for part in self._structures.shells
            ]
        )

    def table(self) -> MemberForces | None:
        """All that was recorded, without the virgin state; None if nothing ever stands."""
        parts = self._parts
        if not parts:
            return None
        table = np.stack(self._tables[1:], axis=-1)
        return MemberForces(
            structures=tuple(part.name for part in parts for _ in range(len(part.members))),
            numbers=np.concatenate([np.arange(1, len(part.members) + 1) for part in parts]),
            stages=tuple(state.name for state in self._sequence.states[1:]),
            ends=np.concatenate([part.members.ends for part in parts]),
            axial=table[0],
            moment=table[1:3].swapaxes(0, 1),
            shear=table[3],
            hoop=table[4],
            prestress=table[5],
            utilisation=table[6] if np.isfinite(table[6]).any() else None,
            grout=table[7] if np.isfinite(table[7]).any() else None,
            per_metre=np.concatenate(
                [np.full(len(part.members), isinstance(part.structure, Beam)) for part in parts]
            ),
        )

    def shells(self) -> ShellForces | None:
        """The same of shells."""
        parts = self._structures.shells
        if not parts:
            return None
        after_virgin = [np.concatenate(one, axis=1) for one in self._of_shells[1:]]
        forces = np.stack(after_virgin, axis=-1)
        shells = [members_of(part) for part in parts]
        normal, moment = forces[:3].transpose(1, 0, 2), forces[3:].transpose(1, 0, 2)
        used, angle = self._used_of_shells(parts, normal, moment)
        return ShellForces(
            structures=tuple(p.name for p, s in zip(parts, shells, strict=True) for _ in s.area),
            numbers=np.concatenate([np.arange(1, len(s.area) + 1) for s in shells]),
            stages=tuple(state.name for state in self._sequence.states[1:]),
            centres=np.concatenate([s.centres for s in shells]),
            corners=np.concatenate([s.corners for s in shells]),
            axes=np.concatenate([s.face_axes for s in shells]),
            normal=normal,
            moment=moment,
            utilisation=used,
            used_angle=angle,
        )

    def _used_of_shells(
        self, parts: Sequence[StructureMembers], normal: Floats, moment: Floats
    ) -> tuple[Floats, Floats] | tuple[None, None]:
        """What `ShellForces` says of the strength of shells, by n and m (n_faces, 3, n_stages)."""
        used = np.full(normal.shape, np.nan)
        worst, first = np.full(used[:, 0].shape, np.nan), 0
        for part in parts:
            own = slice(first, first + len(members_of(part).area))
            first, shell = own.stop, part.structure
            if not isinstance(shell, Shell) or shell.compressive_strength is None:
                continue
            each = np.stack(
                [
                    utilisation(
                        along(normal[own], angle),
                        along(moment[own], angle),
                        thickness=shell.thickness.value(self._values),
                        compressive=shell.compressive_strength,
                        tensile=shell.tensile_strength,
                    )
                    for angle in _DIRECTIONS
                ]
            )
            most = each.argmax(axis=0)
            used[own] = np.stack([each[0], each[len(each) // 2], each.max(axis=0)], axis=1)
            worst[own] = np.where(np.isnan(each[0]), np.nan, _DIRECTIONS[most])
        return (None, None) if np.isnan(used).all() else (used, worst)

    def _of_part(self, part: StructureMembers, forces: Floats) -> Floats:
        """N, M at both ends, Q, N_t, N from a jack, utilisation, q of grout: (8, n_members)."""
        table = np.full((8, len(part.members)), np.nan)
        if isinstance(part.structure, Bars):
            share = bar_share(part.structure, ParameterPoint(self._values, ())).value
            each = forces[part.rows].reshape(-1, len(part.members)) * share
            table[0] = each[0]
            if isinstance(part.structure, GroutedBars):
                table[7] = each[1]
            bends = self._structures.bending_of(part)
            if bends is not None:
                assert isinstance(part.structure, GroutedBars)
                table[1:4] = self._of_pile(part, part.structure, forces[bends.rows] * share)
            return table
        section = part.section_forces(forces)
        table[:4] = section.axial, section.first, section.second, section.shear
        if part.members.nu is not None:
            table[4] = section.hoop
        beam = part.structure
        if beam.yields:
            table[6] = self._of_limits(part, forces)
        if (
            isinstance(beam, Beam)
            and beam.compressive_strength is not None
            and beam.thickness is not None
        ):
            strength = {
                "thickness": beam.thickness.value(self._values),
                "compressive": beam.compressive_strength,
                "tensile": beam.tensile_strength,
            }
            used = utilisation(table[0], np.abs(table[1:3]).max(axis=0), **strength)
            around = utilisation(table[4], np.zeros_like(used), **strength)
            table[6] = np.fmax(used, around)  # NaN is the hoop force of a lining in the plane
        return table

    def _of_pile(self, part: StructureMembers, pile: GroutedBars, moments: Floats) -> Floats:
        """M at both ends of the pieces of piles, and Q: (3, n_members).

        In the plane with signs; in a solid their sizes, whatever their directions.
        """
        at = across_moments(pile, moments)
        lengths = part.members.length.reshape(at.shape[1], -1)
        sizes = [at[..., :-1], at[..., 1:], np.diff(at, axis=2) / lengths]
        return np.stack(
            [(one[0] if len(at) == 1 else np.linalg.norm(one, axis=0)).ravel() for one in sizes]
        )

    def _of_limits(self, part: StructureMembers, forces: Floats) -> Floats:
        """The part of what a beam bears before it yields that N and M use, (n_members,).

        At the ends at which they are held against it (`limits`); 1 where it yields.
        """
        point = ParameterPoint(self._values, ())
        assert not isinstance(part.structure, Interface)
        planes = limits(part.structure, point, n_strain=STRESSES)
        stress = MemberPoints([part], self._structures.n_rows, STRESSES).of_rows(forces[:, None])
        drives = planes.normals.value @ stress[..., 0]
        bears = planes.distances.value[:, None]
        rounding = _ROUNDING * np.abs(planes.normals.value) @ np.abs(stress[..., 0])
        with np.errstate(divide="ignore", invalid="ignore"):
            used = np.where(drives <= rounding, 0.0, drives / bears)
        used = used.max(axis=0)
        return np.asarray(np.where(np.abs(used - 1.0) < _AT_LIMIT, 1.0, used))

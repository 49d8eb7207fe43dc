"""All channels of a case together: what they read, from when to when, and against which zero."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.errors import Fault
from geoident.forward.gauges.beyond_mesh import beside_fault
from geoident.forward.gauges.members import (
    member_readings,
    pressures_on_beams,
    tilts_of_beams,
)
from geoident.forward.gauges.observable import (
    MarchState,
    Observable,
    Placed,
    point_fault,
    relative_displacements,
)
from geoident.forward.gauges.strain import strains
from geoident.forward.gauges.stress import StressReadings, pore_pressures, stresses
from geoident.forward.march.stage import LinearRows
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case, format_path
from geoident.model.gauges import Channel, Reads

_WEIGHTS = {Reads.CHANGE: (1.0, -1.0), Reads.VALUE: (1.0, 0.0), Reads.VIRGIN: (0.0, 1.0)}
"""Weights of the state of a stage and of that of the zero in a reading."""

Placing = Callable[[Sequence[Channel], CaseOnMesh], Placed]

OBSERVABLES: Mapping[str, Placing] = {
    "extensometer": relative_displacements,
    "convergence": relative_displacements,
    "displacement": relative_displacements,
    "settlement": relative_displacements,
    "strain": strains,
    "stress": stresses,
    "pressure-cell": stresses,
    "piezometer": pore_pressures,
    "inclinometer": relative_displacements,
    "target": relative_displacements,
    "tilt": relative_displacements,
    "levelling": relative_displacements,
    "line-of-sight": relative_displacements,
}
"""What the gauges of a kind read in the ground."""

ON_STRUCTURES: Mapping[str, Placing] = {
    "load-cell": member_readings,
    "strain": member_readings,
    "pressure-cell": pressures_on_beams,
    "tilt": tilts_of_beams,
}
"""What they read on a structure."""


def placing_of(channel: Channel) -> Placing:
    """How a channel is placed: by its kind, where it sits, and whether points move in it."""
    if channel.structure:
        return ON_STRUCTURES[channel.kind]
    return relative_displacements if channel.terms else OBSERVABLES[channel.kind]


def reads_displacements(channel: Channel) -> bool:
    """Whether a channel reads displacements of points and nothing else."""
    return placing_of(channel) is relative_displacements and not channel.turns


@dataclass(frozen=True)
class Observation:
    """The gauges of a case on its mesh.

    Args:
        channels: names, in the order of the rows.
        parts: what is read, and by which of the channels, (g,) indices.
        zero: (n_channels,) state at which each channel reads zero; where it reads a value, the
            virgin state.
        weights: (2, n_channels) how often a reading counts the state of its stage, and that of
            its zero: 1 and -1 for a change, 1 and 0 for a value, 0 and 1 for the virgin state.
        readable: (n_states, n_channels) when it can be read.
        snapped: names of channels with a point just outside the mesh.
        reasons: why each channel cannot be read where it is zeroed and cannot, a clause.
        as_built: names of channels whose readings count from the placing of their ground on.
    """

    channels: tuple[str, ...]
    parts: tuple[tuple[Ints, Observable], ...]
    zero: Ints
    weights: Floats
    readable: Bools
    snapped: tuple[str, ...]
    reasons: tuple[str, ...]
    as_built: tuple[str, ...] = ()

    def values(self, state: MarchState) -> Floats:
        """What all channels see of a state since placing, (n_channels, 1 + n + k), SI."""
        table = np.empty((len(self.channels), state.end.u.shape[1]))
        for rows, observable in self.parts:
            table[rows] = observable.values(state)
        return table

    def coinciding(self, state: MarchState) -> tuple[str, ...]:
        """Channels that read, at a state, one of several equal principal stresses."""
        found = []
        for rows, observable in self.parts:
            if isinstance(observable, StressReadings):
                named = observable.coinciding(state)
                read = {self.channels[row] for row in rows if self._counts(row, state.end.state)}
                found += [name for name in named if name in read]
        return tuple(found)

    def _counts(self, row: int, state: int) -> bool:
        """Whether the readings of a channel are made of a state."""
        at_stage, at_zero = self.weights[:, row]
        read = self.readable[state, row] and at_stage != 0
        return bool(read or (at_zero != 0 and self.zero[row] == state))

    def readings(self, observed: Floats, rows: Ints, states: Ints) -> Floats:
        """What channels read, (..., k), of what they see.

        Args:
            observed: (n_states, n_channels, k) what all channels see of the states.
            rows: (...) channels.
            states: (...) states of their readings.
        """
        at_stage, at_zero = self.weights[:, rows, None]
        # A NaN of a state that does not count must not spread.
        here = np.where(at_stage == 0, 0.0, at_stage * observed[states, rows])
        zero = np.minimum(self.zero[rows], len(observed) - 1)
        return here + np.where(at_zero == 0, 0.0, at_zero * observed[zero, rows])

    def steps(self, built_on: Bools, rows: Ints, states: Ints) -> Floats:
        """How often the step of each state counts in some readings, (n_states, g).

        Args:
            built_on: (n_states, n_states) see `ConstructionSequence.built_on`.
            rows: (g,) channels.
            states: (g,) states of their readings.
        """
        at_stage, at_zero = self.weights[:, rows]
        return np.asarray(built_on[:, states] * at_stage + built_on[:, self.zero[rows]] * at_zero)

    def weights_of_states(self, rows: Ints, states: Ints, last: int) -> Floats:
        """How often some readings count what is seen of each state, (last + 1, g).

        Args:
            rows: (g,) channels.
            states: (g,) states of their readings.
            last: the last state.
        """
        at_stage, at_zero = self.weights[:, rows]
        state = np.arange(last + 1)[:, None]
        return np.asarray(at_stage * (state == states) + at_zero * (state == self.zero[rows]))

    def increments(self, observed: Floats, base: Ints) -> Floats:
        """What the step of each state changes in what channels see, (n_states, n_channels), SI.

        Of the virgin state it is what is there; 0 where a channel cannot be read.

        Args:
            observed: (m, n_channels) what all channels see of the first m states.
            base: (n_states,) the state on which each builds.
        """
        seen = np.zeros(self.readable.shape)
        here = self.readable[: len(observed)] & np.isfinite(observed)
        seen[: len(observed)][here] = observed[here]
        change = seen - seen[base]
        change[0] = seen[0]
        change[: len(observed)][~here] = 0.0
        change[len(observed) :] = 0.0
        return np.asarray(change)

    def operator(self, rows: Ints) -> sp.csr_array:
        """G' (g, n_dofs) of some channels (g,) that read displacements.

        Raises:
            ValueError: one of them reads something else (see `not_linear`).
        """
        found = [(mine, observable.rows) for mine, observable in self.parts]
        given = [(mine, matrix) for mine, matrix in found if matrix is not None]
        here = np.concatenate([np.empty(0, np.int64), *(mine for mine, _ in given)])
        place = np.full(len(self.channels), -1)
        place[here] = np.arange(len(here))
        if (place[rows] < 0).any():
            raise ValueError("a channel reads more than displacements")
        return sp.csr_array(sp.vstack([matrix for _, matrix in given]))[place[rows]]

    def linear(self, state: MarchState, rows: Ints) -> LinearRows | None:
        """What some channels (g,) read as a linear function of a state; None where it is not.

        Args:
            state: the state; only its parameters and the sizes of its arrays count.
            rows: (g,) channels, each once.
        """
        place = np.full(len(self.channels), -1)
        place[rows] = np.arange(len(rows))
        found: dict[str, list[sp.csr_array]] = {"u": [], "stress": [], "members": []}
        for mine, observable in self.parts:
            wanted = place[mine] >= 0
            if not wanted.any():
                continue
            own = observable.linear(state, wanted)
            if own is None:
                return None
            spread = sp.csr_array(
                (np.ones(wanted.sum()), (place[mine[wanted]], np.flatnonzero(wanted))),
                shape=(len(rows), len(mine)),
            )
            for name, parts in found.items():
                matrix = getattr(own, name)
                if matrix is not None:
                    parts.append(sp.csr_array(spread @ matrix))
        summed = {name: sum(parts[1:], parts[0]) for name, parts in found.items() if parts}
        return LinearRows(**summed)

    @property
    def displacements_only(self) -> bool:
        """Whether all channels read displacements and nothing else."""
        return all(observable.rows is not None for _, observable in self.parts)

    def not_linear(self, rows: Ints) -> str | None:
        """Why some channels (g,) are not linear in the displacements, or None if they are."""
        for mine, observable in self.parts:
            others = np.intersect1d(mine, rows)
            if observable.rows is None and len(others):
                name = self.channels[others[0]]
                return f"gauge '{name}' reads something else than displacements"
        return None

    def unreadable(self, channel: str, state: int) -> str | None:
        """Why a channel can't be read at a state, or None if it can."""
        row = self.channels.index(channel)
        if state < self.zero[row] and self.weights[1, row] < 0:
            return "it is zeroed only at a later stage"
        if not self.readable[state, row]:
            return self.reasons[row]
        return None


def observe(on_mesh: CaseOnMesh) -> tuple[Observation, list[Fault]]:
    """The gauges of a case on its mesh, and what is wrong with them."""
    channels, states = on_mesh.case.channels, len(on_mesh.sequence.states)
    readable = np.zeros((len(channels), states), dtype=bool)
    reasons = [""] * len(channels)
    parts, snapped, as_built, faults = [], set[str](), set[str](), list[Fault]()
    placing = [placing_of(channel) for channel in channels]
    for place in dict.fromkeys(placing):
        mine = np.flatnonzero([other is place for other in placing])
        placed = place([channels[row] for row in mine], on_mesh)
        faults += placed.faults
        snapped |= set(placed.snapped)
        as_built |= set(placed.as_built)
        readable[mine] = placed.readable
        if not placed.faults:
            parts.append((mine, placed.observable))
        for row in mine:
            reasons[row] = placed.unreadable
    names = tuple(channel.name for channel in channels)
    zero = np.array([on_mesh.case.zero_of(channel) for channel in channels], np.int64)
    beside = tuple(name for name in names if name in snapped)
    weights = np.array([_WEIGHTS[channel.reads] for channel in channels]).reshape(-1, 2).T
    built = tuple(name for name in names if name in as_built)
    found = Observation(
        names, tuple(parts), zero, weights, readable.T, beside, tuple(reasons), built
    )
    return found, faults


def gauges_outside(on_mesh: CaseOnMesh) -> list[Fault]:
    """Gauges in the ground with a point that lies outside the mesh, whatever ground is there when.

    Each point of a gauge is said once: the end of a casing is that of all its channels.
    """
    faults: dict[tuple[str, tuple[float, ...]], Fault] = {}
    for channel in on_mesh.case.channels:
        if channel.structure:
            continue
        moving = placing_of(channel) is relative_displacements
        points = [point for point, _ in channel.motions] if moving else [channel.second]
        for point in points:
            sites = on_mesh.locator.sites(on_mesh.kinematics.in_section(point)[0])
            beside = beside_fault(on_mesh, channel, point, sites)
            if beside is not None or not sites:
                fault = beside or point_fault(on_mesh, channel, point, sites)
                faults.setdefault((channel.gauge, point), fault)
    return list(faults.values())


def reading_faults(
    case: Case, observation: Observation, of_gauges: Sequence[Fault] = ()
) -> list[Fault]:
    """Readings that were taken when the gauge could not be read.

    Args:
        case: the case.
        observation: its gauges on the mesh.
        of_gauges: what is wrong with these; readings of faulty ones are not judged.
    """
    names = case.stage_names
    faulty = tuple(fault.path for fault in of_gauges)
    sound = {c.name for c in case.channels if not _faulty(format_path(c.key), faulty)}
    faults = []
    for reading in case.readings:
        if reading.channel not in sound:
            continue
        reason = observation.unreadable(reading.channel, names.index(reading.stage))
        if reading.value is not None and reason and not reading.bad:
            faults.append(
                Fault(
                    "unreadable-gauge",
                    f"gauge '{reading.channel}' can't have been read at stage "
                    f"'{reading.stage}': {reason}",
                    "leave the value blank, or correct the stage, the gauge's 'zero' or its points",
                    reading.location,
                )
            )
    return faults


def _faulty(key: str, faulty: Sequence[str]) -> bool:
    """Whether one of some faulty keys is a gauge's, or part of it."""
    return any(path == key or path.startswith((f"{key}.", f"{key}[")) for path in faulty)

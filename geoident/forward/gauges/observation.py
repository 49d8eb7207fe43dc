"""What gauges read of the states of an analysis: one quantity each, and all channels together.

An observable turns a state of the run into values with derivatives. What a channel reads is its
value there less that at the zero of the channel, and what the instrument adds by itself
(`instrument_errors`). A new quantity is one class more, which says what it makes of displacements,
stresses and member forces, and one function, which places its channels, finds from when to when
they can be read, and stands in the table `kinds.OBSERVABLES` under the kinds that read it.

Condensation and the formulations that solve all stages at once act on the ground with unit forces
along the readings (theory 4.1). An observable that is linear in the displacements alone, whatever
the parameters, gives its rows G' for that; any other has none, and these methods refuse it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from geoident.forward.analysis.stage import LinearRows, StageEnd
from geoident.forward.gauges.zeros import ReadingRule
from geoident.forward.structures.members import Structures
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import ParameterPoint


@dataclass(frozen=True)
class AnalysisState:
    """A state of the analysis, as observables see it.

    Args:
        end: displacements, stresses and member forces; columns are the value, n derivatives and k
            responses to unit forces.
        point: the parameters, and the n of them by which the analysis differentiates.
        structures: linings and bolts.
    """

    end: StageEnd
    point: ParameterPoint
    structures: Structures


class Observable(Protocol):
    """What some channels (g) read."""

    def linear(self, state: AnalysisState, wanted: Bools) -> LinearRows | None:
        """The derivative of the values by the state.

        Args:
            state: only its parameters and the sizes of its arrays count.
            wanted: (g,) the channels that are asked for; rows of others may be empty.

        Returns:
            None where a wanted channel is not linear in the state.
        """

    def values(self, state: AnalysisState) -> Floats:
        """Values (g, 1 + n + k) at a state, SI, and their derivatives."""

    def coinciding(self, state: AnalysisState) -> tuple[str, ...]:
        """Names of channels that read one of several equal principal values at a state."""

    @property
    def rows(self) -> sp.csr_array | None:
        """G' (g, n_dofs) with values G' u; None where they are not linear in u alone."""


class RelativeDisplacements:
    """Motions of points against each other or against fixed ground: sums of vector . u, SI.

    Args:
        rows: G', (g, n_dofs).
    """

    def __init__(self, rows: sp.csr_array) -> None:
        self.rows = rows

    def linear(self, state: AnalysisState, wanted: Bools) -> LinearRows:
        """G' itself."""
        return LinearRows(u=self.rows)

    def values(self, state: AnalysisState) -> Floats:
        """Values (g, 1 + n + k) at a state, SI."""
        return np.asarray(self.rows @ state.end.u)

    def coinciding(self, state: AnalysisState) -> tuple[str, ...]:
        """None: there are no principal values."""
        return ()


@dataclass(frozen=True)
class Observation(ReadingRule):
    """The gauges of a case on its mesh.

    Args:
        parts: what is read, and by which of the channels, (g,) indices.
        reasons: why each channel cannot be read where it is zeroed and cannot, a clause.
        snapped: names of channels with a point just outside the mesh.
        as_built: names of channels whose readings count from the placing of their ground on.
    """

    parts: tuple[tuple[Ints, Observable], ...]
    reasons: tuple[str, ...]
    snapped: tuple[str, ...] = ()
    as_built: tuple[str, ...] = ()

    def values(self, state: AnalysisState) -> Floats:
        """What all channels see of a state since placing, (n_channels, 1 + n + k), SI."""
        table = np.empty((len(self.channels), state.end.u.shape[1]))
        for rows, observable in self.parts:
            table[rows] = observable.values(state)
        return table

    def coinciding(self, state: AnalysisState) -> tuple[str, ...]:
        """Channels that read, at a state, one of several equal principal stresses."""
        names = []
        for rows, observable in self.parts:
            named = observable.coinciding(state)
            if named:
                read = {self.channels[row] for row in rows if self._counts(row, state.end.state)}
                names += [name for name in named if name in read]
        return tuple(names)

    def _counts(self, row: int, state: int) -> bool:
        """Whether the readings of a channel are made of a state."""
        at_stage, at_zero = self.weights[:, row]
        read = self.readable[state, row] and at_stage != 0
        return bool(read or (at_zero != 0 and self.zero[row] == state))

    def operator(self, rows: Ints) -> sp.csr_array:
        """G' (g, n_dofs) of some channels (g,) that read displacements.

        Raises:
            ValueError: one of them reads something else (see `not_linear`).
        """
        parts = [(channels, observable.rows) for channels, observable in self.parts]
        given = [(channels, matrix) for channels, matrix in parts if matrix is not None]
        here = np.concatenate([np.empty(0, np.int64), *(channels for channels, _ in given)])
        place = np.full(len(self.channels), -1)
        place[here] = np.arange(len(here))
        if (place[rows] < 0).any():
            raise ValueError("a channel reads more than displacements")
        return sp.csr_array(sp.vstack([matrix for _, matrix in given]))[place[rows]]

    def linear(self, state: AnalysisState, rows: Ints) -> LinearRows | None:
        """What some channels (g,) read as a linear function of a state; None where it is not.

        Args:
            state: the state; only its parameters and the sizes of its arrays count.
            rows: (g,) channels, each once.
        """
        place = np.full(len(self.channels), -1)
        place[rows] = np.arange(len(rows))
        blocks: dict[str, list[sp.csr_array]] = {"u": [], "stress": [], "members": []}
        for channels, observable in self.parts:
            wanted = place[channels] >= 0
            if not wanted.any():
                continue
            own = observable.linear(state, wanted)
            if own is None:
                return None
            spread = sp.csr_array(
                (np.ones(wanted.sum()), (place[channels[wanted]], np.flatnonzero(wanted))),
                shape=(len(rows), len(channels)),
            )
            for name, parts in blocks.items():
                matrix = getattr(own, name)
                if matrix is not None:
                    parts.append(sp.csr_array(spread @ matrix))
        summed = {name: sum(parts[1:], parts[0]) for name, parts in blocks.items() if parts}
        return LinearRows(**summed)

    @property
    def displacements_only(self) -> bool:
        """Whether all channels read displacements and nothing else."""
        return all(observable.rows is not None for _, observable in self.parts)

    def not_linear(self, rows: Ints) -> str | None:
        """Why some channels (g,) are not linear in the displacements, or None if they are."""
        for channels, observable in self.parts:
            others = np.intersect1d(channels, rows)
            if observable.rows is None and len(others):
                name = self.channels[others[0]]
                return f"gauge '{name}' reads something else than displacements"
        return None

    @cached_property
    def _number(self) -> dict[str, int]:
        return {channel: k for k, channel in enumerate(self.channels)}

    def unreadable(self, channel: str, state: int) -> str | None:
        """Why a channel can't be read at a state, or None if it can."""
        row = self._number[channel]
        if self.before_zero(state, row):
            return "it is zeroed only at a later stage"
        if not self.readable[state, row]:
            return self.reasons[row]
        return None

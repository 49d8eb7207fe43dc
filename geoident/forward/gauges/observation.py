"""What gauges read of the states of an analysis: one quantity each, and all channels together.

An observable turns a state of the run into values with derivatives. What a channel reads is its
value there less that at the zero of the channel, and what the instrument adds by itself
(`instrument_errors`). A new quantity is one module: a subclass of `Observable`, which says what it
makes of displacements, stresses and member forces, and a function that places its channels and
finds from when to when they can be read. The function stands in the table `kinds.OBSERVABLES` under
the kinds that read it; `pore_pressure` is the shortest to copy.

Condensation and the formulations that solve all stages at once act on the ground with unit forces
along the readings (theory 4.1). An observable that is linear in the displacements alone, whatever
the parameters, gives its rows G' for that; any other has none, and these methods refuse it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

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


class Observable(ABC):
    """What some channels (g) read.

    Attributes:
        rows: G' (g, n_dofs) with values G' u; None where they are not linear in u alone.
    """

    rows: sp.csr_array | None = None

    @abstractmethod
    def linear(self, state: AnalysisState, wanted: Bools) -> LinearRows | None:
        """The derivative of the values by the state.

        Args:
            state: only its parameters and the sizes of its arrays count.
            wanted: (g,) the channels that are asked for; rows of others may be empty.

        Returns:
            None where a wanted channel is not linear in the state.
        """

    @abstractmethod
    def values(self, state: AnalysisState) -> Floats:
        """Values (g, 1 + n + k) at a state, SI, and their derivatives."""

    def coinciding(self, state: AnalysisState) -> tuple[str, ...]:
        """Names of channels that read one of several equal principal values at a state."""
        return ()


@dataclass(frozen=True)
class PlacedGauges(ReadingRule):
    """The gauges of a case on its mesh.

    Args:
        parts: what is read, and by which of the channels, (g,) indices.
        reasons: of each channel, why it cannot be read at some stages after its zero, a clause.
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
        number, (at_stage, at_zero) = state.end.number, self.weights
        counts = self.readable[number] & (at_stage != 0) | (self.zero == number) & (at_zero != 0)
        read = {name for name, counted in zip(self.channels, counts, strict=True) if counted}
        named = (name for _, part in self.parts for name in part.coinciding(state))
        return tuple(name for name in named if name in read)

    def operator(self, rows: Ints) -> sp.csr_array:
        """G' (g, n_dofs) of some channels (g,) that read displacements.

        Raises:
            ValueError: one of them reads something else (see `not_linear`).
        """
        if self.not_linear(rows) is not None:
            raise ValueError("a channel reads more than displacements")
        parts = [(channels, part.rows) for channels, part in self.parts if part.rows is not None]
        order = np.concatenate([channels for channels, _ in parts])
        place = np.full(len(self.channels), -1)
        place[order] = np.arange(len(order))
        return sp.csr_array(sp.vstack([matrix for _, matrix in parts]))[place[rows]]

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
            sums = observable.linear(state, wanted)
            if sums is None:
                return None
            spread = sp.csr_array(
                (np.ones(wanted.sum()), (place[channels[wanted]], np.flatnonzero(wanted))),
                shape=(len(rows), len(channels)),
            )
            for name, parts in blocks.items():
                matrix = getattr(sums, name)
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

    def unreadable(self, row: int, state: int) -> str | None:
        """Why a channel can't be read at a state, or None if it can."""
        if self.before_zero(state, row):
            return "it is zeroed only at a later stage"
        return None if self.readable[state, row] else self.reasons[row]

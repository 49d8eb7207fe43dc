"""Readings by the reduced model: one more `Response`, with a bound of its error.

The bounds hold against the march in exact arithmetic. For what the march and this model round, two
parts of the largest reading are added to those of readings: `ROUNDING`, and what is seen of it at
the reference, where the adjoints are known and the error is theirs to the last digit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from geoident.errors import ModelError
from geoident.forward.gauges.observation import Observation
from geoident.forward.reduced.duals.bounds import ReadingDuals
from geoident.forward.reduced.model import EnergyBounds, ReducedModel, ReducedStates
from geoident.model.arrays import Floats, Ints
from geoident.model.results.costs import Counts

ROUNDING = 1e-10
"""Part of the largest reading that may be rounding."""


@dataclass(frozen=True, eq=False)
class ReadingsAsked:
    """Readings (g) that are asked for.

    Args:
        rows: (g,) their channels.
        states: (g,) their states.
        added: what instruments add to them and its derivatives (g, 1 + n) at the reference of the
            reduced model; linear in the parameters.
        dimensions: (g,) what is read: what is rounding is judged by the largest of the same.
    """

    rows: Ints
    states: Ints
    added: Floats
    dimensions: Sequence[str]


class ReducedResponse:
    """Readings of some channels at some states by a reduced model.

    Args:
        reduced: the model.
        observation: the gauges.
        asked: the readings.
        bases: (n_states,) the state on which each builds.
        admissible: says why parameters (n,) are outside the domain, or None.
        duals: adjoints of the readings, where their errors are to be bounded.
    """

    def __init__(
        self,
        reduced: ReducedModel,
        observation: Observation,
        asked: ReadingsAsked,
        bases: Ints,
        admissible: Callable[[Floats], str | None],
        duals: ReadingDuals | None = None,
    ) -> None:
        kinds = np.array(asked.dimensions, dtype=np.str_)
        self._same = np.unique(kinds, return_inverse=True)[1]
        self.model, self._observation = reduced, observation
        self.rows, self.states, self._added = asked.rows, asked.states, asked.added
        self._bases, self._admissible, self.duals = bases, admissible, duals
        self._evaluations = 0
        self._last: tuple[bytes, ReducedStates] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n parameters."""
        return self.model.form.names

    @property
    def counts(self) -> Counts:
        """Costs so far: it factorizes nothing."""
        return Counts(self._evaluations, 0, 0, 0)

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain, or None."""
        return self._admissible(p)

    def readings(self, p: Floats) -> Floats:
        """v(p), (g,)."""
        return self.evaluate(p)[0]

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its Jacobian, (g, n)."""
        found = self._at(p)
        table = self._table(found, p[None])[:, 0]
        return table[:, 0], table[:, 1:]

    def error(self, p: Floats) -> float:
        """Bound of the error of the stresses at p (n,) in energy, relative to what moves.

        Infinite where none can be found.
        """
        try:
            return float(self.model.bounds(self._at(p)).relative[0])
        except np.linalg.LinAlgError:
            return np.inf

    def increments(self, p: Floats) -> Floats:
        """What the step of each state changes in what channels see at p (n,), SI.

        (n_states, n_channels); 0 for those that read something else than motions.
        """
        seen = self.model.observed(self._at(p))[:, :, 0, 0]
        return self._observation.increments(seen, self._bases)

    def many(self, values: Floats) -> tuple[Floats, EnergyBounds]:
        """Readings (b, g) at parameter vectors (b, n), and bounds of the errors in energy."""
        self._evaluations += len(values)
        found = self.model.states(values, derivatives=False)
        table = np.ascontiguousarray(self._table(found, values)[..., 0].T)
        return table, self.model.bounds(found)

    def certified(self, values: Floats) -> tuple[Floats, Floats]:
        """Readings (b, g) at parameter vectors (b, n), and bounds (b, g) of their errors, SI.

        Both are NaN outside the domain, and of all where the reduced model has no answer for one.

        Raises:
            ValueError: it was made without adjoints.
        """
        if self.duals is None:
            msg = "the reduced model has no adjoints of these readings"
            raise ValueError(msg)
        inside = np.array([self._admissible(p) is None for p in values], dtype=bool)
        table, error = np.full((2, len(values), len(self.rows)), np.nan)
        if inside.any():
            with suppress(ValueError, np.linalg.LinAlgError):
                table[inside], error[inside] = self._bounded(self.duals, values[inside])
        return table, error

    def _bounded(self, duals: ReadingDuals, values: Floats) -> tuple[Floats, Floats]:
        """Readings and bounds of their errors, all inside the domain."""
        self._evaluations += len(values)
        found = self.model.states(values, derivatives=False)
        table = np.ascontiguousarray(self._table(found, values)[..., 0].T)
        left = duals.bounds(found, self.model.bounds(found))
        rounding = (ROUNDING + duals.rounding) * self._largest(table)
        return table, left.error + np.abs(left.correction) + rounding

    def _largest(self, table: Floats) -> Floats:
        """Size (b, g) of the largest reading of the same dimension, of readings (b, g)."""
        found = np.zeros_like(table)
        for kind in range(int(self._same.max(initial=-1)) + 1):
            mine = self._same == kind
            found[:, mine] = np.abs(table[:, mine]).max(axis=1, initial=0.0)[:, None]
        return found

    def see_rounding(self, moved: Floats) -> None:
        """Find what is rounding at the reference.

        Args:
            moved: (g,) readings of the march there, without what instruments add.
        """
        if self.duals is None or not moved.any():
            return
        at = self.model.reference[None]
        found = self.model.states(at, derivatives=False)
        left = self.duals.bounds(found, self.model.bounds(found)).correction[0]
        left += self._table(found, at)[:, 0, 0] - self._added[:, 0] - moved
        largest = self._largest(moved[None])[0]
        part = np.abs(left) / np.where(largest > 0.0, largest, np.inf)
        self.duals.rounding = float(part.max())

    def _at(self, p: Floats) -> ReducedStates:
        if self._last is None or self._last[0] != p.tobytes():
            self._evaluations += 1
            try:
                found = self.model.states(p[None])
            except (ValueError, np.linalg.LinAlgError) as error:
                msg = f"the reduced model has no answer: {error}"
                raise ModelError(msg) from error
            self._last = p.tobytes(), found
        return self._last[1]

    def _table(self, found: ReducedStates, values: Floats) -> Floats:
        """Readings (g, b, 1 + n or 1)."""
        seen = self.model.observed(found)
        flat = seen.reshape(*seen.shape[:2], -1)
        table = self._observation.readings(flat, self.rows, self.states)
        table = table.reshape(len(self.rows), *seen.shape[2:])
        slopes = self._added[:, 1:]
        table[..., 0] += self._added[:, :1] + slopes @ (values - self.model.reference).T
        if table.shape[2] > 1:
            table[..., 1:] += slopes[:, None]
        return np.asarray(table)

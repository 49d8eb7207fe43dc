"""Readings by the reduced model: one more `Response`, with estimates of its errors (theory 14.4).

The error of its stresses e(p), in energy and relative, is known at every p (`model`). What it means
for readings is learnt from analyses that were withheld: before an analysis at p_k becomes part of
the reduced model, that predicts its readings, and is wrong by d_k. With s the most that
any channel of a dimension sees of any state, a reading of this dimension is estimated to be off by

    10 max_k ( |d_k| / (s_k e_k) ) s(p) e(p)  +  `ROUNDING` s(p)

The error of a reading falls with the square of e, so a ratio that was seen where e was larger is
more than what holds where it is small. Where e is so small that d is rounding, `ROUNDING` s stands
for d.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.errors import ModelError
from geoident.forward.gauges.observation import Observation
from geoident.forward.reduced.model import ReducedModel, ReducedStates
from geoident.model.arrays import Floats, Ints
from geoident.model.results.costs import Counts

ROUNDING = 1e-10
"""Part of the largest reading that may be rounding of the analysis and of this model."""

SAFETY = 10.0
"""Times the largest ratio that was seen, since one to seven analyses are few.

All over the bounds of the small cases of the tests the error was up to 5 times the estimate without
it (gauges of stress), mostly a hundredth of that.
"""


@dataclass(frozen=True, eq=False)
class ReadingsAsked:
    """Readings (g) that are asked for.

    Args:
        rows: (g,) their channels.
        states: (g,) their states.
        added: what instruments add to them and its derivatives (g, 1 + n) at the reference of the
            reduced model; linear in the parameters.
        dimensions: (n_channels,) of all channels: errors are judged by the most that is seen of
            the same.
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
        ratios: (g,) |d| / (s e) as seen at analyses that were withheld; empty where none were.
    """

    def __init__(
        self,
        reduced: ReducedModel,
        observation: Observation,
        asked: ReadingsAsked,
        bases: Ints,
        admissible: Callable[[Floats], str | None],
        ratios: Floats | None = None,
    ) -> None:
        self.model, self._observation, self._asked = reduced, observation, asked
        self.rows, self.states, self._bases = asked.rows, asked.states, bases
        self._admissible = admissible
        self.ratios = np.zeros(0) if ratios is None else ratios
        dimensions = np.array(asked.dimensions, dtype=np.str_)
        self._dimension = np.unique(dimensions, return_inverse=True)[1]  # (n_channels,) numbers
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
        table = self._table(self._at(p), p[None])[:, 0]
        return table[:, 0], table[:, 1:]

    def error(self, p: Floats) -> float:
        """Error of the stresses at p (n,) in energy, relative to what moves; infinite for none."""
        try:
            return float(self.model.errors(self._at(p))[0])
        except np.linalg.LinAlgError:
            return np.inf

    def increments(self, p: Floats) -> Floats:
        """What the step of each state changes in what channels see at p (n,), SI.

        (n_states, n_channels); 0 for those that read something else than motions.
        """
        seen = self.model.observed(self._at(p))[:, :, 0, 0]
        return self._observation.increments(seen, self._bases)

    def errors(self, values: Floats) -> Floats:
        """The error of the stresses (b,) at parameter vectors (b, n)."""
        return self.model.errors(self.model.states(values, derivatives=False))

    def estimated(self, values: Floats) -> tuple[Floats, Floats]:
        """Readings (b, g) at parameter vectors (b, n), and estimates (b, g) of their errors, SI.

        Both are NaN outside the domain, and of all where the reduced model has no answer for one.

        Raises:
            ValueError: no analysis was withheld, so that nothing is known of the errors.
        """
        if not len(self.ratios):
            msg = "nothing is known of the errors of these readings"
            raise ValueError(msg)
        inside = np.array([self._admissible(p) is None for p in values], dtype=bool)
        table, error = np.full((2, len(values), len(self.rows)), np.nan)
        if not inside.any():
            return table, error
        self._evaluations += int(inside.sum())
        try:
            states = self.model.states(values[inside], derivatives=False)
            relative = self.model.errors(states)
        except (ValueError, np.linalg.LinAlgError):
            return table, error
        table[inside] = self._table(states, values[inside])[..., 0].T
        part = SAFETY * self.ratios * relative[:, None] + ROUNDING
        error[inside] = part * self._most_seen(states)
        return table, error

    def ratio(self, p: Floats, readings: Floats) -> Floats:
        """How the errors of readings compare with that of the stresses, (g,); see above.

        Args:
            p: (n,) where an analysis was made that is no part of this model.
            readings: (g,) its readings.
        """
        off, of_reading = np.abs(self.readings(p) - readings), self._dimension[self.rows]
        for one in np.unique(of_reading):  # any reading of a dimension may be off by so much
            off[of_reading == one] = off[of_reading == one].max()
        size = self._most_seen(self._at(p))[0]
        off = np.maximum(off, ROUNDING * size)  # of less nothing is known
        scale = size * max(self.error(p), np.finfo(np.float64).eps)
        return np.asarray(np.divide(off, scale, out=np.zeros_like(off), where=scale > 0.0))

    def _most_seen(self, states: ReducedStates) -> Floats:
        """The most that any channel of the dimension of each reading sees of any state, (b, g)."""
        seen = np.nan_to_num(np.abs(self.model.observed(states)[..., 0])).max(axis=0)
        most = np.zeros((seen.shape[1], 1 + int(self._dimension.max(initial=0))))
        np.maximum.at(most.T, self._dimension, seen)
        return np.asarray(most[:, self._dimension[self.rows]])

    def _at(self, p: Floats) -> ReducedStates:
        if self._last is None or self._last[0] != p.tobytes():
            self._evaluations += 1
            try:
                states = self.model.states(p[None])
            except (ValueError, np.linalg.LinAlgError) as error:
                msg = f"the reduced model has no answer: {error}"
                raise ModelError(msg) from error
            self._last = p.tobytes(), states
        return self._last[1]

    def _table(self, states: ReducedStates, values: Floats) -> Floats:
        """Readings (g, b, 1 + n or 1)."""
        seen = self.model.observed(states)
        flat = seen.reshape(*seen.shape[:2], -1)
        table = self._observation.readings(flat, self.rows, self.states)
        table = table.reshape(len(self.rows), *seen.shape[2:])
        value, slopes = self._asked.added[:, :1], self._asked.added[:, 1:]
        table[..., 0] += value + slopes @ (values - self.model.reference).T
        if table.shape[2] > 1:
            table[..., 1:] += slopes[:, None]
        return np.asarray(table)

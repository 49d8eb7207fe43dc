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

from typing import Protocol

import numpy as np

from geoident.errors import ModelError
from geoident.forward.gauges.instrument_errors import InstrumentErrors, ReadingPlaces
from geoident.forward.gauges.zeros import ReadingRule
from geoident.forward.reduced.model import ReducedModel, ReducedStates
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.results.costs import Counts

ROUNDING = 1e-10
"""Part of the largest reading that may be rounding of the analysis and of this model."""

SAFETY = 10.0
"""Times the largest ratio that was seen, since one to seven analyses are few.

All over the bounds of the small cases of the tests the error was up to 5 times the estimate without
it (gauges of stress), mostly a hundredth of that.
"""


class Gauged(Protocol):
    """A case with its gauges: the model on the mesh, or what a result keeps of it."""

    @property
    def case(self) -> Case:
        """The case."""

    @property
    def rule(self) -> ReadingRule:
        """How readings are made of what channels see."""

    @property
    def instrument_errors(self) -> InstrumentErrors:
        """What the gauges add by themselves."""

    @property
    def bases(self) -> Ints:
        """(n_states,) the state on which each builds."""

    @property
    def built_on(self) -> Bools:
        """(n_states, n_states) see `ConstructionSequence.built_on`."""

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain, or None."""


class ReducedResponse:
    """Readings of some channels at some states by a reduced model.

    Args:
        reduced: the model.
        gauged: the case with its gauges.
        places: the g readings that are asked for.
        ratios: (g,) |d| / (s e) as seen at analyses that were withheld; empty where none were.
    """

    def __init__(
        self, reduced: ReducedModel, gauged: Gauged, places: ReadingPlaces, ratios: Floats
    ) -> None:
        self.model, self._gauged, self.ratios = reduced, gauged, ratios
        self.rows, self.states = places.rows, places.states
        at_reference = dict(zip(self.names, map(float, reduced.reference), strict=True))
        self._added = gauged.instrument_errors.added(at_reference, self.names, places)
        dimensions = [channel.dimension for channel in gauged.case.channels]
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
        return self._gauged.admissible(p)

    def readings(self, p: Floats) -> Floats:
        """v(p), (g,)."""
        return self.evaluate(p)[0]

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its Jacobian, (g, n)."""
        table = self._table(self.model.observed(self._at(p)), p[None])[:, 0]
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
        return self._gauged.rule.increments(seen, self._gauged.bases)

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
        inside = np.array([self.admissible(p) is None for p in values], dtype=bool)
        table, error = np.full((2, len(values), len(self.rows)), np.nan)
        if not inside.any():
            return table, error
        self._evaluations += int(inside.sum())
        try:
            states = self.model.states(values[inside], derivatives=False)
            relative = self.model.errors(states)
        except (ValueError, np.linalg.LinAlgError):
            return table, error
        seen = self.model.observed(states)
        table[inside] = self._table(seen, values[inside])[..., 0].T
        part = SAFETY * self.ratios * relative[:, None] + ROUNDING
        error[inside] = part * self._most_seen(seen)
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
        size = self._most_seen(self.model.observed(self._at(p)))[0]
        off = np.maximum(off, ROUNDING * size)  # of less nothing is known
        scale = size * max(self.error(p), np.finfo(np.float64).eps)
        return np.asarray(np.divide(off, scale, out=np.zeros_like(off), where=scale > 0.0))

    def _most_seen(self, seen: Floats) -> Floats:
        """The most that any channel of the dimension of each reading sees of any state, (b, g)."""
        largest = np.nan_to_num(np.abs(seen[..., 0])).max(axis=0)
        most = np.zeros((1 + int(self._dimension.max(initial=0)), largest.shape[1]))
        np.maximum.at(most, self._dimension, largest)
        return most[self._dimension[self.rows]].T

    def _at(self, p: Floats) -> ReducedStates:
        """All states at p (n,): the last ones are kept."""
        if self._last is None or self._last[0] != p.tobytes():
            self._evaluations += 1
            try:
                states = self.model.states(p[None])
            except (ValueError, np.linalg.LinAlgError) as error:
                msg = f"the reduced model has no answer: {error}"
                raise ModelError(msg) from error
            self._last = p.tobytes(), states
        return self._last[1]

    def _table(self, seen: Floats, values: Floats) -> Floats:
        """Readings (g, b, 1 + n or 1) of what all channels see at parameter vectors (b, n)."""
        flat = seen.reshape(*seen.shape[:2], -1)
        table = self._gauged.rule.readings(flat, self.rows, self.states)
        table = table.reshape(len(self.rows), *seen.shape[2:])
        value, slopes = self._added[:, :1], self._added[:, 1:]  # linear in the parameters
        table[..., 0] += value + slopes @ (values - self.model.reference).T
        if table.shape[2] > 1:
            table[..., 1:] += slopes[:, None]
        return np.asarray(table)

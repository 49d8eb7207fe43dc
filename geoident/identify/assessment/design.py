"""Which of many readings tell most of what is to be known: variances, before anything is read.

A quantity t and readings y = z + e with own errors e of variances d are normal together (theory
17). What is left of the variance of t once a block G of readings is taken,

    v(G) = S_tt - S_tG (S_GG + D_G)^-1 S_Gt ,     S = cov(t, z) ,

does not depend on what they read, and the same formula gives all of S after G, so that blocks are
taken one after the other. The update is written as (1 - K) S (1 - K)^T + K D K^T, which rounding
cannot make negative however much the first readings tell.

Where t is to be held against a limit L, its chance p of being beyond is what readings are to
settle: what counts in place of the variance is the expected p (1 - p) that is left,

    E[p (1 - p)] = 2 T(a, sqrt((1 - r) / (1 + r))) ,   a = (L - mean) / sqrt(v_0) ,

with r = 1 - v / v_0 and Owen's function T.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import owens_t

from geoident.model.arrays import Floats, Ints

_NOTHING = 1e-9
"""Part of the variance below which a gauge adds nothing, or an exchange gains nothing."""


@dataclass(frozen=True)
class Outlook:
    """t quantities that are due together, and the m readings that may be taken before.

    Args:
        covariance: (t + m, t + m) of the quantities and of readings without own errors.
        own: (m,) variances of these errors, positive.
        numbers: (m,) what the readings are called by.
        first: (t,) variances of the quantities before any of them, positive.
        limit: (t,) distance of the limit from the mean then, in standard deviations; NaN where
            there is none.
        start: (t,) variances with which what is left is compared.
    """

    covariance: Floats
    own: Floats
    numbers: Ints
    first: Floats
    limit: Floats
    start: Floats

    def given(self, readings: Ints) -> Outlook:
        """The same once readings of these numbers are taken; of some it may know nothing."""
        G = self._rows(readings)
        K, A = self._gain(G, slice(None))
        S = self.covariance - K @ A.T
        S = S - S[:, G] @ K.T + (K * self.own[G - len(self.start)]) @ K.T
        return replace(self, covariance=0.5 * (S + S.T))

    def begun(self) -> Outlook:
        """The same, with what is known now as the start."""
        return replace(self, start=self.variances)

    @property
    def variances(self) -> Floats:
        """(t,) of the quantities."""
        t = len(self.start)
        return np.asarray(np.diag(self.covariance)[:t])

    def left(self, readings: Ints) -> Floats:
        """(t,) variances of the quantities that these readings would leave."""
        G, targets = self._rows(readings), slice(len(self.start))
        K, A = self._gain(G, targets)
        noise = self.own[G - len(self.start)]
        SK = self.covariance[np.ix_(G, G)] @ K.T
        moved = -2.0 * np.sum(K * A, axis=1) + np.sum(K.T * SK, axis=0) + K**2 @ noise
        return np.asarray(np.maximum(self.variances + moved, 0.0))

    def part(self, variances: Floats) -> float:
        """What variances (t,) leave of what was unknown at the start, the mean of all."""
        ratio = np.clip(variances / self.start, 0.0, 1.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            unsettled = self._unsettled(variances) / self._unsettled(self.start)
        return float(np.where(np.isfinite(unsettled), unsettled, ratio).mean())

    def _unsettled(self, variances: Floats) -> Floats:
        """Half of the expected p (1 - p) that variances (t,) leave; NaN without a limit."""
        left = np.clip(variances / self.first, 0.0, 1.0)
        return np.asarray(owens_t(self.limit, np.sqrt(left / (2.0 - left))))

    def _rows(self, readings: Ints) -> Ints:
        return np.flatnonzero(np.isin(self.numbers, readings)) + len(self.start)

    def _gain(self, G: Ints, rows: slice) -> tuple[Floats, Floats]:
        """K and S_G of some rows, (rows, b)."""
        A = self.covariance[rows, G]
        if not len(G):
            return A, A
        M = self.covariance[np.ix_(G, G)] + np.diag(self.own[G - len(self.start)])
        size = np.sqrt(np.diag(M))  # readings have different units
        factor = cho_factor(M / np.outer(size, size), lower=True)
        return np.asarray(cho_solve(factor, (A / size).T).T / size), A


@dataclass(frozen=True)
class Gauges:
    """Gauges among which to choose.

    Args:
        outlooks: what is to be known, for each time at which something is due and each draw of the
            parameters.
        readings: numbers of the readings of each gauge.
        costs: of each.
    """

    outlooks: tuple[Outlook, ...]
    readings: tuple[Ints, ...]
    costs: Floats

    def after(self, chosen: Sequence[int]) -> Gauges:
        """The same once some are read."""
        taken = self._all(chosen)
        return replace(self, outlooks=tuple(one.given(taken) for one in self.outlooks))

    def part(self, chosen: Sequence[int] = ()) -> float:
        """What is left to be known once some gauges are read, 0 to 1; the mean over outlooks."""
        taken = self._all(chosen)
        return float(np.mean([one.part(one.left(taken)) for one in self.outlooks]))

    def without_readings(self, chosen: Sequence[int], readings: Ints) -> float:
        """The same where some of their readings are lost."""
        taken = np.setdiff1d(self._all(chosen), readings)
        return float(np.mean([one.part(one.left(taken)) for one in self.outlooks]))

    def in_order(self, chosen: Sequence[int]) -> tuple[tuple[int, float], ...]:
        """Chosen gauges, the one that tells most first, each with what is left after it."""
        state, order = self, list[tuple[int, float]]()
        left = list(chosen)
        while left:
            parts = [state.part([c]) for c in left]
            k = int(np.argmin(parts))
            order.append((left[k], parts[k]))
            state = state.after([left.pop(k)])
        return tuple(order)

    def _all(self, chosen: Sequence[int]) -> Ints:
        none = [np.zeros(0, dtype=np.int64)]
        return np.concatenate([*none, *(self.readings[c] for c in chosen)])


def choose(gauges: Gauges, budget: float) -> tuple[int, ...]:
    """The gauges within a budget that leave least to be known.

    From each of the best single ones on, one after the other, by what each adds or by what it adds
    for its cost, and then by exchanging single ones as long as that gains: the best of all that.

    Args:
        gauges: to choose from.
        budget: that their costs must not exceed.
    """
    ways = [True, False] if np.ptp(gauges.costs) > 0.0 else [False]
    single = sorted(_affordable(gauges, [], budget), key=lambda c: gauges.part([c]))
    found = [
        _exchanged(gauges, _filled(gauges, begun, budget, by_cost=way), budget)
        for way in ways
        for begun in ([], *([c] for c in single[1:_STARTS]))
    ]
    best = min(found, key=gauges.part)
    return tuple(best)


_STARTS = 5
"""Single gauges from which it is begun."""


def _filled(gauges: Gauges, chosen: list[int], budget: float, *, by_cost: bool) -> list[int]:
    """Chosen gauges and those that the rest of the budget buys."""
    chosen, state = list(chosen), gauges.after(chosen)
    while True:
        left, now = _affordable(gauges, chosen, budget), state.part()
        if not left:
            return chosen
        adds = np.array([now - state.part([c]) for c in left])
        if adds.max() <= _NOTHING * now:
            return chosen
        best = left[int(np.argmax(adds / gauges.costs[left] if by_cost else adds))]
        chosen.append(best)
        state = state.after([best])


def _affordable(gauges: Gauges, chosen: Sequence[int], budget: float) -> list[int]:
    room = budget * (1.0 + 1e-12) - float(gauges.costs[list(chosen)].sum())
    return [c for c in range(len(gauges.costs)) if c not in chosen and gauges.costs[c] <= room]


def _exchanged(gauges: Gauges, chosen: list[int], budget: float) -> list[int]:
    """Chosen gauges, of which single ones give way to others as long as that gains."""
    now, tried = gauges.part(chosen), 0
    while tried < len(chosen):
        out, rest = chosen[0], chosen[1:]
        state = gauges.after(rest)
        others = [c for c in _affordable(gauges, rest, budget) if c != out]
        best = min(others, key=lambda c: state.part([c]), default=out)
        better = min(
            (_filled(gauges, [*rest, best], budget, by_cost=False),
             _filled(gauges, rest, budget, by_cost=True)),
            key=gauges.part,
        )  # fmt: skip
        if (part := gauges.part(better)) < now * (1.0 - _NOTHING):
            chosen, now, tried = better, part, 0
        else:
            chosen, tried = [*rest, out], tried + 1
    return chosen

"""Readings and numbers of a case with a wrong sign, unit, zero or name: what makes all others fit.

A mistake changes the readings I that were written together (one cell, the column of a channel, the
sheet of an instrument) by one factor, adds one number to each channel of them, or has exchanged
them. With the model linearised at p (v, J in scaled parameters, rows R of the priors with residuals
rho), d = v* - v and the covariance S of the errors, the least misfit over all parameters is

    chi2(d) = d^T S^-1 d + |rho|^2 - h^T C h       h = J^T S^-1 d - R^T rho ,
                                                   C = (J^T S^-1 J + R^T R)^-1

and of changed readings d + t u, with u = v*_I for a factor 1 + t, u = 1_I for a zero, and
u = v*_K - v*_I (t = 1) where K was written for I,

    chi2(d + t u) = chi2(d) + 2 t b + t^2 a        b = u^T (S^-1 d - S^-1 J C h) ,
                                                   a = u^T (S^-1 - S^-1 J C J^T S^-1) u .

So the parameters follow every hypothesis: a wrong reading that has pulled the fit to itself is seen
all the same, and what alone determines a parameter (a = 0) is never accused. The few hypotheses
that promise most are fitted without linearisation and compared by their likelihood. A factor f is
one of `FACTORS`; the density of what was read is that of f times it, times |f| for each of the m
readings. A zero is normal with a standard deviation of the size of the readings. With that,

    score = (phi_0 - phi_h) / s^2 + ln |S_0| - ln |S_h| + 2 m ln |f| - 2 ln(number of its kind)

is twice the logarithm of the odds against sound readings where it was as likely before that one
of the hypotheses of this kind is right as that all is sound: by chance one set of sound readings in
exp(score / 2) goes beyond. S holds what any model is off by, in parts of what is read, and is known
anew for each hypothesis. s is the scatter of what fits, by its median and one at least, so that a
model that is off as a whole, or a second mistake, accuses nobody. A single reading may as well be
wrong by any number; where that is likelier, it is no mistake of a unit, and is not named here. At
last the factor that the other readings give to the suspected ones must be the one that is named,
within its error: a reading that is just far off is no mistake of a unit.

A factor f of all readings is 1/f on all that loads elastic ground: f v* - v(p) and v* - v(p) / f
are one problem, in which the errors are those of the readings as written. It is named only where
the parameters could not follow, by a bound or a prior. The numbers of one parameter (start, bounds,
prior) are a hypothesis as well, where its prior contradicts the readings or a bound holds it: freed
of them, it must end where one factor brings them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import zip_longest
from math import log

import numpy as np
import scipy.sparse as sp

from geoident.errors import ModelError
from geoident.identify.assessment.changed_readings import Linearized
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.scaling import Scaling
from geoident.identify.problem.shared_errors import SharedErrors
from geoident.model.arrays import Floats, Ints
from geoident.model.methods import SquaredOptions
from geoident.model.parameter import Parameter

FACTORS = (-1.0, 10.0, 0.1, 100.0, 0.01, 1000.0, 0.001, 25.4, 1.0 / 25.4)
"""What readings would have to be multiplied with: the sign, decimal points and units, inches."""

POWERS = (10.0, 0.1, 100.0, 0.01, 1000.0, 0.001)
"""What the numbers of a parameter would have to be multiplied with."""

PARAMETER = "parameter"
"""Level of the numbers of a parameter, which is no reading."""

CERTAIN = 10.0
"""Score from which on a mistake is named: odds of 150."""

_EQUAL = 6.0
"""Difference of scores below which two mistakes explain the readings equally well: odds of 20."""

_AGREES = 3.0
"""Standard deviations by which the factor of the other readings may differ from the named one."""

_MODEL = 0.1
"""Relative error of any model, beside that of the readings, in this comparison of factors."""

_MODEL_OF_SIGN = 0.3
"""The same where only the sign is in question."""

_TRIED = 4
"""Hypotheses that are fitted before one is named or none."""

_MOST = 5
"""Mistakes that are named in one fit."""

_CLEAR_FACTOR = 2.0
"""Accuracies that several readings are on the average where they are said to be too large."""

_CLEAR_ZERO = 0.25
"""Part of the largest motion of a channel that a missed zero is at least.

A model error is of a tenth to a fifth of the motion.
"""


_NONE: Ints = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class Suspects:
    """Readings that one mistake would have changed together, or the numbers of a parameter.

    Args:
        rows: (m,) numbers of the readings; none of a parameter.
        level: what they are, such as ``channel``; mistakes of one level are equally likely.
        name: of what they belong to.
        channels: (m,) numbers of the channels whose zero may have been missed; none where no zero
            is suspected. Of a single reading it means that it may be wrong by any number.
        source: (m,) numbers of the readings that were written in the places of these; none where
            no exchange is suspected.
    """

    rows: Ints
    level: str
    name: str
    channels: Ints = field(default_factory=lambda: _NONE)
    source: Ints = field(default_factory=lambda: _NONE)

    @property
    def key(self) -> tuple[str, bytes]:
        """Equal where one correction undoes another."""
        of_readings = "exchanged" if len(self.source) else ""
        return self.name if self.level == PARAMETER else of_readings, self.rows.tobytes()


@dataclass(frozen=True)
class Mistake:
    """A mistake that explains why readings do not fit.

    Args:
        suspects: the readings, or the parameter.
        factor: that makes them right; 1 where their zero is wrong or they were exchanged.
        offset: (m,) what is to be subtracted from them, SI; 0 where the factor is wrong.
        before: root of the mean square of all residuals in their accuracies, as read.
        after: the same where the readings are as they should be.
        values: (n,) the estimate then, SI.
        shift: (n,) by how much it differs from that as read, in standard deviations.
        of_all: a factor of all readings, or of what loads the ground.
        of_loads: the errors of the readings speak for the latter.
        released: (k,) numbers of parameters that leave their bounds, where nothing else shows it.
        rivals: other mistakes that explain the readings as well.
    """

    suspects: Suspects
    factor: float
    offset: Floats
    before: float
    after: float
    values: Floats
    shift: Floats
    of_all: bool = False
    of_loads: bool = False
    released: Ints = field(default_factory=lambda: _NONE)
    rivals: tuple[Mistake, ...] = ()

    @property
    def is_zero(self) -> bool:
        """The zero is wrong."""
        return bool(np.any(self.offset != 0.0))

    @property
    def is_exchange(self) -> bool:
        """Readings stand in the places of others."""
        return len(self.suspects.source) > 0

    @property
    def is_meant(self) -> bool:
        """It is one that people make: not just a reading far off, nor factors that undo another."""
        if self.is_exchange or self.suspects.level == PARAMETER:
            return True
        if self.is_zero:
            return len(self.suspects.rows) > 1
        size = abs(self.factor)
        return self.factor != 1.0 and any(abs(size / abs(f) - 1.0) < 1e-6 for f in FACTORS)


Refit = Callable[[Problem], Floats | None]
"""Parameters (n,) of least misfit, from the start of a problem; None where there are none."""


Errors = Callable[[Floats, Floats], tuple[Floats, SharedErrors]]
"""The errors of readings (g,), of which the model says (g,), SI, and those of the model itself.

Standard deviations (g,) of what each has by itself, and what they share.
"""


def find_mistakes(
    problem: Problem,
    errors: Errors,
    places: Sequence[Floats],
    suspects: Sequence[Suspects],
    refit: Refit,
) -> tuple[Mistake, ...]:
    """The mistakes that explain why readings do not fit, what explains most first.

    Sound readings cost no evaluation of the model beside those at the first of the places.

    Args:
        problem: the readings; neither its loss nor its errors matter.
        errors: of the readings; known again once these are corrected.
        places: parameters (n,), SI, at which the model is linearised: the estimate first, then
            others for a fit that has ended far from all.
        suspects: the readings that may be wrong together.
        refit: finds the parameters of changed readings.
    """
    problem = replace(problem, loss=SquaredOptions())
    found: dict[tuple[str, bytes], Mistake] = {}
    for _ in range(_MOST):
        sd, shared = errors(problem.measured, problem.response.evaluate(places[0])[0])
        weighed = replace(problem, sd=sd, shared=shared)
        step = _Search(weighed, errors, tuple(suspects), refit).best(places)
        if step is None:
            break
        mistake, problem = step
        key = mistake.suspects.key
        found[key] = mistake if key not in found else _one_after_the_other(found[key], mistake)
        places = [mistake.values]
    return tuple(mistake for mistake in found.values() if mistake.is_meant)


def _one_after_the_other(first: Mistake, second: Mistake) -> Mistake:
    """Two mistakes of the same readings, of which the second was seen beside the first."""
    return replace(
        second,
        factor=first.factor * second.factor,
        offset=first.offset * second.factor + second.offset,
        before=first.before,
        shift=first.shift + second.shift,
    )


@dataclass(frozen=True)
class _Hypothesis:
    """Suspects, and the factor that would make them right; None for a missed zero."""

    suspects: Suspects
    factor: float | None

    @property
    def kind(self) -> str:
        """Those of one kind are counted together."""
        if len(self.suspects.source):
            return "exchange"
        return "zero" if self.factor is None else "factor"


@dataclass(frozen=True)
class _Fitted:
    """A hypothesis that was fitted.

    Args:
        hypothesis: it.
        score: in its favour.
        offset: (m,) of the zeros, SI.
        at: the corrected readings, and the model there.
        uncertainty: standard deviation of the factor that the other readings tell, in parts of it.
        released: (k,) numbers of the parameters that leave their bounds, which alone shows it.
    """

    hypothesis: _Hypothesis
    score: float
    offset: Floats
    at: Linearized
    uncertainty: float = 0.0
    released: Ints = field(default_factory=lambda: _NONE)


@dataclass(frozen=True)
class _Search:
    """A search for the next mistake.

    Args:
        problem: with what was corrected before.
        errors: of readings.
        suspects: what may be wrong.
        refit: finds parameters.
    """

    problem: Problem
    errors: Errors
    suspects: tuple[Suspects, ...]
    refit: Refit

    def best(self, places: Sequence[Floats]) -> tuple[Mistake, Problem] | None:
        """The mistake that explains most, and the problem without it; None where none does."""
        first = self._linearized(self.problem, places[0])
        if first is None:
            return None
        # what is fitted has other weights: near its minimum the least misfit is that of these
        misfit = first.least if first.objective < 2.0 * first.least + CERTAIN else first.objective
        looked = [self._promising(first, misfit)]
        if self._far(first):
            elsewhere = (self._linearized(self.problem, place) for place in places[1:])
            looked += [self._promising(at, misfit) for at in elsewhere if at is not None]
        # the best of each place first: far from the answer all look better than they are
        turns = [entry for turn in zip_longest(*looked) for entry in turn if entry is not None]
        trials = {(id(one.suspects), one.factor): (one, start) for one, start in reversed(turns)}
        doubtful, held = self._doubtful(first), self._held(first)
        if not (trials or doubtful or held):
            return None
        as_read = self._refitted(self.problem, first.values)
        if as_read is None or as_read.objective > first.objective:
            as_read = first
        fitted = self._fits(list(reversed(trials.values())), as_read)
        doubtful = sorted({*doubtful, *self._doubtful(as_read)})
        fitted += [fit for k in doubtful if (fit := self._fitted_numbers(k, as_read)) is not None]
        if not fitted and held and (fit := self._fitted_inside(as_read)) is not None:
            fitted.append(fit)
        if not fitted:
            return None
        fitted.sort(key=lambda one: -one.score)
        best, others = self._likeliest(fitted, as_read)
        rivals = tuple(self._mistake(one, as_read) for one in others)
        return replace(self._mistake(best, as_read), rivals=rivals), best.at.problem

    def _fits(
        self, trials: Sequence[tuple[_Hypothesis, Floats]], as_read: Linearized
    ) -> list[_Fitted]:
        """The few likeliest hypotheses of each kind, fitted."""
        fitted: list[_Fitted] = []
        explained: Ints = _NONE  # by what leaves nothing to explain
        tried: Counter[bool] = Counter()
        for one, start in trials:
            exchange = one.kind == "exchange"
            if not exchange and np.intersect1d(one.suspects.rows, explained).size:
                continue
            if tried[exchange] == (_EXCHANGED if exchange else _TRIED):
                continue
            tried[exchange] += 1
            fit = self._fitted(one, start, as_read)
            if fit is not None:
                fitted.append(fit)
                if not self._far(fit.at):
                    explained = np.union1d(explained, one.suspects.rows)
        return fitted

    def _likeliest(
        self, fitted: Sequence[_Fitted], as_read: Linearized
    ) -> tuple[_Fitted, list[_Fitted]]:
        """Of hypotheses, best score first: the one to be named, and those that explain as much."""
        first = fitted[0]
        if self._of_all(first.hypothesis) or first.hypothesis.suspects.level == PARAMETER:
            alike: dict[tuple[str, bytes], _Fitted] = {}
            for one in fitted:
                if self._of_all(one.hypothesis) or one.hypothesis.suspects.level == PARAMETER:
                    alike.setdefault(one.hypothesis.suspects.key, one)

            # the data are the same to all of these but for the size of the errors
            # and one number of the case is wrong more often than all those of a parameter
            def order(one: _Fitted) -> tuple[bool, float]:
                likelier = _EQUAL if self._of_all(one.hypothesis) else 0.0
                return not self._odd_prior(one), min(self._plain(one)) - likelier

            first, *others = sorted(alike.values(), key=order)
        else:
            near = [one for one in fitted if one.score > first.score - _EQUAL]
            # a name in the wrong place is likelier than readings that happen to be ten times those
            first = next((one for one in near if one.hypothesis.kind == "exchange"), first)
            mine = first.hypothesis.suspects.rows
            apart = {first.hypothesis.suspects.key: first}
            for one in near:
                if not np.intersect1d(one.hypothesis.suspects.rows, mine).size:
                    apart.setdefault(one.hypothesis.suspects.key, one)
            # of several that nothing tells apart, the one nearest to what was thought before
            first, *others = sorted(apart.values(), key=self._from_start)
        first = min((first, *self._other_factors(first, as_read)), key=self._from_start)
        return first, others

    def _odd_prior(self, one: _Fitted) -> bool:
        """The start value of the parameter agrees with the estimate, and its prior does not."""
        for k, q in enumerate(self.problem.parameters):
            if q.name == one.hypothesis.suspects.name and q.prior is not None and q.start > 0.0:
                off = abs(log(q.start / one.at.values[k])), abs(log(q.start / q.prior.mean))
                return one.hypothesis.suspects.level == PARAMETER and off[0] < off[1]
        return False

    def _other_factors(self, best: _Fitted, as_read: Linearized) -> Iterator[_Fitted]:
        """Other factors that explain as much, where the parameters take up any within bounds."""
        factor = best.hypothesis.factor
        if factor is None or best.uncertainty < _UNCERTAIN:
            return
        for other in FACTORS:
            if other != factor and other * factor > 0.0:
                one = replace(best.hypothesis, factor=other)
                fit = self._fitted(one, best.at.values, as_read)
                if fit is not None and fit.score > best.score - _EQUAL:
                    yield fit

    def _of_all(self, one: _Hypothesis) -> bool:
        """One factor on all readings."""
        return one.kind == "factor" and len(one.suspects.rows) == len(self.problem.measured)

    def _of_most(self, one: _Hypothesis) -> bool:
        """One factor on more than half of the readings: the errors of these are as written."""
        return one.kind == "factor" and 2 * len(one.suspects.rows) > len(self.problem.measured)

    def _plain(self, one: _Fitted) -> tuple[float, float]:
        """Minus twice the logarithm of its likelihood by the accuracies alone, in two readings.

        Of a factor of all readings first as such, then as one on what loads the ground.
        """
        none = np.zeros(len(self.problem.measured))
        left = one.at.problem.measured - one.at.readings
        squares = float(np.sum((left / self.errors(none, none)[0]) ** 2))
        if not self._of_all(one.hypothesis):
            return squares, squares
        factor = abs(one.hypothesis.factor or 1.0)
        return squares - 2.0 * len(left) * log(factor), squares / factor**2

    def _from_start(self, one: _Fitted) -> float:
        """How far the parameters are from the start values, in scaled ones."""
        scaling = Scaling(one.at.problem.parameters)
        return float(np.linalg.norm(scaling.to_scaled(one.at.values) - scaling.start))

    def _mistake(self, one: _Fitted, as_read: Linearized) -> Mistake:
        count, scaling = len(self.problem.measured), Scaling(one.at.problem.parameters)
        moved = scaling.to_scaled(one.at.values) - scaling.to_scaled(as_read.values)
        of_readings, of_loads = self._plain(one)
        return Mistake(
            one.hypothesis.suspects,
            one.hypothesis.factor or 1.0,
            one.offset,
            float(np.sqrt(as_read.objective / count)),
            float(np.sqrt(one.at.objective / count)),
            one.at.values,
            moved / (one.at.scatter * np.sqrt(np.diag(one.at.C))),
            of_all=self._of_all(one.hypothesis),
            of_loads=of_loads < of_readings,
            released=one.released,
        )

    def _linearized(self, problem: Problem, p: Floats) -> Linearized | None:
        try:
            return Linearized(problem, p)
        except (ModelError, np.linalg.LinAlgError):
            return None

    def _refitted(self, problem: Problem, start: Floats) -> Linearized | None:
        values = self.refit(problem.begun_at(start))
        return None if values is None else self._linearized(problem, values)

    # What promises to explain the misfit --------------------------------------------------------

    def _promising(self, at: Linearized, misfit: float) -> list[tuple[_Hypothesis, Floats]]:
        """The few hypotheses that promise most at a point, and where to begin."""
        scored = [
            (misfit - at.least + gain - self._penalty(one), one)
            for gain, one in (*self._factors(at), *self._zeros(at), *self._exchanges(at))
        ]
        scored.sort(key=lambda entry: -entry[0])
        tried: Counter[bool] = Counter()
        promising = []
        for score, one in scored:
            exchange = one.kind == "exchange"
            tried[exchange] += 1
            if score > CERTAIN and tried[exchange] <= (_EXCHANGED if exchange else _TRIED):
                promising.append((one, at.values))
        return promising

    def _penalty(self, one: _Hypothesis) -> float:
        """2 ln(number of hypotheses of a kind), for those of one level."""
        number, levels = self._counted[one.kind, one.suspects.level]
        number *= len(FACTORS) if one.kind == "factor" else 1
        if one.kind == "zero" and len(one.suspects.rows) == 1:
            number *= _SELDOM
        return 2.0 * log(number * levels)

    @cached_property
    def _counted(self) -> dict[tuple[str, str], tuple[int, int]]:
        """Kind and level of hypotheses to how many there are, and how many levels of the kind."""
        counts: Counter[tuple[str, str]] = Counter()
        for one in self.suspects:
            kinds = ["exchange"] if len(one.source) else ["factor"]
            counts.update((kind, one.level) for kind in kinds + ["zero"] * bool(len(one.channels)))
        levels = Counter(kind for kind, _ in counts)
        return {(kind, level): (n, levels[kind]) for (kind, level), n in counts.items()}

    def _factors(self, at: Linearized) -> Iterator[tuple[float, _Hypothesis]]:
        """By how much factors reduce the misfit."""
        suspects = [one for one in self.suspects if not len(one.source)]
        rows = np.concatenate([one.rows for one in suspects])
        ends = np.cumsum([0, *(len(one.rows) for one in suspects)])
        read = self.problem.measured
        U = sp.csc_array((read[rows], rows, ends), shape=(len(read), len(suspects)))
        a, b = at.curvature(U), np.asarray(U.T @ at.force)
        t = np.array(FACTORS)[:, None] - 1.0
        as_read = np.log(self.errors(read, read)[0])
        changed = [np.log(self.errors(f * read, f * read)[0] / abs(f)) for f in FACTORS]
        narrower = np.maximum(0.0, np.array(changed) - as_read)
        gains = -(2.0 * t * b + t**2 * a) - 2.0 * np.add.reduceat(narrower[:, rows], ends[:-1], 1)
        for k, one in enumerate(suspects):
            if len(one.rows) == len(read):  # the model times 1/f, with the errors as written
                gains[:, k] = [
                    at.least
                    - Linearized(at.problem, at.values, (at.readings / f, at.slope / f)).least
                    for f in FACTORS
                ]
        likeliest = np.argmax(gains, axis=0)
        for k in np.flatnonzero(a > 0.0).tolist():
            i = int(likeliest[k])
            yield float(gains[i, k]), _Hypothesis(suspects[k], FACTORS[i])

    def _exchanges(self, at: Linearized) -> Iterator[tuple[float, _Hypothesis]]:
        """By how much exchanges do."""
        suspects = [one for one in self.suspects if len(one.source)]
        if not suspects:
            return
        read = self.problem.measured
        rows = np.concatenate([one.rows for one in suspects])
        change = read[np.concatenate([one.source for one in suspects])] - read[rows]
        ends = np.cumsum([0, *(len(one.rows) for one in suspects)])
        U = sp.csc_array((change, rows, ends), shape=(len(read), len(suspects)))
        most = -2.0 * np.asarray(U.T @ at.force)  # less a, which is positive
        chosen = np.argsort(-most)[:_LOOKED]
        gains = most[chosen] - at.curvature(U[:, chosen])
        for k, gain in zip(chosen.tolist(), gains.tolist(), strict=True):
            yield gain, _Hypothesis(suspects[k], 1.0)

    def _zeros(self, at: Linearized) -> Iterator[tuple[float, _Hypothesis]]:
        """By how much missed zeros do, as likelihoods."""
        suspects = [one for one in self.suspects if len(one.channels)]
        alone = [one for one in suspects if np.ptp(one.channels) == 0]
        if alone:  # all of one channel at once: there may be as many as readings
            rows = np.concatenate([one.rows for one in alone])
            counts = [len(one.rows) for one in alone]
            ends = np.cumsum([0, *counts])
            both = np.abs(self.problem.measured) + np.abs(at.readings)
            size = np.repeat(np.maximum.reduceat(both[rows], ends[:-1]), counts)
            U = sp.csc_array((size, rows, ends), shape=(len(both), len(alone)))
            variance = 1.0 + at.curvature(U)
            gains = (U.T @ at.force) ** 2 / variance - np.log(variance)
            for gain, one in zip(gains.tolist(), alone, strict=True):
                yield gain, _Hypothesis(one, None)
        for one in suspects:
            if np.ptp(one.channels) > 0:
                W = self._of_zeros(one, at.readings)
                fall, spread = at.with_normal(W, W.T @ at.force)
                yield fall - spread, _Hypothesis(one, None)

    def _of_zeros(self, suspects: Suspects, computed: Floats) -> sp.csc_array:
        """(g, c) the errors of the zeros of c channels, in the standard deviations they have."""
        rows = suspects.rows
        names, column = np.unique(suspects.channels, return_inverse=True)
        size = np.zeros(len(names))
        np.maximum.at(size, column, np.abs(self.problem.measured[rows]) + np.abs(computed[rows]))
        return sp.csc_array((size[column], (rows, column)), shape=(len(computed), len(names)))

    def _doubtful(self, at: Linearized) -> list[int]:
        """Parameters whose prior contradicts the readings, or that a bound keeps from them."""
        contradicted = [
            k
            for k, q in enumerate(self.problem.parameters)
            if q.prior and abs(q.prior.score(float(at.values[k]))) > _CONTRADICTED
        ]
        bound = self._at_bounds(at) if contradicted or self._far(at) else _NONE
        return sorted({*contradicted, *bound.tolist()})

    def _held(self, at: Linearized) -> bool:
        """Most parameters are at a bound, two at least."""
        count = len(self._at_bounds(at))
        return count >= 2 and 2 * count >= len(self.problem.parameters)

    # Fits of what promises to -------------------------------------------------------------------

    def _fitted(self, one: _Hypothesis, start: Floats, as_read: Linearized) -> _Fitted | None:
        """A hypothesis, fitted; None where it does not explain the readings."""
        match one.kind:
            case "zero":
                return self._fitted_zero(one, start, as_read)
            case "exchange":
                return self._fitted_exchange(one, start, as_read)
        for _ in range(_CORRECTED):
            at = self._with_factor(one, start)
            if at is None:
                return None
            rows, read = one.suspects.rows, at.problem.measured
            U = sp.csc_array((read[rows], (rows, np.zeros_like(rows))), shape=(len(read), 1))
            a, b = float(at.curvature(U)[0]), float(read[rows] @ at.force[rows])
            if a <= 0.0:
                return None
            factor = 1.0 - b / a
            assert one.factor is not None
            model = _MODEL_OF_SIGN if one.factor == -1.0 else _MODEL
            if abs(factor - 1.0) <= _AGREES * np.sqrt(at.scatter**2 / a + model**2):
                score = self._score(one, at, as_read) + 2.0 * len(rows) * log(abs(one.factor))
                if score < CERTAIN or not self._convinces(one, at, as_read, a):
                    return None
                return _Fitted(one, score, np.zeros(len(rows)), at, at.scatter / float(np.sqrt(a)))
            wanted = [f for f in FACTORS if abs(f - factor * one.factor) < _NEARLY * abs(f)]
            if not wanted:
                return None
            one, start = replace(one, factor=wanted[0]), at.values
        return None

    def _convinces(self, one: _Hypothesis, at: Linearized, as_read: Linearized, a: float) -> bool:
        """Whether a factor that lowers the misfit is also what the readings say.

        Args:
            one: the hypothesis.
            at: its fit.
            as_read: the fit without it.
            a: curvature of the misfit along the corrected readings.
        """
        assert one.factor is not None
        rows, read = one.suspects.rows, at.problem.measured
        if float(np.sqrt(np.mean(at.residuals(rows) ** 2))) > _AGREES * at.scatter:
            return False
        u = np.zeros(len(read))
        u[rows] = read[rows]
        followed = a < _FOLLOWED * float(u @ at.covariance.solve(u))  # the parameters could
        if followed and one.factor > 0.0 and self._strained(as_read) <= self._strained(at):
            return False
        if self._of_most(one):
            return at.objective < _CURED * as_read.objective
        if abs(one.factor) >= 1.0 or len(rows) == 1:
            return True
        none = np.zeros(len(read))  # what is next to nothing fits anything
        accuracy = self.errors(none, none)[0][rows]
        return float(np.sqrt(np.mean((read[rows] / accuracy) ** 2))) > _CLEAR_FACTOR

    def _with_factor(self, one: _Hypothesis, start: Floats) -> Linearized | None:
        """The estimate where a factor is right, with the errors that belong to it."""
        assert one.factor is not None
        factor = np.ones(len(self.problem.measured))
        factor[one.suspects.rows] = one.factor
        changed = replace(self.problem, measured=factor * self.problem.measured)
        if not self._of_most(one):
            at = self._refitted(changed, start)
            return None if at is None else self._weighed(at)
        at = self._refitted(_with_errors(changed, self.problem, factor), start)
        if at is None:
            return None
        sd, shared = self.errors(self.problem.measured, at.readings / factor)
        weighed = replace(self.problem, sd=sd, shared=shared)
        return self._linearized(_with_errors(at.problem, weighed, factor), at.values)

    def _fitted_exchange(
        self, one: _Hypothesis, start: Floats, as_read: Linearized
    ) -> _Fitted | None:
        rows = one.suspects.rows
        read = self.problem.measured.copy()
        read[rows] = self.problem.measured[one.suspects.source]
        at = self._refitted(replace(self.problem, measured=read), start)
        at = None if at is None else self._weighed(at)
        if at is None:
            return None
        score = self._score(one, at, as_read)
        size = float(np.sqrt(np.mean(at.residuals(rows) ** 2)))
        fits = size <= _AGREES * at.scatter and score > CERTAIN
        return _Fitted(one, score, np.zeros(len(rows)), at) if fits else None

    def _fitted_numbers(self, k: int, as_read: Linearized) -> _Fitted | None:
        """A factor on the numbers of a parameter, start, bounds and prior; None for none."""
        q = self.problem.parameters[k]
        middle = q.start if q.prior is None else q.prior.mean
        if q.lower < 0.0 or middle <= 0.0:
            return None  # of no size that a unit could have changed
        wide = replace(q, prior=None, lower=1e-3 * q.lower, upper=1e3 * q.upper)
        freed = self._refitted(self._with_parameter(k, wide), as_read.values)
        if freed is None or freed.values[k] <= 0.0:
            return None
        powers = POWERS if q.dimension not in ("dimensionless", "angle") else POWERS[:2]
        factor = min(powers, key=lambda f: abs(log(freed.values[k] / (f * middle))))
        if abs(log(freed.values[k] / (factor * middle))) > log(_ABOUT):
            return None
        changed = self._with_parameter(k, _times(q, factor))
        at = self._refitted(changed, freed.values)
        at = None if at is None else self._weighed(at)
        if at is None or k in self._at_bounds(at):
            return None
        prior = at.problem.parameters[k].prior
        suspects = Suspects(_NONE, PARAMETER, q.name)
        one = _Hypothesis(suspects, factor)
        score = self._score_of(at, as_read)
        score -= 2.0 * log(len(POWERS) * len(self.problem.parameters))
        if prior is None:
            fits = at.objective < _CURED * as_read.objective
        else:
            fits = abs(prior.score(float(at.values[k]))) < _CONTRADICTED
        return _Fitted(one, score, np.zeros(0), at) if fits and score > CERTAIN else None

    def _with_parameter(self, k: int, q: Parameter) -> Problem:
        parameters = list(self.problem.parameters)
        parameters[k] = q
        return replace(self.problem, parameters=tuple(parameters))

    def _fitted_inside(self, as_read: Linearized) -> _Fitted | None:
        """A factor on all readings that takes all parameters from their bounds; None for none."""
        bound = self._at_bounds(as_read)
        moduli = [k for k in bound.tolist() if self.problem.parameters[k].scale == "log"]
        if not self._held(as_read) or not moduli:
            return None
        wide = self.problem
        for k in moduli:
            q = wide.parameters[k]
            wider = replace(q, lower=1e-3 * q.lower, upper=1e3 * q.upper)
            wide = replace(self, problem=wide)._with_parameter(k, wider)
        freed = self._refitted(wide, as_read.values)
        whole = [
            one
            for one in self.suspects
            if not len(one.source) and len(one.rows) == len(self.problem.measured)
        ]
        if freed is None or not whole:
            return None
        off = np.median([log(freed.values[k] / self.problem.parameters[k].start) for k in moduli])
        factor = min((f for f in FACTORS if f > 0.0), key=lambda f: abs(log(f) - off))
        one = _Hypothesis(whole[0], factor)
        at = self._with_factor(one, self.problem.start)
        if at is None or len(self._at_bounds(at)) or self._far(at):
            return None
        none = np.zeros(len(one.suspects.rows))
        return _Fitted(one, CERTAIN, none, at, released=bound)

    def _fitted_zero(self, one: _Hypothesis, start: Floats, as_read: Linearized) -> _Fitted | None:
        rows, columns = one.suspects.rows, one.suspects.channels
        W = self._of_zeros(one.suspects, self.problem.response.evaluate(start)[0])
        shared = self.problem.shared
        known = sp.csr_array((W.shape[0], 0)) if shared is None else shared.columns
        free = replace(self.problem, shared=SharedErrors(sp.csr_array(sp.hstack([known, W]))))
        at = self._refitted(free, start)
        if at is None:
            return None
        assert free.covariance is not None
        z = free.covariance.expected_shared(at.problem.measured - at.readings)[known.shape[1] :]
        offset = (W @ z)[rows]
        largest = np.abs(at.readings[rows]).max()
        clear = (np.abs(offset) > _CLEAR_ZERO * largest) | (len(rows) == 1)
        per_channel = [clear[columns == channel].any() for channel in np.unique(columns)]
        read = self.problem.measured.copy()
        read[rows] -= offset
        corrected = self._linearized(replace(self.problem, measured=read), at.values)
        corrected = None if corrected is None else self._weighed(corrected)
        if corrected is None or 2 * sum(per_channel) <= len(per_channel):
            return None
        _, widened = corrected.with_normal(W, np.zeros(W.shape[1]))
        score = self._score(one, corrected, as_read) - widened
        score -= float(z @ z)  # what the zeros themselves are by their own standard deviations
        return _Fitted(one, score, offset, corrected) if score > CERTAIN else None

    def _score(self, one: _Hypothesis, at: Linearized, as_read: Linearized) -> float:
        return self._score_of(at, as_read) - self._penalty(one)

    def _score_of(self, at: Linearized, as_read: Linearized) -> float:
        """In favour of a fit, before it counts how many others there are."""
        spread = as_read.covariance.log_determinant() - at.covariance.log_determinant()
        return (as_read.objective - at.least) / at.scatter**2 + spread

    def _far(self, at: Linearized) -> bool:
        """The misfit is clearly more than the errors explain."""
        count = len(self.problem.sd)
        return bool(at.objective > count + _FAR * np.sqrt(2.0 * count))

    def _at_bounds(self, at: Linearized) -> Ints:
        """Numbers of the parameters that are at a bound."""
        scaling = Scaling(at.problem.parameters)
        x = scaling.to_scaled(at.values)
        return np.flatnonzero((x <= scaling.lower + _AT) | (x >= scaling.upper - _AT))

    def _strained(self, at: Linearized) -> int:
        """How many parameters are at a bound or far from their priors."""
        rho = Scaling(at.problem.parameters).prior_residuals(at.values)
        return len(self._at_bounds(at)) + int(np.count_nonzero(np.abs(rho) > _CONTRADICTED))

    def _weighed(self, at: Linearized) -> Linearized | None:
        """The same with the accuracies that belong to these readings."""
        sd, shared = self.errors(at.problem.measured, at.readings)
        return self._linearized(replace(at.problem, sd=sd, shared=shared), at.values)


def _with_errors(problem: Problem, of: Problem, factor: Floats) -> Problem:
    """A problem with the errors of another times factors (g,) of the readings."""
    shared = of.shared
    if shared is not None:
        shared = SharedErrors(sp.csr_array(sp.diags_array(np.abs(factor)) @ shared.columns))
    return replace(problem, sd=of.sd * np.abs(factor), shared=shared)


def _times(q: Parameter, factor: float) -> Parameter:
    """A parameter whose numbers are all multiplied with a factor."""
    prior = q.prior
    if prior is not None:
        prior = replace(prior, mean=factor * prior.mean, sd=factor * prior.sd)
    start, lower, upper = (factor * number for number in (q.start, q.lower, q.upper))
    # a bound that a prior does not need may have been right all the time
    if prior is not None:
        lower, upper = min(lower, q.lower), max(upper, q.upper)
    return replace(q, start=start, lower=lower, upper=upper, prior=prior)


_AT = 1e-3
"""Distance from a bound in scaled parameters that is none."""
_FOLLOWED = 0.1
"""Part of a change of readings that parameters leave where they follow it, unless bounded."""
_CURED = 0.25
"""Part of the misfit that may be left where one factor on all readings is named."""
_UNCERTAIN = 0.3
"""Uncertainty of a factor from which on the readings do not tell one of `FACTORS` from another."""
_SELDOM = 100
"""Times that a sign or unit is wrong in one reading more often than the reading as a whole."""
_NEARLY = 0.35
"""Relative difference of a factor that the readings tell from one that can be meant."""
_CORRECTED = 3
"""Times that a factor gives way to the one that the readings tell."""
_FAR = 4.0
"""Standard deviations of a sum of squares beyond which a fit is looked at from elsewhere, too."""
_EXCHANGED = 3
"""Exchanges that are fitted."""
_LOOKED = 500
"""Exchanges of which the gain is computed."""
_CONTRADICTED = 2.6
"""Standard deviations of a prior by which readings contradict it: 1 in 100."""
_ABOUT = 4.0
"""Times a parameter that is freed may be off the number that is meant."""

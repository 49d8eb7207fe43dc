"""Readings with a wrong sign, unit or zero: what each would have to be for all others to fit.

A mistake changes the readings I that were written together (one cell, the column of a channel, the
sheet of an instrument) by one factor, or adds one number to each channel of them. With the model
linearised at p (v, J in scaled parameters, rows R of the priors with residuals rho), d = v* - v and
the covariance S of the errors, the least misfit over all parameters is

    chi2(d) = d^T S^-1 d + |rho|^2 - h^T C h       h = J^T S^-1 d - R^T rho ,
                                                   C = (J^T S^-1 J + R^T R)^-1

and of changed readings d + t u, with u = v*_I for a factor 1 + t and u = 1_I for a zero,

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
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import zip_longest

import numpy as np
import scipy.sparse as sp

from geoident.errors import ModelError
from geoident.identify.problem.losses import robust_scale
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.scaling import Scaling
from geoident.identify.problem.shared_errors import Covariance, SharedErrors
from geoident.model.arrays import Floats, Ints
from geoident.model.methods import SquaredOptions

FACTORS = (-1.0, 10.0, 0.1, 100.0, 0.01, 1000.0, 0.001, 25.4, 1.0 / 25.4)
"""What readings would have to be multiplied with: the sign, decimal points and units, inches."""

CERTAIN = 10.0
"""Score from which on a mistake is named: odds of 150."""

_EQUAL = 6.0
"""Difference of scores below which two mistakes explain the readings equally well: odds of 20."""

_AGREES = 3.0
"""Standard deviations by which the factor of the other readings may differ from the named one."""

_MODEL = 0.1
"""Relative error of any model, beside that of the readings, in this comparison of factors."""

_TRIED = 4
"""Hypotheses that are fitted before one is named or none."""

_MOST = 5
"""Mistakes that are named in one fit."""

_CLEAR_ZERO = 0.25
"""Part of the largest motion of a channel that a missed zero is at least.

A model error is of a tenth to a fifth of the motion.
"""


@dataclass(frozen=True)
class Suspects:
    """Readings that one mistake would have changed together.

    Args:
        rows: (m,) numbers of the readings.
        level: what they are, such as ``channel``; mistakes of one level are equally likely.
        name: of what they belong to.
        channels: (m,) numbers of the channels whose zero may have been missed; none where no zero
            is suspected. Of a single reading it means that it may be wrong by any number.
    """

    rows: Ints
    level: str
    name: str
    channels: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))


@dataclass(frozen=True)
class Mistake:
    """A mistake that explains why readings do not fit.

    Args:
        suspects: the readings.
        factor: that makes them right; 1 where their zero is wrong.
        offset: (m,) what is to be subtracted from them, SI; 0 where the factor is wrong.
        before: root of the mean square of all residuals in their accuracies, as read.
        after: the same where the readings are as they should be.
        values: (n,) the estimate then, SI.
        shift: (n,) by how much it differs from that as read, in standard deviations.
        rivals: other mistakes that explain the readings as well.
    """

    suspects: Suspects
    factor: float
    offset: Floats
    before: float
    after: float
    values: Floats
    shift: Floats
    rivals: tuple[Mistake, ...] = ()

    @property
    def is_zero(self) -> bool:
        """The zero is wrong."""
        return bool(np.any(self.offset != 0.0))

    @property
    def is_meant(self) -> bool:
        """It is one that people make: not just a reading far off, nor factors that undo another."""
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
    found: dict[bytes, Mistake] = {}
    for _ in range(_MOST):
        sd, shared = errors(problem.measured, problem.response.evaluate(places[0])[0])
        weighed = replace(problem, sd=sd, shared=shared)
        step = _Search(weighed, errors, tuple(suspects), refit).best(places)
        if step is None:
            break
        mistake, problem = step
        key = mistake.suspects.rows.tobytes()
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
    """Readings, and the factor that would make them right; None for a missed zero."""

    suspects: Suspects
    factor: float | None


@dataclass(frozen=True)
class _Fitted:
    """A hypothesis that was fitted.

    Args:
        hypothesis: it.
        score: in its favour.
        offset: (m,) of the zeros, SI.
        at: the corrected readings, and the model there.
        uncertainty: standard deviation of the factor that the other readings tell, in parts of it.
    """

    hypothesis: _Hypothesis
    score: float
    offset: Floats
    at: _Linearized
    uncertainty: float = 0.0


class _Linearized:
    """A problem with its model linearised at one point, and the least misfit of changed readings.

    Args:
        problem: with the squared loss.
        p: (n,) parameters, SI.

    Raises:
        ModelError: the model has no solution there.
    """

    def __init__(self, problem: Problem, p: Floats) -> None:
        v, dv_dp = problem.response.evaluate(p)
        scaling = Scaling(problem.parameters)
        J, d = dv_dp * scaling.dp_dx(p), problem.measured - v
        if not (np.all(np.isfinite(J)) and np.all(np.isfinite(d))):
            raise ModelError("The readings are not finite.")
        self.problem, self.values, self.readings = problem, p, v
        none = SharedErrors(sp.csr_array((len(d), 0)))
        self.covariance = problem.covariance or Covariance(problem.sd, none)
        R, rho = scaling.prior_jacobian(p), scaling.prior_residuals(p)
        self.pull = self.covariance.solve(J)
        # what nothing determines stays within its bounds, or within a factor of 20
        width = np.minimum(scaling.upper - scaling.lower, _WIDEST)
        self.C = np.linalg.inv(J.T @ self.pull + R.T @ R + np.diag(width**-2.0))
        force = self.covariance.solve(d)
        h = J.T @ force - R.T @ rho
        self.objective = float(d @ force + rho @ rho)
        self.least = self.objective - float(h @ self.C @ h)
        self.force = force - self.pull @ (self.C @ h)
        self.root = self.pull @ np.linalg.cholesky(self.C)

    def curvature(self, columns: sp.csc_array) -> Floats:
        """The diagonal of a, (k,), of directions u (g, k)."""
        white = np.zeros(columns.shape[1])
        counts = np.diff(columns.indptr)
        alone, several = np.flatnonzero(counts == 1), np.flatnonzero(counts > 1)
        at = columns.indptr[alone]
        for some in np.array_split(several, max(1, len(several) // _AT_ONCE)):
            if len(some):
                dense = np.asarray(columns[:, some].toarray())
                white[some] = np.sum(self.covariance.whiten(dense) ** 2, axis=0)
        left = white - np.sum(np.asarray(columns.T @ self.root) ** 2, axis=1)
        left[left < _NOTHING * white] = 0.0
        left[alone] = columns.data[at] ** 2 * self.own[columns.indices[at]]
        return np.asarray(left)

    def matrix(self, columns: Floats) -> Floats:
        """A (k, k) of directions u (g, k)."""
        across = columns.T @ self.root
        return np.asarray(columns.T @ self.covariance.solve(columns) - across @ across.T)

    @cached_property
    def own(self) -> Floats:
        """The diagonal (g,) of a for single readings by one; 0 where a reading decides alone."""
        whole = self.covariance.inverse_diagonal
        left = whole - np.sum(self.root**2, axis=1)
        return np.where(left > _NOTHING * whole, left, 0.0)

    def residuals(self, rows: Ints) -> Floats:
        """Of those of some readings that others judge, in their own standard deviations."""
        seen = rows[self.own[rows] > 0.0]
        return np.asarray(self.force[seen] / np.sqrt(self.own[seen]))

    @cached_property
    def scatter(self) -> float:
        """Of the residuals in their standard deviations, by the median; one at least."""
        residuals = self.residuals(np.arange(len(self.own)))
        return max(1.0, robust_scale(residuals)) if residuals.size else 1.0


_WIDEST = 3.0
"""Standard deviation in scaled parameters of what the readings leave open."""
_NOTHING = 1e-9
"""Part of a reading that is rounding where all of it went into the parameters."""
_AT_ONCE = 500
"""Directions that are whitened together."""


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
        if not trials:
            return None
        as_read = self._refitted(self.problem, first.values)
        if as_read is None or as_read.objective > first.objective:
            as_read = first
        fitted: list[_Fitted] = []
        explained: Ints = np.zeros(0, dtype=np.int64)  # by what leaves nothing to explain
        for one, start in list(reversed(trials.values()))[:_TRIED]:
            if np.intersect1d(one.suspects.rows, explained).size:
                continue
            fit = self._fitted(one, start, as_read)
            if fit is not None:
                fitted.append(fit)
                if not self._far(fit.at):
                    explained = np.union1d(explained, one.suspects.rows)
        if not fitted:
            return None
        fitted.sort(key=lambda one: -one.score)
        alike: dict[bytes, _Fitted] = {}
        for one in fitted:
            rows = one.hypothesis.suspects.rows
            apart = not np.intersect1d(rows, fitted[0].hypothesis.suspects.rows).size
            if one is fitted[0] or (apart and one.score > fitted[0].score - _EQUAL):
                alike.setdefault(rows.tobytes(), one)
        # of several that nothing tells apart, the one nearest to what was thought before
        best, *others = sorted(alike.values(), key=self._from_start)
        best = min((best, *self._other_factors(best, as_read)), key=self._from_start)
        rivals = tuple(self._mistake(one, as_read) for one in others)
        return replace(self._mistake(best, as_read), rivals=rivals), best.at.problem

    def _other_factors(self, best: _Fitted, as_read: _Linearized) -> Iterator[_Fitted]:
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

    def _from_start(self, one: _Fitted) -> float:
        """How far the parameters are from the start values, in scaled ones."""
        scaling = Scaling(self.problem.parameters)
        return float(np.linalg.norm(scaling.to_scaled(one.at.values) - scaling.start))

    def _mistake(self, one: _Fitted, as_read: _Linearized) -> Mistake:
        count, scaling = len(self.problem.measured), Scaling(self.problem.parameters)
        moved = scaling.to_scaled(one.at.values) - scaling.to_scaled(as_read.values)
        return Mistake(
            one.hypothesis.suspects,
            one.hypothesis.factor or 1.0,
            one.offset,
            float(np.sqrt(as_read.objective / count)),
            float(np.sqrt(one.at.objective / count)),
            one.at.values,
            moved / (one.at.scatter * np.sqrt(np.diag(one.at.C))),
        )

    def _linearized(self, problem: Problem, p: Floats) -> _Linearized | None:
        try:
            return _Linearized(problem, p)
        except (ModelError, np.linalg.LinAlgError):
            return None

    def _refitted(self, problem: Problem, start: Floats) -> _Linearized | None:
        values = self.refit(problem.begun_at(start))
        return None if values is None else self._linearized(problem, values)

    def _promising(self, at: _Linearized, misfit: float) -> list[tuple[_Hypothesis, Floats]]:
        """The few hypotheses that promise most at a point, and where to begin."""
        scored = [
            (misfit - at.least + gain - self._penalty(one), one)
            for gain, one in (*self._factors(at), *self._zeros(at))
        ]
        scored.sort(key=lambda entry: -entry[0])
        return [(one, at.values) for score, one in scored[:_TRIED] if score > CERTAIN]

    def _penalty(self, one: _Hypothesis) -> float:
        """2 ln(number of hypotheses of a kind), for those of one level and of factor or zero."""
        alike = Counter(s.level for s in self.suspects if one.factor or len(s.channels))
        number = alike[one.suspects.level] * (len(FACTORS) if one.factor else 1)
        if one.factor is None and len(one.suspects.rows) == 1:
            number *= _SELDOM
        return 2.0 * float(np.log(number * len(alike)))

    def _factors(self, at: _Linearized) -> Iterator[tuple[float, _Hypothesis]]:
        """By how much factors reduce the misfit."""
        rows = np.concatenate([suspects.rows for suspects in self.suspects])
        ends = np.cumsum([0, *(len(suspects.rows) for suspects in self.suspects)])
        read = self.problem.measured
        shape = (len(read), len(self.suspects))
        U = sp.csc_array((read[rows], rows, ends), shape=shape)
        a, b = at.curvature(U), np.asarray(U.T @ at.force)
        t = np.array(FACTORS)[:, None] - 1.0
        as_read = np.log(self.errors(read, read)[0])
        changed = [np.log(self.errors(f * read, f * read)[0] / abs(f)) for f in FACTORS]
        narrower = np.maximum(0.0, np.array(changed) - as_read)
        gains = -(2.0 * t * b + t**2 * a) - 2.0 * np.add.reduceat(narrower[:, rows], ends[:-1], 1)
        likeliest = np.argmax(gains, axis=0)
        for k in np.flatnonzero(a > 0.0).tolist():
            i = int(likeliest[k])
            yield float(gains[i, k]), _Hypothesis(self.suspects[k], FACTORS[i])

    def _zeros(self, at: _Linearized) -> Iterator[tuple[float, _Hypothesis]]:
        """By how much missed zeros do, as likelihoods."""
        both = np.abs(self.problem.measured) + np.abs(at.readings)
        variance = 1.0 + both**2 * at.own
        gains = (both * at.force) ** 2 / variance - np.log(variance)
        for suspects in self.suspects:
            if not len(suspects.channels):
                continue
            if len(suspects.rows) == 1:
                yield float(gains[suspects.rows[0]]), _Hypothesis(suspects, None)
                continue
            W = self._of_zeros(suspects, at.readings)
            b, A = W.T @ at.force, np.eye(W.shape[1]) + at.matrix(W)
            gain = float(b @ np.linalg.solve(A, b)) - float(np.linalg.slogdet(A)[1])
            yield gain, _Hypothesis(suspects, None)

    def _of_zeros(self, suspects: Suspects, computed: Floats) -> Floats:
        """(g, c) the errors of the zeros of c channels, in the standard deviations they have."""
        names, column = np.unique(suspects.channels, return_inverse=True)
        W = np.zeros((len(computed), len(names)))
        both = np.abs(self.problem.measured) + np.abs(computed)
        for k in range(len(names)):
            rows = suspects.rows[column == k]
            W[rows, k] = both[rows].max()
        return W

    def _fitted(self, one: _Hypothesis, start: Floats, as_read: _Linearized) -> _Fitted | None:
        """A hypothesis, fitted; None where it does not explain the readings."""
        if one.factor is None:
            return self._fitted_zero(one, start, as_read)
        rows = one.suspects.rows
        for _ in range(_CORRECTED):
            read = self.problem.measured.copy()
            read[rows] *= one.factor
            at = self._refitted(replace(self.problem, measured=read), start)
            at = None if at is None else self._weighed(at)
            if at is None:
                return None
            U = sp.csc_array((read[rows], (rows, np.zeros_like(rows))), shape=(len(read), 1))
            a, b = float(at.curvature(U)[0]), float(read[rows] @ at.force[rows])
            if a <= 0.0:
                return None
            factor = 1.0 - b / a
            if abs(factor - 1.0) <= _AGREES * np.sqrt(at.scatter**2 / a + _MODEL**2):
                size = float(np.sqrt(np.mean(at.residuals(rows) ** 2)))
                score = self._score(one, at, as_read)
                score += 2.0 * len(rows) * float(np.log(abs(one.factor)))
                none, uncertainty = np.zeros(len(rows)), at.scatter / float(np.sqrt(a))
                fits = size <= _AGREES * at.scatter and score > CERTAIN
                u = np.asarray(U.toarray())[:, 0]
                whole = float(u @ at.covariance.solve(u))
                if a < _FOLLOWED * whole and one.factor > 0.0:  # the parameters could follow
                    fits = fits and self._bounded(as_read) > self._bounded(at)
                if len(rows) == len(read):  # stress, weight or a date may be wrong as well
                    fits = fits and at.objective < _CURED * as_read.objective
                return _Fitted(one, score, none, at, uncertainty) if fits else None
            wanted = [f for f in FACTORS if abs(f - factor * one.factor) < _NEARLY * abs(f)]
            if not wanted:
                return None
            one, start = replace(one, factor=wanted[0]), at.values
        return None

    def _score(self, one: _Hypothesis, at: _Linearized, as_read: _Linearized) -> float:
        spread = as_read.covariance.log_determinant() - at.covariance.log_determinant()
        return (as_read.objective - at.least) / at.scatter**2 + spread - self._penalty(one)

    def _far(self, at: _Linearized) -> bool:
        """The misfit is clearly more than the errors explain."""
        count = len(self.problem.sd)
        return bool(at.objective > count + _FAR * np.sqrt(2.0 * count))

    def _bounded(self, at: _Linearized) -> int:
        """How many parameters are at a bound."""
        scaling = Scaling(self.problem.parameters)
        x = scaling.to_scaled(at.values)
        return int(np.count_nonzero((x <= scaling.lower + _AT) | (x >= scaling.upper - _AT)))

    def _weighed(self, at: _Linearized) -> _Linearized | None:
        """The same with the accuracies that belong to these readings."""
        sd, shared = self.errors(at.problem.measured, at.readings)
        return self._linearized(replace(at.problem, sd=sd, shared=shared), at.values)

    def _fitted_zero(self, one: _Hypothesis, start: Floats, as_read: _Linearized) -> _Fitted | None:
        rows, columns = one.suspects.rows, one.suspects.channels
        W = self._of_zeros(one.suspects, self.problem.response.evaluate(start)[0])
        shared = self.problem.shared
        known = sp.csr_array((len(W), 0)) if shared is None else shared.columns
        free = replace(
            self.problem, shared=SharedErrors(sp.csr_array(sp.hstack([known, sp.csr_array(W)])))
        )
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
        widened = float(np.linalg.slogdet(np.eye(W.shape[1]) + corrected.matrix(W))[1])
        score = self._score(one, corrected, as_read) - widened
        score -= float(z @ z)  # what the zeros themselves are by their own standard deviations
        return _Fitted(one, score, offset, corrected) if score > CERTAIN else None


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

"""The size of the model error from the residuals, and what gauges have to do with them (theory 9).

With model errors of covariance eta^2 S beside the errors of the gauges,

    Sigma = s^2 (Sigma_0 + z^2 Z) + eta^2 S .

s is one factor on all stated accuracies, and z the error of the zero of each channel, in accuracies
of one reading, where the case declares none. The restricted likelihood (theory 7), with the model
linearised at the estimate, times weak priors,

    w(eta, s, z) ~ exp(l(eta, s, z)) exp(-eta^2 / (2 * 0.3^2)) p(s) exp(-z^2 / 2) ,  s >= 1 ,

is summed over a grid. So the readings decide what explains the residuals: a model error is alike
where gauges are near to each other, that of a zero is alike in all readings of a channel, scatter
is neither. p(s) is one half at s = 1, where the accuracies are as stated, and one half lognormal.
From then on Sigma is its mean: of all that one could plug in it gives nearly the bands of the whole
mixture, since variances add up.

With Sigma_0 + z^2 Z = L L^T and the singular values sqrt(lambda_i) of L^-1 B, S = B B^T, everything
is a sum over i with the weights 1 / (s^2 + eta^2 lambda_i): a point of the grid costs next to
nothing.

Behind a tunnel face the computed course in time may be wrong as well (theory 9.1), alike in all
channels. A few readings of each cannot tell that from the parameters, so its size has a prior of
its own, is weighed on a grid, too, and does not end at zero where nothing tells of it.

Where the case wants accuracies estimated (theory 7.5), these take the place of s and z: at every
eta they have the values of highest likelihood, under a weak prior too, since a model error that
explains all residuals would let them vanish.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from geoident.identify.assessment.unknown_variances import with_possible
from geoident.identify.assessment.variance_components import (
    ConditionalLikelihood,
    Likelihood,
    RestrictedLikelihood,
    VarianceComponents,
    estimate_components,
    likeliest_factors,
)
from geoident.identify.problem.shared_errors import Covariance, SharedErrors
from geoident.model.arrays import Floats

PRIOR_SD = 0.3
"""Of the half-normal prior of eta: errors of 10 to 30 % of the motion are usual."""

ACCURACY_SPREAD = np.log(3.0)
"""Of the logarithm of an accuracy that is estimated, or stated wrongly: a factor of three."""

AS_STATED = 0.5
"""Probability that accuracies are as stated, before any residual."""

ZERO_SD = 1.0
"""Of the half-normal prior of z: a zero is one reading."""

SIZES = np.concatenate([[1e-6], np.geomspace(0.005, 1.0, 28)])
"""The eta that are weighed, (m,); the first of them stands for none."""

FACTORS = np.geomspace(1.0, 12.0, 15)
"""The s that are weighed, (f,); the first stands for accuracies as stated."""

ZEROS = np.concatenate([[0.0], np.geomspace(0.35, 5.6, 7)])
"""The z that are weighed, (z,)."""

COURSE_MODE = PRIOR_SD / np.sqrt(2.0)
"""Of the Rayleigh prior of the error of the course in time, as large in the mean square as the
model error: hardly any profile goes on exactly as the ground does."""

COURSES = np.geomspace(0.03, 1.0, 9)
"""Sizes of it that are weighed, (c,)."""

_WIDTHS = np.gradient(SIZES)
_UPPER = np.append(0.5 * (SIZES[1:] + SIZES[:-1]), SIZES[-1])
"""Upper ends of the pieces of eta that the grid stands for."""


def _factor_prior() -> Floats:
    """(f,) of `FACTORS`; their sum is one."""
    wrong = np.exp(-0.5 * (np.log(FACTORS) / ACCURACY_SPREAD) ** 2)
    wrong[[0, -1]] *= 0.5  # half a piece of the even steps of the logarithm
    wrong *= (1.0 - AS_STATED) / wrong.sum()
    wrong[0] += AS_STATED
    return np.asarray(wrong)


def _zero_prior() -> Floats:
    """(z,) of `ZEROS`; their sum is one."""
    density = np.exp(-0.5 * (ZEROS / ZERO_SD) ** 2) * np.gradient(ZEROS)
    return np.asarray(density / density.sum())


@dataclass(frozen=True)
class SizeWeights:
    """Probabilities of the size of the model error, and of the errors of the gauges.

    Args:
        joint: (m, f, z) of `SIZES`, `FACTORS` and `ZEROS`, with the priors; their sum is one. f and
            z are 1 where only the first of these is weighed.
        minus_two_l: (m, f, z) -2 l without the priors.
        prior: (f, z) probabilities before any residual.
        components: the logarithms of the factors of variances of the gauges, at the size that is
            used.
        course: size of the error of the course in time; 0 where there is none.
    """

    joint: Floats
    minus_two_l: Floats
    prior: Floats
    components: VarianceComponents
    course: float = 0.0

    @property
    def weights(self) -> Floats:
        """(m,) of `SIZES`, whatever the gauges."""
        return np.asarray(self.joint.sum(axis=(1, 2)))

    @property
    def size(self) -> float:
        """The root of the mean of eta^2."""
        return mean_size(self.weights)

    @property
    def factor(self) -> float:
        """The root of the mean of s^2."""
        return float(np.sqrt(self._squares().sum()))

    @property
    def zero(self) -> float:
        """Error of the zeros that is used, in accuracies times that factor."""
        squares = self._squares()
        return float(np.sqrt(squares @ ZEROS[: len(squares)] ** 2 / squares.sum()))

    def _squares(self) -> Floats:
        """(z,) mean of s^2 at each z, times the weight of that."""
        weights = self.joint.sum(axis=0)
        return np.asarray(FACTORS[: len(weights)] ** 2 @ weights)

    def factor_quantile(self, part: float) -> float:
        """The s at which the weight of it and all smaller ones reaches a part."""
        below = np.cumsum(self.joint.sum(axis=(0, 2)))
        return float(np.exp(np.interp(part, below, np.log(FACTORS[: len(below)]))))

    def zero_quantile(self, part: float) -> float:
        """The z at which the weight of it and all smaller ones reaches a part."""
        below = np.cumsum(self.joint.sum(axis=(0, 1)))
        return float(np.interp(part, below, ZEROS[: len(below)]))

    @property
    def log_gain(self) -> float:
        """Logarithm of the evidence over all sizes, less that at those that are used.

        By the restricted likelihood, times the priors with their normalisation.
        """
        log_prior = 0.5 * np.log(2.0 / np.pi) - np.log(PRIOR_SD) - 0.5 * (SIZES / PRIOR_SD) ** 2
        with np.errstate(divide="ignore"):
            parts = (log_prior + np.log(_WIDTHS))[:, None, None] + np.log(self.prior)
        parts = parts - 0.5 * (self.minus_two_l - self.components.minus_two_l)
        return float(parts.max() + np.log(np.exp(parts - parts.max()).sum()))

    def quantile(self, part: float) -> float:
        """Eta below which a part of the weight lies."""
        below = np.concatenate([[0.0], np.cumsum(self.weights)])
        return float(np.interp(part, below, np.concatenate([[0.0], _UPPER])))


def mean_size(weights: Floats) -> float:
    """The root of the mean of eta^2, for weights (m,) of `SIZES`."""
    return float(np.sqrt(weights @ SIZES**2))


def weigh_sizes(likelihood: Likelihood, start: Floats) -> SizeWeights:
    """The weights of the sizes of the model error, with accuracies that are estimated along.

    Args:
        likelihood: of the factors of all components; the last one is the model error at eta = 1.
        start: (c,) logarithms of the factors of the others to begin with.
    """
    values, t = np.empty((len(SIZES), 1, 1)), start
    for m, eta in enumerate(SIZES.tolist()):
        t, terms = likeliest_factors(_held(likelihood, eta), t)
        values[m] = terms.value
    prior = np.ones((1, 1))
    joint = _weights(values, prior)
    size = mean_size(joint[:, 0, 0])
    return SizeWeights(joint, values, prior, at_size(likelihood, size, t))


def weigh_all(
    likelihood: RestrictedLikelihood,
    columns: sp.csr_array,
    zeros: sp.csr_array | None,
    *,
    free: bool,
    course: Floats | None = None,
) -> SizeWeights:
    """The weights of the sizes of the model error, of the scatter, and of the errors of zeros.

    Args:
        likelihood: of all errors of the gauges as stated, without model error.
        columns: (g, r) of the model error at eta = 1, SI.
        zeros: (g, k) errors of zeros as large as the accuracies; None where they are known.
        free: whether scatter and zeros may be other than stated; else they are as stated.
        course: (g, r) errors of the course in time, SI; None where there are none.
    """
    sizes = ZEROS if zeros is not None else ZEROS[:1]

    def spectra_at(of_course: float) -> _Spectra:
        return _Spectra(_with_course(likelihood, course, of_course), columns, zeros)

    def values_at(of_course: float) -> Floats:
        spectra = spectra_at(of_course)
        return np.stack([spectra.minus_two_l(z, SIZES, FACTORS) for z in sizes.tolist()], axis=2)

    courses = COURSES if course is not None else np.zeros(1)
    each = np.array([values_at(of_course) for of_course in courses.tolist()])
    odds = np.ones(1)
    if course is not None:
        odds = courses * np.exp(-0.5 * (courses / COURSE_MODE) ** 2) * np.gradient(courses)
    least = each.min(axis=0)
    parts = np.exp(-0.5 * (each - least)) * (odds / odds.sum())[:, None, None, None]
    values = least - 2.0 * np.log(parts.sum(axis=0))
    prior = np.zeros((len(FACTORS), len(sizes)))
    prior[0, 0] = 1.0
    if free:
        of_zero = _zero_prior() if zeros is not None else np.ones(1)
        prior = np.outer(_factor_prior(), of_zero)
    joint = _weights(values, prior)
    none = np.zeros(0)
    weights = SizeWeights(
        joint, values, prior, VarianceComponents(none, np.zeros((0, 0)), none, none, np.nan)
    )
    factor, zero = weights.factor, weights.zero
    shares = np.einsum("cmfz,mfz->c", parts / parts.sum(axis=0), joint)
    used_course = float(np.sqrt(shares @ courses**2))
    at_used = spectra_at(used_course).minus_two_l(
        zero, np.array([weights.size]), np.array([factor])
    )
    roots = [factor, factor * max(zero, _NOTHING)][: len(sizes[:2])] if free else []
    t = 2.0 * np.log(np.array(roots))
    used = VarianceComponents(t, np.zeros((len(t), len(t))), t, t, float(at_used[0, 0]))
    return replace(weights, components=used, course=used_course)


def _with_course(
    likelihood: RestrictedLikelihood, course: Floats | None, size: float
) -> RestrictedLikelihood:
    """The same with errors of the course in time (g, r) as unknowns, which have variance one."""
    if course is None or size == 0.0:
        return likelihood
    r, (k, q) = course.shape[1], likelihood.prior_rows.shape
    rows = np.zeros((k + r, q + r))
    rows[:k, :q], rows[k:, q:] = likelihood.prior_rows, np.eye(r)
    return RestrictedLikelihood(
        likelihood.structure,
        likelihood.gap,
        np.column_stack([likelihood.jacobian, size * course]),
        np.append(likelihood.prior, np.zeros(r)),
        rows,
    )


_NOTHING = 1e-4
"""Error of a zero, in accuracies, that stands for none."""


def _weights(minus_two_l: Floats, prior: Floats) -> Floats:
    """Weights (m, f, z) from -2 l and the priors; their sum is one.

    Args:
        minus_two_l: at least (m, f, z).
        prior: (f, z).
    """
    of_size = np.exp(-0.5 * (SIZES / PRIOR_SD) ** 2) * _WIDTHS
    best = minus_two_l[:, prior > 0.0].min()
    possible = np.where(prior > 0.0, minus_two_l, np.inf)  # what the prior excludes may fit better
    weights = np.exp(-0.5 * (possible - best)) * of_size[:, None, None] * prior
    return np.asarray(weights / weights.sum())


def at_size(likelihood: Likelihood, eta: float, start: Floats) -> VarianceComponents:
    """The other components at one size of the model error.

    Args:
        likelihood: of the factors of all components, the model error at eta = 1 last.
        eta: its size.
        start: (c,) logarithms of the factors of the others to begin with.
    """
    held = _held(likelihood, eta)
    return with_possible(held, estimate_components(held, start))


def _held(likelihood: Likelihood, eta: float) -> ConditionalLikelihood:
    return ConditionalLikelihood(likelihood, 2.0 * np.log(eta), ACCURACY_SPREAD)


class _Spectra:
    """-2 l of sizes and factors by the spectrum of the model error, one for each size of zeros.

    Args:
        likelihood: of all errors of the gauges as stated, without model error.
        columns: (g, r) of the model error at eta = 1, SI.
        zeros: (g, k) errors of zeros as large as the accuracies; None where they are known.
    """

    def __init__(
        self, likelihood: RestrictedLikelihood, columns: sp.csr_array, zeros: sp.csr_array | None
    ) -> None:
        structure = likelihood.structure
        self._sd, stated, self._r = structure.sd, structure.columns, columns.shape[1]
        none = sp.csr_array((len(self._sd), 0))
        self._gauges = SharedErrors(sp.hstack([stated, none if zeros is None else zeros]))
        self._is_zero = np.arange(len(self._gauges)) >= stated.shape[1]
        jacobian, self._prior_normal, self._prior = _without_unseen(likelihood)
        self._rows = np.column_stack([columns.toarray(), jacobian, likelihood.gap])

    def minus_two_l(self, zero: float, sizes: Floats, factors: Floats) -> Floats:
        """-2 l (m, f) of sizes (m,) and factors (f,), with zeros of a size, in accuracies."""
        r = self._r
        gauges = self._gauges.sized(np.where(self._is_zero, zero, 1.0))
        covariance = Covariance(self._sd, gauges)
        white = covariance.whiten(self._rows)
        product = white.T @ white
        value, vectors = np.linalg.eigh(product[:r, :r])
        kept = value > _NO_MODE * value.max(initial=0.0)
        eigenvalues = value[kept]
        along = (vectors[:, kept].T @ product[:r, r:]) / np.sqrt(eigenvalues)[:, None]
        across = product[r:, r:] - along.T @ along
        values, square = np.empty((len(sizes), len(factors))), factors**2
        for m, eta in enumerate(sizes.tolist()):
            variance = square[:, None] + eta**2 * eigenvalues
            sums = np.swapaxes(along / variance[:, :, None], 1, 2) @ along
            sums = sums + across / square[:, None, None] + self._prior_normal
            M, pull = sums[:, :-1, :-1], sums[:, :-1, -1:]
            least = sums[:, -1, -1] - np.sum(pull * np.linalg.solve(M, pull), axis=(1, 2))
            values[m] = np.log(variance).sum(axis=1) + np.linalg.slogdet(M)[1] + least
            values[m] += (len(white) - len(eigenvalues)) * np.log(square)
        return values + (covariance.log_determinant() + self._prior)


def _without_unseen(likelihood: RestrictedLikelihood) -> tuple[Floats, Floats, float]:
    """The likelihood's parameters, without directions of which the readings see nothing.

    The priors integrate these out: they leave a constant and change the priors of the others.

    Args:
        likelihood: with a Jacobian (g, q).

    Returns:
        Jacobian (g, r), sums of squares and products (r + 1, r + 1) of the rows of the priors for r
        directions and the residual, and the constant part of -2 l.
    """
    J, R, prior = likelihood.jacobian, likelihood.prior_rows, likelihood.prior
    upper = J if len(J) <= J.shape[1] else np.linalg.qr(J, mode="r")
    _, size, Vt = np.linalg.svd(upper, full_matrices=True)
    seen = int(np.count_nonzero(size > _UNSEEN * size.max(initial=0.0)))
    rows = np.column_stack([R @ Vt.T, -prior])
    squares = rows.T @ rows
    if seen == J.shape[1]:
        return J @ Vt.T, squares, 0.0
    inner = np.r_[:seen, J.shape[1]]
    hidden = np.arange(seen, J.shape[1])
    of_hidden = squares[np.ix_(hidden, hidden)]
    mixed = squares[np.ix_(hidden, inner)]
    left = squares[np.ix_(inner, inner)] - mixed.T @ np.linalg.solve(of_hidden, mixed)
    return J @ Vt[:seen].T, left, float(np.linalg.slogdet(of_hidden)[1])


_NO_MODE = 1e-14
"""Part of the largest eigenvalue below which one is rounding."""

_UNSEEN = 1e-12
"""Singular values below this part of the largest are those of directions not seen."""

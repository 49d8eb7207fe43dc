"""Whether what is left of the readings is what their errors explain (theory 6.5).

With the rows A = [B; P] of readings and priors, whitened and scaled, A = U S V^T over directions
that are not zero, and U_g the rows of the g readings in U, the residuals of a right model whose
priors are right have the covariance I - H with H = U_g U_g^T. Their squares have the mean and the
variance

    m = g - tr H        and        2 q ,  q = tr (I - H)^2 ,

and are distributed as q/m times chi-squared with m^2/q degrees of freedom (Satterthwaite): exactly,
as chi-squared with g - n of them, where there are no priors. The priors' own rows take no part, nor
do parameters on bounds, which are held there.

A robust loss is meant for a few wrong readings, and these may be as far off as they like. So there
the fifth of the readings that is farthest off is left out, and what the squares of the others would
be is found by repetition with normal errors (fixed seed): the same distribution with their mean
and variance. Readings that share errors are taken each in its own standard deviation there, as a
wrong one would spread over all that shares with it; the repetitions share them likewise.

Both tails are of use: residuals too large for the errors, and too small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtr, chdtrc

from geoident.identify.problem.problem import Problem
from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Floats
from geoident.model.methods import SquaredOptions

LEFT_OUT = 0.2
"""Part of the readings that a robust loss may disregard."""

_FEWEST, _DRAWS = 200, 2000
"""Repetitions: 2000 give the mean of four squares within 2 %; of more than 10,000 readings, whose
mean square scatters less, 200 give it within 0.1 %."""

_ENTRIES = 20_000_000
"""Numbers of all repetitions together; with more readings there are fewer of them."""

_TOGETHER = 2_000_000
"""Numbers of repetitions that are made at once: 16 MB."""

_ZERO = 1e-10
"""Singular values below this part of the largest are no directions."""

_LEAST = 0.5
"""Degrees of freedom below which the residuals are not judged."""


@dataclass(frozen=True)
class Misfit:
    """Squares of the residuals, and their distribution if the errors are as stated.

    Args:
        squares: sum over the readings that count.
        mean: of a right model with errors as stated.
        freedom: degrees of freedom.
        above: probability of at least as much by chance.
        below: probability of at most as much by chance.
    """

    squares: float
    mean: float
    freedom: float
    above: float
    below: float

    @property
    def scale(self) -> float:
        """Size of the residuals by that of the errors as stated; about 1 for a right model."""
        return float(np.sqrt(self.squares / self.mean))


UNKNOWN = Misfit(np.nan, np.nan, 0.0, 1.0, 1.0)
"""Of readings that are as many as the parameters, so that nothing is left."""


def misfit(problem: Problem, values: Floats, readings: Floats, jacobian: Floats) -> Misfit:
    """The residuals at the estimate against the errors.

    Args:
        problem: readings, their errors as stated and the loss.
        values: (n,) the estimate, SI.
        readings: (g,) v there, SI.
        jacobian: (g, n) its derivative, SI.
    """
    J, rows = rows_at(problem, values, jacobian)
    gap = readings - problem.measured
    if isinstance(problem.loss, SquaredOptions):
        U, S, _ = np.linalg.svd(rows, full_matrices=False)
        seen = U[: len(gap), _ZERO * S.max(initial=0.0) < S]
        left = problem.whiten(gap)
        mean = len(gap) - float(np.sum(seen**2))
        spread = mean - float(np.sum(seen**2)) + float(np.sum((seen.T @ seen) ** 2))
        with np.errstate(over="ignore"):
            return judged(float(left @ left), mean, spread)
    kept = len(gap) - int(LEFT_OUT * len(gap))
    sd = problem.sd  # of each reading with all that it shares
    if problem.shared is not None:
        sd = np.sqrt(sd**2 + np.ravel(problem.shared.columns.power(2).sum(axis=1)))
    drawn = _drawn(problem, J, rows, sd, kept)
    with np.errstate(over="ignore"):
        squares = float(np.sort((gap / sd) ** 2)[:kept].sum())
    return judged(squares, float(drawn.mean()), float(drawn.var()) / 2.0)


def judged(squares: float, mean: float, spread: float) -> Misfit:
    """Squares of residuals by the distribution of their mean and half their variance."""
    if mean <= _LEAST or spread <= 0.0:
        return UNKNOWN
    freedom = mean**2 / spread
    x = min(squares * mean / spread, 1e300)
    return Misfit(squares, mean, freedom, float(chdtrc(freedom, x)), float(chdtr(freedom, x)))


class DrawnResiduals:
    """Residuals that errors as assumed would leave of a right model, by repetition.

    Args:
        problem: with the errors.
        J: (g, n) derivatives of the readings, SI, by the free parameters in x.
        rows: (g + k, n) the same, whitened, and the priors'.
    """

    def __init__(self, problem: Problem, J: Floats, rows: Floats) -> None:
        self._problem, self._g, self._k = problem, len(J), len(rows) - len(J)
        U, S, Vt = np.linalg.svd(rows, full_matrices=False)
        seen = _ZERO * S.max(initial=0.0) < S
        self._U, self._moved = U[:, seen], J @ (Vt[seen].T / S[seen])

    def draw(self, rng: np.random.Generator, size: int) -> Floats:
        """(g, size) residuals, SI."""
        problem = self._problem
        errors = problem.sd[:, None] * rng.normal(size=(self._g, size))
        if problem.shared is not None:
            B = problem.shared.columns
            errors = errors + B @ rng.normal(size=(B.shape[1], size))
        white = np.concatenate([problem.whiten(errors), rng.normal(size=(self._k, size))])
        return np.asarray(errors - self._moved @ (self._U.T @ white))


def draws_of(readings: int) -> tuple[int, int]:
    """How many repetitions so many readings have, and how many of them are made at once."""
    draws = int(np.clip(_ENTRIES // max(readings, 1), _FEWEST, _DRAWS))
    return draws, max(1, min(draws, _TOGETHER // max(readings, 1)))


def rows_at(problem: Problem, values: Floats, jacobian: Floats) -> tuple[Floats, Floats]:
    """J (g, n) by the free parameters in x, SI, and the whitened rows (g + k, n) with priors.

    Args:
        problem: readings and errors.
        values: (n,) the estimate, SI.
        jacobian: (g, n) derivatives there, SI.
    """
    scaling = Scaling(problem.parameters)
    lower, upper = problem.bounds
    free = (values > lower) & (values < upper)
    J = (jacobian * scaling.dp_dx(values))[:, free]
    return J, np.concatenate([problem.whiten(J), scaling.prior_jacobian(values)[:, free]])


def _drawn(problem: Problem, J: Floats, rows: Floats, sd: Floats, kept: int) -> Floats:
    """Squares (draws,) of the residuals that count, of readings with normal errors.

    Args:
        problem: with the errors.
        J: (g, n) derivatives of the readings, SI, by the free parameters in x.
        rows: (g + k, n) the same, whitened, and the priors'.
        sd: (g,) standard deviation of each reading, SI.
        kept: how many of the residuals count, from the smallest.
    """
    rng, residuals = np.random.default_rng(0), DrawnResiduals(problem, J, rows)
    draws, size = draws_of(len(J))
    squares = []
    for _ in range(-(-draws // size)):
        left = np.abs(residuals.draw(rng, size)) / sd[:, None]
        left.partition(max(kept - 1, 0), axis=0)
        squares.append(np.sum(left[:kept] ** 2, axis=0))
    return np.concatenate(squares)

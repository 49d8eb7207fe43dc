"""Whether residuals of neighbours go together beyond what their errors explain (theory 6.8).

Of the residuals y - v, with errors Sigma = D + B B^T, the part D Sigma^-1 (y - v) is what the
readings have by themselves, best estimated. With r this part in standard deviations of single
readings, and pairs (a, b) of neighbours,

    rho = sum r_a r_b / sum (r_a^2 + r_b^2) / 2

is near 1 where residuals change slowly from neighbour to neighbour, and somewhat below 0 for
independent errors, since the parameters have met what could be met. How often errors as assumed
leave as much is found by repetition. What a model error explains, or the error of a zero, is none
of r.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.identify.assessment.misfit import DrawnResiduals, draws_of, rows_at
from geoident.identify.problem.problem import Problem
from geoident.model.arrays import Floats, Ints

_WORTH_DRAWING = 0.2
"""Correlation of neighbours below which nothing is drawn."""


@dataclass(frozen=True)
class Neighbours:
    """How residuals of neighbours go together.

    Args:
        residuals: (m,) of the places, r.
        correlation: rho.
        chance: probability of at least as much with errors as assumed; 1 where it is not asked.
    """

    residuals: Floats
    correlation: float
    chance: float


def neighbours(
    problem: Problem, values: Floats, readings: Floats, jacobian: Floats, places: Ints, pairs: Ints
) -> Neighbours:
    """The correlation of residuals of neighbours, and its chance.

    Args:
        problem: readings and their errors as assumed.
        values: (n,) the estimate, SI.
        readings: (g,) v there, SI.
        jacobian: (g, n) its derivative.
        places: (g,) number of the place of each reading, 0 to m - 1: readings of one place count as
            their mean.
        pairs: (k, 2) places that are neighbours.
    """
    mean = _means(problem.sd, places)
    residuals = mean @ _own_part(problem, (problem.measured - readings)[:, None])
    correlation = float(_correlation(residuals, pairs)[0])
    if not correlation > _WORTH_DRAWING:
        return Neighbours(residuals[:, 0], correlation, 1.0)
    drawn = DrawnResiduals(problem, *rows_at(problem, values, jacobian))
    rng = np.random.default_rng(0)
    draws, size = draws_of(len(places))
    above = 0
    for _ in range(-(-draws // size)):
        alike = mean @ _own_part(problem, drawn.draw(rng, size))
        above += int(np.sum(_correlation(alike, pairs) >= correlation))
    return Neighbours(residuals[:, 0], correlation, (above + 1.0) / (draws + 1.0))


def _own_part(problem: Problem, residuals: Floats) -> Floats:
    """D Sigma^-1 of residuals (g, d), SI: what readings have by themselves."""
    if problem.covariance is None:
        return residuals
    return np.asarray(problem.sd[:, None] ** 2 * problem.covariance.solve(residuals))


def _means(sd: Floats, places: Ints) -> sp.csr_array:
    """(m, g): weighted means of the readings of each place, in their standard deviation."""
    information = np.bincount(places, weights=sd**-2.0)
    weight = sd**-2.0 / np.sqrt(information[places])
    return sp.csr_array((weight, (places, np.arange(len(places)))))


def _correlation(residuals: Floats, pairs: Ints) -> Floats:
    """(d,) of residuals (m, d)."""
    one, other = residuals[pairs[:, 0]], residuals[pairs[:, 1]]
    squares = 0.5 * np.sum(one**2 + other**2, axis=0)
    products = np.sum(one * other, axis=0)
    none = np.zeros_like(products)
    return np.asarray(np.divide(products, squares, out=none, where=squares > 0.0))

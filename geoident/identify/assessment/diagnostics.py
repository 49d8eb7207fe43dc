"""How each reading bears on the answer: residuals, leverage, influence (Cook & Weisberg 1982).

At the estimate, with the weights w of the loss, the weighted rows B = sqrt(w)/s J (dp/dx) of the
readings and the covariance C of the parameters x (readings and priors, bounds held fixed),

    standardized  e   = (v* - v) / s
    leverage      H   = B C B^T ,  h_i its diagonal: 0 does not bear, 1 decides alone
    studentized   t_i = e_i / sqrt(1 - h_i) :  the residual in its own standard deviation
    influence     D_I = C B_I^T (1 - H_II)^-1 sqrt(w) e_I  in standard deviations of x   (DFBETAS)
    distance          = D_I^T C^+ D_I / n                                       (Cook's distance)

D_I is the estimate less the estimate without the readings I, exact for a linear model with
weights that stay. The scale of the errors is that of the stated accuracies, not estimated from the
residuals: a gauge that is worse than stated shows as large studentized residuals. Readings of one
gauge in one stage are removed together.

A reading without which some parameter would have no information has h = 1: its residual says
nothing and its t is NaN, its influence infinite.

Computed once, from the Jacobian at the estimate; no evaluation of the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.identify.assessment.uncertainty import Assessment
from geoident.identify.objective.loss import robust_scale, weights
from geoident.identify.problem.problem import Problem
from geoident.model.arrays import Bools, Floats, Ints

ALONE = 1.0 - 1e-9
"""Leverage from which on a reading decides alone."""


@dataclass(frozen=True)
class Influence:
    """How each of m sets of readings bears on the answer, for g readings and n parameters.

    Args:
        standardized: (m,) e of the reading of the set that is farthest off.
        studentized: (m,) its t.
        weight: (m,) what is left of the weight of the set.
        leverage: (m,) sum of h over the set.
        influence: (m, n) change of each parameter by the set, in its standard deviations; 0 for
            parameters at a bound.
        distance: (m,) Cook's distance.
        scale: robust scatter of e; near 1 if the accuracies are right.
    """

    standardized: Floats
    studentized: Floats
    weight: Floats
    leverage: Floats
    influence: Floats
    distance: Floats
    scale: float


def effective_sd(problem: Problem, readings: Floats) -> Floats:
    """What the accuracy of each reading amounts to under the loss: s / sqrt(w), (g,).

    Args:
        problem: readings and loss.
        readings: (g,) v at the estimate, SI.
    """
    e = (problem.measured - readings) / problem.sd
    return np.asarray(problem.sd / np.sqrt(weights(problem.loss, e)), dtype=np.float64)


def diagnose(
    problem: Problem, assessment: Assessment, readings: Floats, jacobian: Floats, sets: Ints
) -> Influence:
    """Leverage, residuals and influence of the readings at the estimate.

    Args:
        problem: readings, accuracies and loss.
        assessment: made with `effective_sd`.
        readings: (g,) v at the estimate, SI.
        jacobian: (g, n) its derivative, SI.
        sets: (g,) number of the set, from 0, in which each reading is removed.
    """
    e = (problem.measured - readings) / problem.sd
    w = weights(problem.loss, e)
    B = jacobian * assessment.slope * (np.sqrt(w) / problem.sd)[:, None]
    C = assessment.covariance_x
    removals = [_removed(B, e, np.sqrt(w) * e, C, np.flatnonzero(sets == k)) for k in _each(sets)]
    n, m = C.shape[0], len(removals)
    worst = np.array([removal.worst for removal in removals], dtype=np.int64)
    return Influence(
        standardized=e[worst],
        studentized=np.array([removal.studentized for removal in removals], dtype=np.float64),
        weight=np.array([_together(w, problem.sd, sets == k) for k in _each(sets)]),
        leverage=np.array([removal.leverage for removal in removals], dtype=np.float64),
        influence=np.array([removal.change for removal in removals]).reshape(m, n),
        distance=np.array([removal.distance for removal in removals], dtype=np.float64),
        scale=robust_scale(e),
    )


@dataclass(frozen=True)
class _Removal:
    """What the removal of one set does; the index of its worst reading among all."""

    worst: int
    studentized: float
    leverage: float
    change: Floats
    distance: float


def _together(w: Floats, sd: Floats, mine: Bools) -> float:
    """What is left of the weight of the readings of a set, by the information that each gives."""
    return float(np.average(w[mine], weights=1.0 / sd[mine] ** 2))


def _each(sets: Ints) -> range:
    return range(int(sets.max(initial=-1)) + 1)


def _removed(B: Floats, e: Floats, weighted: Floats, C: Floats, rows: Ints) -> _Removal:
    """The removal of some rows of B (g, n), with residuals e (g,), also weighted, and C (n, n)."""
    H = B[rows] @ C @ B[rows].T
    h = np.diag(H)
    spare = np.where(h < ALONE, 1.0 - h, np.nan)
    t = e[rows] / np.sqrt(spare)
    worst = int(np.argmax(np.where(np.isnan(t), np.inf, np.abs(t))))
    sd = np.sqrt(np.diag(C))
    if np.linalg.eigvalsh(H).max(initial=0.0) >= ALONE:
        pull = np.abs(C @ B[rows].T).max(axis=1, initial=0.0) > 1e-9 * sd
        change, distance = np.where(pull, np.inf, 0.0), np.inf
    else:
        z = np.linalg.solve(np.eye(len(rows)) - H, weighted[rows])
        moved = C @ B[rows].T @ z
        change = np.divide(moved, sd, out=np.zeros_like(sd), where=sd > 0.0)
        distance = float(z @ H @ z) / max(1, int(np.count_nonzero(sd)))
    return _Removal(int(rows[worst]), float(t[worst]), float(h.sum()), change, distance)

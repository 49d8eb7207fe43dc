"""How each reading affects the estimate: residuals, leverage, influence (Cook & Weisberg 1982).

At the estimate, with the weights w of the loss, the weighted rows B = sqrt(w)/s J (dp/dx) of the
readings and the covariance C of the parameters x (readings and priors, bounds held fixed),

    standardized  e   = (v* - v) / s
    leverage      H   = B C B^T ,  h_i its diagonal: 0 has no influence, 1 decides alone
    studentized   t_i = e_i / sqrt(1 - h_i) :  the residual in its own standard deviation
    influence     D_I = C B_I^T (1 - H_II)^-1 sqrt(w) e_I  in standard deviations of x   (DFBETAS)
    distance          = D_I^T C^+ D_I / n                                       (Cook's distance)

D_I is the estimate less the estimate without the readings I, exact for a linear model with
weights that stay. The scale of the errors is that of the stated accuracies, not estimated from the
residuals: a gauge that is worse than stated shows as large studentized residuals. Readings of one
gauge in one stage are removed together.

A reading without which some parameter would have no information has h = 1: its residual says
nothing and its t is NaN, its influence infinite.

**Readings that share errors** (theory 7). With the covariance under the loss, S = diag(s^2/w) +
B B^T, and P = S^-1 - S^-1 J C J^T S^-1, each reading is compared with
its expectation given the others,

    standardized  e_i = d_i / sqrt(s_i^2 + var_i)      d_i = (S^-1 (v* - v))_i / (S^-1)_ii
    leverage      h_i = 1 - P_ii / (S^-1)_ii
    influence     D_I = C J_I'^T (P_II)^-1 (S^-1 (v* - v))_I ,   J' = S^-1 J

where d_i is its residual less what the errors that it shares with the others explain, and var_i
the variance of what they do not: 1/(S^-1)_ii - s_i^2/w_i. t_i is then Baarda's w-test of geodesy.
Where nothing is shared these are the formulas above.

Computed once, from the Jacobian at the estimate; no evaluation of the model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.identify.assessment.uncertainty import Assessment
from geoident.identify.problem.losses import robust_scale, weights
from geoident.identify.problem.problem import Problem, own_residuals
from geoident.identify.problem.shared_errors import Covariance, SharedErrors
from geoident.model.arrays import Floats, Ints
from geoident.model.methods import SquaredOptions

ALONE = 1.0 - 1e-9
"""Leverage from which on a reading decides alone."""


@dataclass(frozen=True)
class ReadingInfluence:
    """How each of g readings affects the estimate of n parameters.

    Args:
        standardized: (g,) e.
        studentized: (g,) t.
        weight: (g,) what the loss leaves of it.
        leverage: (g,) h.
        influence: (g, n) change of each parameter by the set to which the reading belongs, in its
            standard deviations; 0 for parameters at a bound.
        distance: (g,) Cook's distance of that set.
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
    return np.asarray(problem.sd / np.sqrt(_weights(problem, readings)), dtype=np.float64)


def _weights(problem: Problem, readings: Floats) -> Floats:
    """What the loss leaves of each reading (g,)."""
    if isinstance(problem.loss, SquaredOptions):
        return np.ones(len(readings))
    return weights(problem.loss, own_residuals(problem, readings)[0])


def diagnose(
    problem: Problem, assessment: Assessment, readings: Floats, jacobian: Floats, sets: Ints
) -> ReadingInfluence:
    """Leverage, residuals and influence of the readings at the estimate.

    Args:
        problem: readings, accuracies and loss.
        assessment: made with `effective_sd`.
        readings: (g,) v at the estimate, SI.
        jacobian: (g, n) its derivative, SI.
        sets: (g,) number of the set, from 0, in which each reading is removed.
    """
    gap, w = problem.measured - readings, _weights(problem, readings)
    sd = problem.sd / np.sqrt(w)
    none = SharedErrors(sp.csr_array((len(gap), 0)))
    covariance, C = Covariance(sd, problem.shared or none), assessment.held_covariance_x
    pull = covariance.solve(jacobian * assessment.dp_dx)
    force, own = covariance.solve(gap), covariance.inverse_diagonal
    left = np.maximum(own - np.einsum("gi,ij,gj->g", pull, C, pull), 0.0) / own
    # rows of a set are weighted by the covariance of its errors given all others
    moved = np.column_stack([pull, force]) / own[:, None]
    order = np.argsort(sets, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(sets[order])) + 1):
        if problem.shared is not None and len(rows) > 1:
            of_set = np.column_stack([pull[rows], force[rows]])
            moved[rows] = covariance.without_others(rows, of_set)
    influence, distance = _removed(pull, moved, sets, C)
    # a residual given all others scatters by its own accuracy and by what shared errors leave
    by_shared = np.maximum(1.0 / own - sd**2, 0.0) if problem.shared is not None else 0.0
    e = force / own / np.sqrt(problem.sd**2 + by_shared)
    spare = np.where(left > 1.0 - ALONE, left, np.nan)
    return ReadingInfluence(
        standardized=e,
        studentized=e / np.sqrt(spare),
        weight=w,
        leverage=1.0 - left,
        influence=influence,
        distance=distance,
        scale=robust_scale(e),
    )


def _removed(pull: Floats, moved: Floats, sets: Ints, C: Floats) -> tuple[Floats, Floats]:
    """What the removal of the set of each reading does: changes (g, n), Cook's distances (g,).

    With the weighted rows B_I and residuals e_I of a set, and C = F F^T, everything that it takes
    is of the size of the parameters, however many readings it has: C B_I^T (1 - B_I C B_I^T)^-1 e_I
    is F (1 - F^T B_I^T B_I F)^-1 F^T B_I^T e_I, and both inverses have the same eigenvalues.

    Args:
        pull: (g, n) rows B.
        moved: (g, n + 1) B and e; with the pull of a set they give B_I^T B_I and B_I^T e_I.
        sets: (g,) number of the set, from 0, of each.
        C: (n, n) covariance of the parameters.
    """
    n = len(C)
    sd = np.sqrt(np.diag(C))
    size, vectors = np.linalg.eigh(C)
    F = vectors * np.sqrt(np.maximum(size, 0.0))
    order = np.argsort(sets, kind="stable")
    begins = np.flatnonzero(np.diff(sets[order], prepend=-1))
    change, distance = np.zeros((len(begins), n)), np.zeros(len(begins))
    some = max(1, _ENTRIES_AT_ONCE // max(1, n) ** 2)
    for slab in np.split(np.arange(len(begins)), np.arange(some, len(begins), some)):
        if not len(slab):
            continue
        end = begins[slab[-1] + 1] if slab[-1] + 1 < len(begins) else len(order)
        rows = order[begins[slab[0]] : end]
        both = np.add.reduceat(
            pull[rows][:, :, None] * moved[rows][:, None, :], begins[slab] - begins[slab[0]]
        )
        squares, gradient = both[:, :, :-1], both[:, :, -1]
        H = F.T @ squares @ F
        alone = np.linalg.eigvalsh(H).max(axis=1, initial=0.0) >= ALONE
        step = np.zeros_like(gradient)
        spare = np.eye(n) - H[~alone]
        step[~alone] = np.linalg.solve(spare, (gradient[~alone] @ F)[:, :, None])[:, :, 0]
        shift = np.divide(step @ F.T, sd, out=np.zeros_like(gradient), where=sd > 0.0)
        reached = np.einsum("ij,sjk,ki->si", C, squares[alone], C)
        seen = np.sqrt(np.maximum(reached, 0.0)) > _UNMOVED * sd
        shift[alone] = np.where(seen, np.inf, 0.0)
        change[slab] = shift
        distance[slab] = np.sum(step**2, axis=1) / max(1, int(np.count_nonzero(sd)))
        distance[slab[alone]] = np.inf
    return change[sets], distance[sets]


_ENTRIES_AT_ONCE = 1_000_000
"""Entries of the (n, n) matrices of sets that are made at once: 8 MB."""

_UNMOVED = 1e-9
"""Effect of a set on a parameter, in its standard deviations, that is rounding."""

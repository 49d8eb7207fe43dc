"""The condensed complementarity system (theory 5): what the equations determine eliminated, dense.

Where no parameter multiplies an unknown of the equations (elastic moduli are given), everything is
linear in the parameters p and the multipliers lam:

    s = s_0 + S_p p + M lam + h(p, lam) >= 0     lam >= 0     s^T lam = 0
    v = v_0 + V_p p + V_lam lam

With the slacks k + H lam - N^T sigma of yield planes, M = -N^T Z N + H holds the influence of every
multiplier on every plane. Parameters that multiply a multiplier in a slack (hardening) add h, the
only product. All is scaled: slacks, multipliers and parameters by their sizes, so that all numbers
are of the order of one; readings in standard deviations.

One sparse factorization of the equations, as many right-hand sides as there are pairs: for small
systems only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from geoident.errors import ModelError
from geoident.identify.problem.problem import Problem
from geoident.model.arrays import Floats, Ints
from geoident.model.response import Bilinear, BilinearSystem


@dataclass(frozen=True)
class CondensedSystem:
    """The condensed system, scaled. q pairs, n parameters, g readings.

    Args:
        slack: s at p = 0, lam = 0, (q,).
        slack_by_p: (q, n).
        slack_by_lam: (q, q).
        misfit: (v - v*) / sd at p = 0, lam = 0, and the priors' rows, (g,).
        misfit_by_p: (g, n).
        misfit_by_lam: (g, q).
        products: parameter to (q, q): h = sum_h p_h (products[h] lam).
        lower: (n,) bounds of the scaled parameters.
        upper: (n,).
        reference: (n,) p in SI = reference times scaled p.
        work: (q,) what scaled s times scaled lam stand for, to one scale (J).
        multiplier_size: (q,) lam = this times the scaled one.
    """

    slack: Floats
    slack_by_p: Floats
    slack_by_lam: Floats
    misfit: Floats
    misfit_by_p: Floats
    misfit_by_lam: Floats
    products: Mapping[int, Floats]
    lower: Floats
    upper: Floats
    reference: Floats
    work: Floats
    multiplier_size: Floats

    @property
    def n_pairs(self) -> int:
        """Number q of complementarities."""
        return int(self.slack.shape[0])

    def only(self, kept: Ints) -> CondensedSystem:
        """The system in which only the pairs (k,) may be active: other multipliers are zero."""
        square = np.ix_(kept, kept)
        return replace(
            self,
            slack=self.slack[kept],
            slack_by_p=self.slack_by_p[kept],
            slack_by_lam=self.slack_by_lam[square],
            misfit_by_lam=self.misfit_by_lam[:, kept],
            products={h: product[square] for h, product in self.products.items()},
            work=self.work[kept],
            multiplier_size=self.multiplier_size[kept],
        )


def condensing_obstacle(system: BilinearSystem) -> str | None:
    """Why a system cannot be condensed to one of convex energy, a clause, or None if it can."""
    for h, product in system.equations.products.items():
        if product.nnz:
            return (
                f"{system.names[h]} changes a modulus (it multiplies unknowns of the equations), "
                "so displacements can't be eliminated"
            )
    direct = [system.slacks.by_x, *system.slacks.products.values()]
    if any(np.any(matrix[:, system.multipliers].data < 0.0) for matrix in direct):
        return "hardening that one plane takes from another has no convex energy here"
    return None


def condensed(problem: Problem, system: BilinearSystem) -> CondensedSystem:
    """Eliminates all unknowns but parameters and multipliers.

    Args:
        problem: readings and parameters with finite bounds.
        system: the equations of its model, without `condensing_obstacle`.

    Raises:
        ModelError: the equations do not determine the unknowns.
    """
    lower, upper = problem.bounds
    reference = np.maximum(np.maximum(abs(lower), abs(upper)), 1e-300)
    n, q, equations = len(reference), system.n_pairs, system.equations
    # columns 1, p, lam of everything: unknowns x, slacks, misfits
    by_lam = equations.by_x[:, system.multipliers].toarray()
    right = np.column_stack([equations.constant, equations.by_p, by_lam])
    x = determined_unknowns(system, equations.by_x, right)
    x[system.multipliers, 1 + n + np.arange(q)] = 1.0
    size = sizes_of_kinds(system, np.abs(x[:, : 1 + n]) @ np.append(1.0, reference))
    slack_size = size[system.kind_of_slack]
    lam_size = slack_size / system.stiffness
    column_size = np.concatenate([[1.0], reference, lam_size])

    def columns(values: Bilinear) -> Floats:
        table = np.asarray(values.by_x @ x)
        table[:, 0] += values.constant
        table[:, 1 : 1 + n] += values.by_p
        return table

    slack = columns(system.slacks) * column_size / slack_size[:, None]
    misfit = columns(system.readings)
    misfit[:, 0] -= problem.measured
    normal = [(h, a.prior) for h, a in enumerate(problem.parameters) if a.prior is not None]
    priors = np.zeros((len(normal), 1 + n + q))
    for row, (h, prior) in zip(priors, normal, strict=True):
        row[0], row[1 + h] = -prior.mean / prior.sd, 1.0 / prior.sd
    misfit = np.vstack([problem.whiten(misfit), priors]) * column_size
    products = {
        h: A[:, system.multipliers].toarray() / slack_size[:, None] * lam_size * reference[h]
        for h, A in system.slacks.products.items()
    }
    return CondensedSystem(
        slack=slack[:, 0],
        slack_by_p=slack[:, 1 : 1 + n],
        slack_by_lam=slack[:, 1 + n :],
        misfit=misfit[:, 0],
        misfit_by_p=misfit[:, 1 : 1 + n],
        misfit_by_lam=misfit[:, 1 + n :],
        products=products,
        lower=lower / reference,
        upper=upper / reference,
        reference=reference,
        work=system.work * lam_size * slack_size,
        multiplier_size=lam_size,
    )


def determined_unknowns(system: BilinearSystem, matrix: sp.csr_array, right: Floats) -> Floats:
    """The unknowns x (N, K) that solve A x + right = 0 without multipliers; these are zero.

    Rows and columns are scaled before the factorization: displacements and stresses have numbers of
    very different size.

    Args:
        system: which unknowns are multipliers.
        matrix: A (N - q, N) of the equations.
        right: (N - q, K).

    Raises:
        ModelError: the equations do not determine the unknowns.
    """
    free = system.determined
    A = sp.csr_array(matrix[:, free])
    rows = _inverse(abs(A).max(axis=1).toarray())
    A = sp.csr_array(sp.diags_array(rows) @ A)
    columns = _inverse(abs(A).max(axis=0).toarray())
    x = np.zeros((matrix.shape[1], right.shape[1]))
    try:
        factor = spla.splu(sp.csc_array(A @ sp.diags_array(columns)))
        x[free] = -columns[:, None] * factor.solve(rows[:, None] * right)
    except RuntimeError as error:
        msg = "the stiffness matrix of a stage is singular"
        hint = "See whether the supports hold all of the ground at every stage."
        raise ModelError(msg, hint) from error
    return x


def sizes_of_kinds(system: BilinearSystem, x: Floats) -> Floats:
    """The largest size of the unknowns (N,) of each kind, (n_kinds,).

    Where all of a kind are zero, the largest size that a slack can have takes the place.
    """
    size = np.zeros(1 + int(system.kind_of_unknown.max(initial=0)))
    some = system.kind_of_unknown >= 0
    np.maximum.at(size, system.kind_of_unknown[some], np.abs(x[some]))
    largest = float(size[system.kind_of_slack].max(initial=0.0)) or 1.0
    return np.asarray(np.where(size > 0.0, size, largest))


def _inverse(size: Floats) -> Floats:
    """1 / size (m,), and 1 where it is zero."""
    return np.asarray(1.0 / np.where(size > 0.0, size, 1.0))

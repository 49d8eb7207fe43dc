"""How much of a load is carried, on a bar whose force is known by hand.

The bar has length and cross-section 1: under a displacement u it carries E u up to k, then
k + h (u - k / E).
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from scipy.optimize import linprog
from support.array_model import DenseFactor, Operators
from support.plastic import Planes, polyhedral

from geoident.fem.elasticity import UniformModuli
from geoident.fem.solvers.direct import NotPositiveDefinite
from geoident.fem.yielding.domain import EmptyDomain, NoProjection
from geoident.forward.analysis.collapse import carried_part
from geoident.forward.analysis.constitutive import MaterialPoints
from geoident.forward.analysis.equilibrium import solve
from geoident.forward.analysis.stage_equations import (
    NoEquilibrium,
    SingularTangent,
    StageEquations,
)


def bar(load: float, k: float, h: float) -> StageEquations:
    """E = 1; the stiffness h left beyond k is E H / (E + H)."""
    hardening = h / (1.0 - h) * np.eye(2)
    planes = Planes(np.array([[1.0], [-1.0]]), np.full(2, k), hardening=hardening if h else None)
    law = polyhedral(np.eye(1), planes)

    def tangents(points, change, *, symmetric):
        assert symmetric
        return DenseFactor(spla.splu(sp.csc_array([[1.0 + float(np.sum(change))]])))

    return StageEquations(
        Operators(sp.csr_array([[1.0]]), 1),
        volume=np.ones(1),
        dofs=np.array([0]),
        grounds=[MaterialPoints("bar", slice(0, 1), UniformModuli(np.eye(1)), law)],
        stress=np.zeros((1, 1)),
        trial=np.zeros((1, 1)),
        forces=np.array([load]),
        solver=SimpleNamespace(factorize=tangents),
    )


def test_a_load_that_is_carried_is_carried_whole():
    """0.1 + 0.1 (u - 0.1) = 0.9 at u = 8.1: long, but not ten thousand times softer."""
    assert carried_part(bar(0.9, 0.1, 0.1), NoEquilibrium(None)).fraction == 1.0


def test_soft_ground_is_given_up_where_its_strains_are_large():
    """Strains of 0.225, 0.45, 0.9 and 1.8, and 1e5 times softer: the last one is out of bounds."""
    k = h = 1e-5
    carried = carried_part(bar(0.9, k, h), NoEquilibrium(None))
    assert carried.end.du == pytest.approx([0.9], rel=1e-6)
    assert carried.fraction == pytest.approx((k + h * (0.9 - k)) / 0.9, rel=1e-5)


def test_a_limit_load_is_proven_and_a_lost_arc_is_not():
    equations, failure = bar(0.9, 0.3, 0.0), NoEquilibrium(None)
    assert carried_part(equations, failure).failure.proven
    assert not carried_part(equations, failure, most_steps=0).failure.proven


@pytest.mark.parametrize("error", [NoEquilibrium(None), NoProjection(1), EmptyDomain((0, 1))])
def test_a_guess_whose_stress_cannot_be_returned_is_passed_over(error):
    """An extrapolated start may be far out; where none serves, the error of the last is raised."""

    class Bounded(StageEquations):
        def at(self, du):
            if abs(du[0]) > 5.0:
                raise error
            return super().at(du)

    equations = Bounded(**vars(bar(0.2, 0.3, 0.0)))
    balance = solve(equations, [np.array([9.0]), np.zeros(1)])
    assert balance.end.du == pytest.approx([0.2])
    with pytest.raises(type(error)):
        solve(equations, [np.array([9.0])])


# --- several bars, ---


def truss(seed: int, *, soft: float = 1.0):
    """Bars on five degrees of freedom, one of them held, stressed before; none hardens."""
    rng = np.random.default_rng(seed)
    bars, dofs = 9, np.array([4, 0, 3, 1])
    C, volume = rng.normal(size=(bars, 5)), rng.uniform(0.5, 2.0, bars)
    stiffness = soft * rng.uniform(1.0, 3.0, bars)
    strength = rng.uniform(0.3, 1.0, bars)
    stress = 0.5 * strength * rng.uniform(-1.0, 1.0, bars)
    before = C.T @ (volume * stress)
    change = rng.normal(size=5)
    grounds = [
        MaterialPoints(
            f"bar {k}", slice(k, k + 1), UniformModuli(np.array([[E]])),
            polyhedral(np.array([[E]]), Planes(np.array([[1.0], [-1.0]]), np.full(2, limit))),
        )
        for k, (E, limit) in enumerate(zip(stiffness, strength, strict=True))
    ]  # fmt: skip

    def tangents(points, softening, *, symmetric):
        moduli = volume * stiffness
        moduli[points] += softening[:, 0, 0]
        K = (C.T * moduli) @ C
        K = K[np.ix_(dofs, dofs)]
        if np.linalg.eigvalsh(K)[0] < 1e-12:
            raise NotPositiveDefinite(0)
        return DenseFactor(spla.splu(sp.csc_array(K)))

    equations = StageEquations(
        Operators(sp.csr_array(C), bars), volume=volume, dofs=dofs, grounds=grounds,
        stress=stress[None], trial=stress[None], forces=before + change,
        solver=SimpleNamespace(factorize=tangents),
    )  # fmt: skip
    pull = (C.T * volume)[dofs]
    most = linprog(
        np.array([*np.zeros(bars), -1.0]), A_eq=np.column_stack([pull, -change[dofs]]),
        b_eq=before[dofs], bounds=[*((-k, k) for k in strength), (0.0, None)],
    )  # fmt: skip
    return equations, change, float(most.x[-1])


@pytest.mark.parametrize("needed", [1e-7, 1e-3, 1.0])
def test_derivatives_are_those_of_the_consistent_tangent(needed):
    """Also where a factorization needs some of the elastic stiffness left in the tangent."""
    equations, change, most = truss(0)
    equations = equations.under(equations.forces - change + 0.9 * most * change)
    trial = solve(equations, [np.zeros(5)]).end
    exact = equations.tangent(trial)
    assert len(exact.points)

    def reluctant(points, softening, *, symmetric):
        left = 1.0 - softening.sum() / exact.change.sum()
        if left < 0.99 * needed:
            raise NotPositiveDefinite(0)
        return equations.solver.factorize(points, softening, symmetric=symmetric)

    rough = replace(equations, solver=SimpleNamespace(factorize=reluctant)).tangent(trial)
    rest = np.random.default_rng(1).normal(size=(len(equations.dofs), 2))
    solution = equations.solve_consistently(rough, rest)
    np.testing.assert_allclose(solution, exact.factor.solve(rest), rtol=1e-7)


def test_displacements_at_a_limit_load_have_no_derivatives():
    equations = bar(0.3, 0.3, 0.0)
    trial = equations.at(np.array([0.4]))
    tangent = equations.tangent(trial, least=1e-7)
    with pytest.raises(SingularTangent):
        equations.solve_consistently(tangent, np.ones((1, 1)))

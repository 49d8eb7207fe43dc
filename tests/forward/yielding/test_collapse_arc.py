"""How far the arc of equilibria is followed, on a bar whose force is known by hand.

The bar has length and cross-section 1: under a displacement u it carries E u up to k, then
k + h (u - k / E). The measure of displacements is that of the work, so u is doubled from one to the
next, beginning with a quarter of F / E.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from support.array_model import DenseFactor, Operators
from support.plastic import Planes, polyhedral

from geoident.fem.elasticity import UniformModuli
from geoident.forward.march.collapse import limit_of
from geoident.forward.march.constitutive import Flow, Ground
from geoident.forward.march.equilibrium import Balance
from geoident.forward.march.plastic_derivatives import (
    _SAME_GENERAL_TANGENT,
    _SAME_TANGENT,
    _is_exact,
    _solved,
)
from geoident.forward.march.stage_equations import StageEquations


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
        grounds=[Ground("bar", slice(0, 1), UniformModuli(np.eye(1)), law)],
        stress=np.zeros((1, 1)),
        forces=np.array([load]),
        tangents=tangents,
    )


def test_a_load_that_is_carried_is_carried_whole():
    """0.1 + 0.1 (u - 0.1) = 0.9 at u = 8.1: long, but not ten thousand times softer."""
    assert limit_of(bar(0.9, 0.1, 0.1)).fraction == 1.0


def test_ground_that_flows_carries_its_strength():
    """Of the load 0.9, with a strength of 0.3."""
    assert limit_of(bar(0.9, 0.3, 0.0)).fraction == pytest.approx(1.0 / 3.0, rel=1e-6)


def test_soft_ground_is_given_up_where_its_strains_are_large():
    """Strains of 0.225, 0.45, 0.9 and 1.8, and 1e5 times softer: the last one is out of bounds."""
    k = h = 1e-5
    found = limit_of(bar(0.9, k, h))
    assert found.du == pytest.approx([0.9], rel=1e-6)
    assert found.fraction == pytest.approx((k + h * (0.9 - k)) / 0.9, rel=1e-5)


def test_ground_hardens_where_its_law_does():
    """Only then are multipliers of earlier stages kept and counted."""
    ground = bar(1.0, 0.1, 0.5).grounds[0]
    assert ground.hardens is True
    assert bar(1.0, 0.1, 0.0).grounds[0].hardens is False
    assert Ground("elastic", slice(0, 1), UniformModuli(np.eye(1))).hardens is False


def test_the_last_factor_serves_again_where_the_pieces_are_the_same():
    """Beyond k at 0.5 and 0.7 alike; below it at 0.05."""
    equations = bar(0.9, 0.1, 0.1)
    end, beyond, below = (equations.at(np.array([u])) for u in (0.5, 0.7, 0.05))
    factor, _ = equations.factor(end)
    for made_at, again in ((end, True), (beyond, True), (below, False), (None, False)):
        balance = Balance(end, 1, factor, made_at)
        assert _is_exact(equations, balance) == again
        found = _solved(equations, balance, np.ones((1, 1)))
        assert found == pytest.approx(np.array([[1.0 / 0.1]]))


@pytest.mark.parametrize("associated", [True, False])
@pytest.mark.parametrize(("off", "again"), [(0.9, True), (-0.9, True), (1.1, False), (-1.1, False)])
def test_and_where_the_tangent_differs_by_rounding_only(off, again, associated):
    same = _SAME_TANGENT if associated else _SAME_GENERAL_TANGENT
    equations = SimpleNamespace(
        associated=associated,
        changes=lambda trial: (np.array([3]), np.array([2.0, 0.1 + 2.0 * same * trial])),
    )
    assert _is_exact(equations, Balance(0.0, 1, None, off)) == again


@pytest.mark.parametrize(
    ("viscosity", "slopes"), [(0.0, [1.0, 0.0, 1.0]), (0.25, [1.0, 0.25, 0.75])]
)
def test_slopes_of_a_stress_that_keeps_a_part_of_its_overstress(viscosity, slopes):
    """sigma = k + mu (s* - k): by s* within the strength and beyond it, and by the strength k."""
    of_trial, projected = np.array([[1.0, 1.0, 0.0], [1.0, 0.0, 1.0]])
    projection = SimpleNamespace(derivatives=lambda trial, before, of_law: (projected, before))
    (ground,) = bar(0.9, 0.3, 0.0).grounds
    found, _ = Flow(ground, projection, 1).derivatives(of_trial, of_law=True, viscosity=viscosity)
    assert found.tolist() == slopes

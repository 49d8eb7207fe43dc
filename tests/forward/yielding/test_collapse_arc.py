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
from scipy.optimize import linprog
from support.array_model import DenseFactor, Operators
from support.plastic import Planes, polyhedral

from geoident.fem.elasticity import UniformModuli
from geoident.fem.solvers.direct import NotPositiveDefinite
from geoident.forward.analysis.collapse import limit_of
from geoident.forward.analysis.constitutive import Flow, Ground
from geoident.forward.analysis.stage_equations import StageEquations


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


# --- several bars, and the rules one by one ---


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
        Ground(
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
        stress=stress[None], forces=before + change, tangents=tangents,
    )  # fmt: skip
    pull = (C.T * volume)[dofs]
    most = linprog(
        np.array([*np.zeros(bars), -1.0]), A_eq=np.column_stack([pull, -change[dofs]]),
        b_eq=before[dofs], bounds=[*((-k, k) for k in strength), (0.0, None)],
    )  # fmt: skip
    return equations, change, float(most.x[-1])


@pytest.mark.parametrize("seed", [0, 3])
@pytest.mark.parametrize("beyond", [0.98, 2.5])
def test_the_part_that_is_carried_is_that_of_the_lower_bound_theorem(seed, beyond):
    """Largest part of the change of load that stresses within the strengths can balance."""
    equations, change, most = truss(seed)
    load = beyond * most * change
    found = limit_of(equations.under(equations.forces - change + load))
    if beyond < 1.0:
        assert found.fraction == 1.0
        return
    assert found.fraction == pytest.approx(1.0 / beyond, rel=2e-3)
    trial = equations.at(found.du)
    rest = (
        equations.before()
        + found.fraction * load
        - equations.operators.forces(trial.stress, equations.volume)
    )
    assert np.abs(rest[equations.dofs]).max() < 1e-6 * np.abs(load).max()

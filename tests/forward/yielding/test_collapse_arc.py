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
from geoident.forward.march import collapse
from geoident.forward.march.collapse import Limit, limit_of
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
        balance = Balance(end, factor, made_at)
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
    assert _is_exact(equations, Balance(0.0, None, off)) == again


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


@pytest.fixture
def arc(monkeypatch):
    """The arc of a bar of E = 1 under 2, so of compliance 4, whose parts are told by alpha / 4."""
    asked, told = [], SimpleNamespace(fraction=lambda x: 0.0, strain=0.0)

    def controlled(before, load, alpha, start):
        asked.append((alpha / 4.0, start.fraction))
        fraction = told.fraction(alpha / 4.0)
        return None if fraction is None else Limit(fraction, np.array([alpha]))

    monkeypatch.setattr(collapse, "_controlled", controlled)
    monkeypatch.setattr(collapse, "_strain", lambda before, found: told.strain)
    return SimpleNamespace(
        asked=asked, told=told, find=lambda: limit_of(bar(2.0, 0.5, 0.0)),
        alphas=lambda: [alpha for alpha, _ in asked],
    )  # fmt: skip


def test_the_measure_of_displacements_is_doubled_until_all_is_carried(arc):
    arc.told.fraction = lambda x: {0.25: 0.2, 0.5: 0.4, 1.0: 0.7, 2.0: 1.01}[x]
    found = arc.find()
    assert found.fraction == 1.0
    assert found.du.tolist() == [8.0]
    assert arc.asked == [(0.25, 0.0), (0.5, 0.2), (1.0, 0.4), (2.0, 0.7)]


@pytest.mark.parametrize(("growth", "steps"), [(1.9e-4, 5), (2.1e-4, 6)])
def test_growth_of_a_part_in_five_thousand_over_a_doubling_is_none(arc, growth, steps):
    """Beyond the elastic work only: before it the load may rest."""
    parts = [0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0]
    arc.told.fraction = lambda x: {0.25: 0.4, 0.5: 0.4, 1.0: 0.4, 2.0: 0.5}.get(
        x, 0.5 / (1.0 - growth)
    )
    found = arc.find()
    assert arc.alphas() == parts[:steps]
    assert found.fraction == pytest.approx(0.5 / (1.0 - growth))


def test_what_is_carried_never_falls(arc):
    arc.told.fraction = lambda x: {0.25: 0.2, 0.5: 0.4, 1.0: 0.3, 2.0: 0.35}.get(x, 0.1)
    found = arc.find()
    assert found.fraction == 0.4
    assert found.du.tolist() == [2.0]
    assert arc.asked[2:] == [(1.0, 0.4), (2.0, 0.4)]


def test_where_it_is_lost_it_grows_by_less_and_then_by_more_again(arc):
    """From 0.5 to 1 it is lost: by the root of 2, its root, ...; then by its square."""
    arc.told.fraction = lambda x: None if 0.65 < x < 1.2 else 0.3 + 0.1 * x
    arc.find()
    root = 2.0**0.5
    first = [0.25, 0.5, 1.0, 0.5 * root, 0.5 * root**0.5]
    assert arc.alphas()[:5] == pytest.approx(first)
    assert arc.alphas()[5:8] == pytest.approx([
        first[4] * root, first[4] * root**0.5, first[4] * root**0.25
    ])  # fmt: skip


def test_below_a_twentieth_of_growth_it_ends(arc):
    """2^(1/8) is 1.09, 2^(1/16) is 1.044."""
    arc.told.fraction = lambda x: 0.1 * x if x <= 0.5 else None
    found = arc.find()
    assert found.fraction == pytest.approx(0.05)
    assert arc.alphas()[2:] == pytest.approx([0.5 * 2.0 ** (0.5**k) for k in range(5)])
    arc.asked.clear()
    arc.told.fraction = lambda x: None
    assert arc.find().fraction == 0.0
    assert arc.alphas() == [0.25]


@pytest.mark.parametrize(("softer", "strain", "ends"), [(1.01, 1.01, True), (0.99, 1.01, False),
                                                        (1.01, 0.99, False)])  # fmt: skip
def test_ten_thousand_times_softer_and_long_is_flow(arc, softer, strain, ends):
    """alpha is ten thousand times the elastic one of the part that is carried."""
    arc.told.strain = strain
    arc.told.fraction = lambda x: 0.5 if x == 0.25 else 1e-4 * x / softer if x == 0.5 else 1.0
    found = arc.find()
    assert arc.alphas() == ([0.25, 0.5] if ends else [0.25, 0.5, 1.0])
    assert found.fraction == (0.5 if ends else 1.0)


def test_twenty_four_doublings_of_the_elastic_work_are_the_most(arc):
    arc.told.fraction = lambda x: 0.9 - 0.5 / (1.0 + np.log2(4.0 * x))
    found = arc.find()
    assert arc.alphas()[-1] == 2.0**24
    assert found.fraction == arc.told.fraction(2.0**24)

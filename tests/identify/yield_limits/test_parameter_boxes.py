"""Bounds of the discrepancy in boxes of parameters, on a bar that yields beside an elastic one.

In scaled numbers s = k - 4 + 1.2 lam and v = 2 + 0.4 lam, so lam = max(0, (4 - k) / 1.2): for a
reading of 2.4 with 0.1 the best k is 2.8, and phi = 16 where nothing yields.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geoident.identify.yield_limits.condensed_system import CondensedSystem
from geoident.identify.yield_limits.mixed_program import solve_box
from geoident.identify.yield_limits.parameter_boxes import (
    EnergyInequality,
    ParameterBox,
    examined,
    form_of,
)

ONE = np.array([0])


def bar(*, products=None, prior=None):
    """The system; a prior (mean, sd) of k is one more misfit."""
    misfit, by_p, by_lam = [-4.0], [[0.0]], [[4.0]]
    if prior is not None:
        mean, sd = prior
        misfit, by_p, by_lam = [*misfit, -mean / sd], [*by_p, [1.0 / sd]], [*by_lam, [0.0]]
    return CondensedSystem(
        slack=np.array([-4.0]),
        slack_by_p=np.array([[1.0]]),
        slack_by_lam=np.array([[1.2]]),
        misfit=np.array(misfit),
        misfit_by_p=np.array(by_p),
        misfit_by_lam=np.array(by_lam),
        products=products or {},
        lower=np.array([1.0]),
        upper=np.array([5.0]),
        reference=np.ones(1),
        work=np.array([2.0]),
        multiplier_size=np.ones(1),
    )


def box(lower, upper, bound=0.0):
    return ParameterBox(np.array([lower]), np.array([upper]), bound, ONE)


def form(system):
    return form_of(system.work[:, None] * system.slack_by_lam)


@pytest.mark.parametrize("unit", [1.0, 1e-6, 1e6])
@pytest.mark.parametrize(
    ("lower", "upper", "bound"), [(3.4, 5.0, 4.0), (2.9, 3.0, 1.0 / 9.0), (1.0, 2.2, 4.0)]
)
def test_the_bound_of_a_box_beside_the_best_point(lower, upper, bound, unit):
    """At k = 3.4, lam is 0.5 and v = 2.2; at 2.9, v = 2.367; at 2.2, lam is 1.5 and v = 2.6.

    It does not depend on the unit of work.
    """
    system = replace(bar(), work=np.array([2.0 * unit]))
    found = examined(system, form(system), box(lower, upper), best=20.0)
    assert found is not None
    assert found.kept.tolist() == [0]
    assert found.bound <= bound * (1 + 1e-9)
    # one pair: above 2.8 the energy says all that complementarity does, below it the slack
    if (lower, upper) != (1.0, 5.0):
        assert found.bound == pytest.approx(bound, rel=1e-3)


@pytest.mark.parametrize("unit", [1.0, 1e-13, 1e13])
def test_the_energy_alone_keeps_a_plane_from_its_multiplier(unit):
    """With k >= 4.5, lam W q <= 0 leaves lam = 0 only, whatever the unit of work."""
    system = replace(bar(), work=np.array([2.0 * unit]))
    here = box(4.5, 5.0)
    energy = EnergyInequality(system, None, here.lower, here.upper)
    assert energy.reachable().tolist() == [False]
    found = examined(system, None, here, 20.0)
    assert found.bound == pytest.approx(16.0, rel=1e-4)


def test_a_box_shrinks_to_where_something_better_may_be():
    """A prior of 3 +- 0.1 on k: below phi = 4 only within 0.2 of it."""
    system = bar(prior=(3.0, 0.1))
    found = examined(system, form(system), box(1.0, 5.0, bound=0.5), best=4.0)
    assert found is not None
    assert found.lower[0] == pytest.approx(2.8, abs=2e-3)
    assert found.upper[0] <= 3.2 + 2e-3
    assert found.bound >= 0.5


def test_nothing_follows_where_some_parameters_let_the_ground_collapse():
    """W q = (-2, -3) with energy in the first direction alone: no y lifts the second."""
    two = replace(
        bar(),
        slack=np.array([-2.0, -3.0]),
        slack_by_p=np.zeros((2, 1)),
        slack_by_lam=np.diag([1.5, 0.0]),
        work=np.ones(2),
    )
    energy = EnergyInequality(two, None, np.zeros(1), np.ones(1))
    assert energy.convex
    assert np.isneginf(energy.lowest()).all()
    assert energy.reachable().tolist() == [True, True]


# Branch and bound over pairs


@pytest.mark.parametrize(
    ("read", "lower", "upper", "best_p", "phi"),
    [
        (0.0, 3.4, 3.9, 3.9, (4.0 * 0.1 / 1.2) ** 2),  # elastic: no slack is below zero
        (2.0, 4.1, 5.0, None, 4.0),  # less than that: no multiplier is below zero
        (2.0, 4.0, 5.0, None, 4.0),  # with a plane that is just reached in a corner
        (-4.0, 3.4, 3.9, 3.4, 4.0),
    ],
)
def test_neither_slacks_nor_multipliers_are_below_zero(read, lower, upper, best_p, phi):
    """The misfit read + 4 lam: what is read asks for lam = -read / 4."""
    system = replace(bar(), misfit=np.array([read]))
    for known in (form(system), None):
        found = solve_box(system, box(lower, upper), known, best=17.0, gap=1e-7)
        assert found.complete
        assert found.bound == pytest.approx(phi, rel=1e-3)
        assert best_p is None or found.p == pytest.approx([best_p], abs=1e-3)
    relaxed = examined(system, form(system), box(lower, upper), best=17.0)
    assert relaxed.bound <= phi * (1.0 + 1e-6)


def test_products_of_parameters_and_multipliers_count():
    """s = k - 4 + (1.2 + 0.2 k) lam: the reading of 2.4 (lam = 1) is met at k = 7/3."""
    system = bar(products={0: np.array([[0.2]])})
    found = solve_box(system, box(1.0, 5.0), None, best=16.5, gap=1e-6)
    assert found.p == pytest.approx([2.8 / 1.2], abs=2e-3)


def test_energy_that_is_not_convex_says_nothing_in_branch_and_bound():
    """s = k - 4 - 1.2 lam: the reading of 2.4 (lam = 1) is met at k = 5.2.

    The convex part of lam S lam is zero, and lam W q <= 0 alone would leave only lam = 0.
    """
    system = replace(bar(), slack_by_lam=np.array([[-1.2]]))
    assert not form(system).convex
    found = solve_box(system, box(4.5, 5.5), form(system), best=17.0, gap=1e-6)
    assert found.p == pytest.approx([5.2], abs=1e-3)
    assert 0.0 <= found.bound <= 1e-5


# Two pairs, two parameters and three misfits, every number of its own

TWO = CondensedSystem(
    slack=np.array([-1.0, -0.6]),
    slack_by_p=np.array([[1.5, 0.0], [0.3, 1.1]]),
    slack_by_lam=np.array([[1.2, 0.25], [0.4, 0.9]]),
    misfit=np.array([-1.3, 0.4, -0.7]),
    misfit_by_p=np.array([[0.5, -0.2], [0.1, 0.8], [0.0, 0.6]]),
    misfit_by_lam=np.array([[1.0, 0.3], [-0.4, 0.7], [0.2, 1.4]]),
    products={},
    lower=np.array([0.1, 0.05]),
    upper=np.array([1.0, 0.9]),
    reference=np.ones(2),
    work=np.array([2.0, 3.2]),
    multiplier_size=np.ones(2),
)
GROWN = replace(TWO, products={1: np.array([[0.3, 0.0], [0.1, 0.5]])})


def multipliers(system, p):
    """The multipliers of the pairs at p, by trying which are active."""
    grown = system.slack_by_lam + sum(p[h] * A for h, A in system.products.items())
    free = system.slack + system.slack_by_p @ p
    for active in ([], [0], [1], [0, 1]):
        lam = np.zeros(2)
        lam[active] = np.linalg.solve(grown[np.ix_(active, active)], -free[active])
        if np.all(lam >= -1e-12) and np.all(free + grown @ lam >= -1e-12):
            return lam
    raise AssertionError


def phi(system, p):
    r = system.misfit + system.misfit_by_p @ p + system.misfit_by_lam @ multipliers(system, p)
    return float(r @ r)


def on_a_grid(system, box, count=9):
    axes = [np.linspace(a, b, count) for a, b in zip(box.lower, box.upper, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    return points, np.array([phi(system, p) for p in points])


def tried(lower, upper):
    return ParameterBox(np.array(lower), np.array(upper), 0.0, np.arange(2))


@pytest.mark.parametrize(
    ("system", "lower", "upper"),
    [
        (TWO, [0.1, 0.05], [1.0, 0.9]),
        (TWO, [0.6, 0.05], [0.9, 0.3]),
        (GROWN, [0.1, 0.5], [0.3, 0.9]),
    ],
)
def test_nothing_in_a_box_is_below_its_bound_or_outside_its_smaller_box(system, lower, upper):
    """Against all points of a grid; branch and bound comes to the lowest of them."""
    box = tried(lower, upper)
    points, values = on_a_grid(system, box)
    energy = None if system.products else form_of(system.work[:, None] * system.slack_by_lam)
    best = 1.2 * values.min()
    found = examined(system, energy, box, best)
    assert found.bound <= values.min() * (1.0 + 1e-6)
    inside = points[values <= best]
    assert np.all((inside >= found.lower - 1e-6) & (inside <= found.upper + 1e-6))
    active = np.array([multipliers(system, p) > 1e-9 for p in points]).any(axis=0)
    assert set(np.flatnonzero(active)) <= set(found.kept.tolist())
    solved = solve_box(system, box, energy, best=2.0 * values.min(), gap=1e-6)
    assert solved.complete
    assert phi(system, solved.p) == pytest.approx(solved.bound, rel=1e-3)
    assert solved.bound <= values.min() * (1.0 + 1e-6)
    assert solved.bound >= 0.99 * values.min()

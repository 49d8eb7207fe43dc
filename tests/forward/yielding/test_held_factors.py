"""Yielding ground on factors that are at hand: the same numbers for fewer factorizations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import displacement
from support.yielding import Cavity, mohr, parameters, rock

from geoident.errors import CollapseError
from geoident.forward.march import held_factors, inexact_newton
from geoident.forward.march.held_factors import HeldFactors, steps_worth
from geoident.model.case import Stage
from geoident.model.parameter import Scalar

CAVITY = Cavity(pressure=10e6, E=2e9, nu=0.3)
STAGES = tuple(
    Stage(f"s{n}", excavate=() if n else ("core",), release={"core": Scalar(part)})
    for n, part in enumerate((0.5, 0.8, 1.0))
)
P = np.array([2e9, 1.5e6])
NEAR, FAR = np.array([1.001, 1.002]) * P, np.array([0.7, 2.5]) * P


def cavity(**changes):
    """The cavity, opened in three stages, and what is read of it."""
    mesh = CAVITY.mesh("quad8", n=3, layers=14, reach=10)
    surface = mohr(Scalar(1.0, "c"), 0.5, **changes)
    staged = CAVITY.staged(
        mesh,
        stages=STAGES,
        parameters=parameters(E=2e9, c=1.5e6),
        materials={"rock": replace(rock(Scalar(1.0, "E"), 0.3, surface))},
        channels=(displacement("g", (1.01, 0.01), (1.0, 0.0)),),
    )
    return staged, staged.response([("g", stage.name) for stage in STAGES])


def cost(staged, response, p):
    """Factorizations of an evaluation, and what it finds."""
    before = staged.counts.factorizations
    found = response.evaluate(p)
    return staged.counts.factorizations - before, found


@pytest.fixture
def held(monkeypatch):
    """Steps on factors that are held, as on a large mesh in space."""
    monkeypatch.setattr(held_factors, "steps_worth", lambda n, dim: 12)


def test_what_a_factorization_is_worth():
    """None in the plane, where it is cheap; many in space, within bounds."""
    assert [steps_worth(n, 2) for n in (1_000, 1_000_000)] == [0, 0]
    assert [steps_worth(n, 3) for n in (10_000, 20_000, 1_000_000)] == [0, 14, 40]


def test_in_the_plane_every_step_is_whole(monkeypatch):
    def refused(*args, **kwargs):
        raise AssertionError

    monkeypatch.setattr(inexact_newton.Directions, "at", refused)
    staged, response = cavity()
    first, _ = cost(staged, response, P)
    near, _ = cost(staged, response, NEAR)
    assert 0 < near < first


SURFACES = [
    {}, {"psi": 0.5},
    *(pytest.param(more, marks=pytest.mark.slow) for more in ({"tension": 1e5}, {"planes": 16})),
]  # fmt: skip
"""With a symmetric tangent and without; the slow ones have one of these."""


@pytest.mark.parametrize("surface", SURFACES, ids=str)
def test_numbers_are_those_of_whole_steps(surface, monkeypatch):
    with monkeypatch.context() as large:
        large.setattr(held_factors, "steps_worth", lambda n, dim: 12)
        staged, response = cavity(**surface)
        found = [cost(staged, response, p) for p in (P, NEAR, FAR, P)]
    for p, (spent, (v, J)) in zip((P, NEAR, FAR, P), found, strict=True):
        staged, response = cavity(**surface)
        alone, (v_0, J_0) = cost(staged, response, p)
        assert spent < alone
        np.testing.assert_allclose(v, v_0, rtol=1e-9)
        np.testing.assert_allclose(J, J_0, rtol=1e-7, atol=1e-9 * np.abs(J_0).max())


@pytest.mark.usefixtures("held")
def test_what_an_evaluation_costs():
    """A few tangents, not one for every step; near by, less than one a stage."""
    staged, response = cavity()
    first, _ = cost(staged, response, P)
    near, _ = cost(staged, response, NEAR)
    far, _ = cost(staged, response, FAR)
    assert first <= 3 * len(STAGES)
    assert near < len(STAGES)
    assert far <= 2 * len(STAGES)


@pytest.mark.usefixtures("held")
def test_without_memory_for_factors_the_numbers_are_the_same():
    staged, response = cavity()
    staged.march.warm.factors.entries = 0
    many, (v, J) = cost(staged, response, P)
    again, _ = cost(staged, response, NEAR)
    few, (v_0, J_0) = cost(*cavity(), P)
    assert many >= few
    assert again > 0
    np.testing.assert_allclose(v, v_0, rtol=1e-9)
    np.testing.assert_allclose(J, J_0, rtol=1e-7)


class Kept:
    """A factor that can be lost."""

    valid = True


def test_those_held_first_stay_where_not_all_have_room():
    held, factors = HeldFactors(entries=30), [Kept() for _ in range(4)]
    for ground, factor in enumerate(factors):
        held.make_room(frozenset([ground]), "tangent", 10)
        held.keep(frozenset([ground]), "tangent", factor, 10)
    there = [held.find(frozenset([ground]), "tangent") is not None for ground in range(4)]
    assert there == [True, True, False, True]
    factors[0].valid = False
    assert held.find(frozenset([0]), "tangent") is None
    assert held.find(frozenset([1]), "elastic") is None


def test_a_factor_goes_before_its_successor_is_made():
    """Two of the same matrix are never there at once: a factor is large."""
    held, ground = HeldFactors(), frozenset([0])
    held.keep(ground, "tangent", Kept(), 10)
    held.keep(ground, "elastic", Kept(), 10)
    held.make_room(ground, "tangent", 10)
    assert held.find(ground, "tangent") is None
    assert held.find(ground, "elastic") is not None


@pytest.mark.slow  # on whole steps: test_costs_and_collapse.py
@pytest.mark.usefixtures("held")
def test_collapse_is_found_all_the_same():
    _, response = cavity()
    response.evaluate(P)
    with pytest.raises(CollapseError):
        response.evaluate(np.array([2e9, 1.0]))
    response.evaluate(P)


@pytest.mark.usefixtures("held")
def test_steps_far_from_equilibrium_are_cut_off_and_few(monkeypatch):
    """Without a limit to them, ground near collapse would be searched on the elastic factor."""
    made = []
    on_elastic = inexact_newton.Directions._on_elastic

    def counted(self, product, trial):
        made.append(self.far_steps)
        return on_elastic(self, product, trial)

    monkeypatch.setattr(inexact_newton.Directions, "_on_elastic", counted)
    _, response = cavity()
    response.evaluate(P)
    assert 0 < max(made) <= inexact_newton.MOST_FAR

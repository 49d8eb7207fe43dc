"""Planes and stresses in special position, and planes that leave no stress."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.plastic import (
    Planes,
    coulomb,
    definite,
    images,
    isotropic,
    polyhedral,
    principal,
    projection_by_piqp,
    with_slopes,
)

from geoident.fem.yielding.active_sets import DualSearch
from geoident.fem.yielding.domain import EmptyDomain, empty_domain, empty_principal_domain
from geoident.fem.yielding.planes import ScaledPlanes

SMALL = st.integers(-2, 2)


def check(elasticity, planes, trial, *, scale=None):
    """Optimality of the projection of (s, m), which is proof enough: the problem is convex."""
    law = polyhedral(elasticity, planes)
    projection = law.project(trial)
    lam = np.zeros((len(law.planes), trial.shape[1]))
    lam[:, projection.yielded] = projection.multipliers.T
    hardened = None if planes.hardening is None else lam
    excess = law.excess(projection.stress, hardened)
    size = (np.abs(trial).max() + np.abs(planes.distances).max()) if scale is None else scale
    assert excess.max() <= 1e-11 * size
    assert np.abs(excess * lam).max() <= 1e-11 * size * max(1.0, lam.max())
    rest = trial - projection.stress - elasticity @ planes.normals.T @ lam
    assert np.abs(rest).max() <= 1e-10 * size
    normals = [planes.normals[row] for row in projection.multipliers > 0.0]
    if planes.hardening is None:
        assert all(np.linalg.matrix_rank(some) == len(some) for some in normals)
    return law, projection


@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_planes_on_a_grid_through_which_many_pass_at_once(data):
    """Small integers make parallel, opposite and repeated planes and vertices of many of them."""
    size = data.draw(st.integers(2, 4))
    count = data.draw(st.integers(1, 12))
    rows = st.lists(SMALL, min_size=size, max_size=size).filter(any)
    normals = np.array(data.draw(st.lists(rows, min_size=count, max_size=count)), dtype=float)
    distances = np.array(data.draw(st.lists(SMALL, min_size=count, max_size=count)), dtype=float)
    trial = np.array(
        data.draw(st.lists(st.lists(SMALL, min_size=5, max_size=5), min_size=size, max_size=size)),
        dtype=float,
    ) * data.draw(st.sampled_from([1.0, 3.0, 1e6]))
    slack = data.draw(st.booleans())
    planes = Planes(normals, np.abs(distances) if slack else distances)
    if data.draw(st.booleans()):
        planes = Planes(normals, planes.distances, hardening=np.diag(np.arange(count) % 2 * 1.0))
    elasticity = (
        np.eye(size) if data.draw(st.booleans()) else definite(np.random.default_rng(0), size)
    )
    contradicting = empty_domain(planes.normals, planes.distances)
    if contradicting is None or planes.hardening is not None:
        try:
            check(elasticity, planes, trial)
        except EmptyDomain:
            assert planes.hardening is not None
            assert contradicting is not None
        return
    # All trial stresses lie outside of nothing.
    with pytest.raises(EmptyDomain) as caught:
        check(elasticity, planes, trial)
    some = list(caught.value.planes)
    assert empty_domain(normals[some], distances[some]) is not None


@pytest.mark.parametrize("missing", [0.0, 5e-12])
@pytest.mark.parametrize("far", [0.0, 1e-9, 1.0, 1e6])
def test_a_slab_without_thickness(far, missing):
    """Or with less than none by rounding of its distances, which is no contradiction either."""
    normals = np.array([[1.0, 2.0, 0.0], [-1.0, -2.0, 0.0], [0.0, 0.0, 1.0]])
    planes = Planes(normals, np.array([0.7, -0.7 - missing, 1.0]))
    trial = np.array([[1.0, 0.1, 0.7], [2.0, 0.3, 0.0], [5.0, -1.0, far]]) * (1.0 + far)
    check(definite(np.random.default_rng(1), 3), planes, trial)


def test_a_stress_on_a_plane_or_an_edge_is_inside():
    planes = Planes(np.eye(3), np.ones(3))
    trial = np.array([[1.0, 1.0, 1.0, 0.5], [0.0, 1.0, 1.0, 1.0], [0.0, 0.3, 1.0, 1.0]])
    assert polyhedral(np.eye(3), planes).project(trial).yielded.size == 0
    assert polyhedral(np.eye(3), planes).project(trial + 1e-17).yielded.size == 0


def test_planes_reached_without_a_multiplier_are_biactive():
    law = polyhedral(np.eye(3), Planes(np.eye(3), np.ones(3)))
    projection = law.project(np.array([[2.0, 2.0], [1.0, 0.9], [0.0, 2.0]]))
    assert (projection.multipliers > 0.0).tolist() == [[True, False, False], [True, False, True]]
    assert projection.biactive.tolist() == [[False, True, False], [False, False, False]]


@pytest.mark.parametrize("count", [5, 40])
def test_a_vertex_of_more_planes_than_dimensions(count):
    """A pyramid: all trial stresses beyond its tip end there, on independent planes of it."""
    angle = 2 * np.pi * np.arange(count) / count
    normals = np.stack([np.cos(angle), np.sin(angle), np.ones(count)], axis=1)
    planes = Planes(normals, np.zeros(count))
    rng = np.random.default_rng(0)
    lam = rng.uniform(0, 1, (count, 500)) * (rng.uniform(size=(count, 500)) < 0.2)
    elasticity = definite(rng, 3)
    trial = elasticity @ normals.T @ lam
    _, projection = check(elasticity, planes, trial)
    assert np.abs(projection.stress).max() < 1e-12 * np.abs(trial).max()
    assert (projection.multipliers > 0.0).sum(axis=1).max() <= 3


def test_nearly_parallel_planes():
    rng = np.random.default_rng(2)
    for tilt in 10.0 ** -np.arange(1.0, 16.0):
        normals = np.array([[1.0, 0, 0], [1.0, tilt, 0], [-1.0, tilt, 0], [0, 1.0, tilt]])
        planes = Planes(normals, np.array([1.0, 1.0, 0.0, 1.0]))
        check(definite(rng, 3), planes, 3 * rng.normal(size=(3, 50)), scale=1e3)


def crowded_vertex(size, miss):
    """The images of Mohr-Coulomb and a cut, many of them the same plane but for a little."""
    plain = images(coulomb(0.6, 0.8, tension=0.3))
    rng = np.random.default_rng(4)
    normals = np.pad(plain[0], ((0, 0), (0, size - 3)))
    planes = Planes(normals, plain[2] * (1.0 + miss * rng.uniform(-1, 1, len(normals))))
    trial = 3.0 * rng.normal(size=(size, 2000))
    trial[1, :1000] = trial[0, :1000]
    trial[2, :500] = trial[0, :500]
    return isotropic(1.3, 0.9, 4)[:size, :size], planes, trial


@pytest.mark.parametrize("size", [3, pytest.param(4, marks=pytest.mark.slow)])
@pytest.mark.parametrize("miss", [0.0, 1e-15, 1e-13, 1e-11, 1e-9, 1e-6])
def test_a_crowded_vertex_whose_planes_miss_each_other_by_little(size, miss):
    check(*crowded_vertex(size, miss))


def test_points_that_would_take_turns_for_ever_are_asked_for_less():
    """With next to no tolerance rounding alone takes planes of a crowded vertex in and out."""
    elasticity, planes, trial = crowded_vertex(4, 1e-14)
    system = ScaledPlanes(with_slopes(elasticity), planes.dual())
    tolerance = 1e-5 * system.tolerance(trial)
    assert DualSearch(system).find(system.excess(trial).T, tolerance.T).any()


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**31), count=st.integers(2, 20), size=st.integers(2, 6))
def test_emptiness_by_projection_and_by_linear_programming_agree(seed, count, size):
    rng = np.random.default_rng(seed)
    planes = Planes(rng.normal(size=(count, size)), rng.normal(size=count) + 0.3)
    contradicting = empty_domain(planes.normals, planes.distances)
    law = polyhedral(definite(rng, size), planes)
    if contradicting is None:
        law.project(10 * rng.normal(size=(size, 3)))
        return
    with pytest.raises(EmptyDomain) as caught:
        law.project(10 * rng.normal(size=(size, 3)))
    for some in (list(contradicting), list(caught.value.planes)):
        assert empty_domain(planes.normals[some], planes.distances[some]) is not None
    for plane in contradicting:
        rest = [other for other in contradicting if other != plane]
        less = Planes(planes.normals[rest], planes.distances[rest])
        assert not rest or empty_domain(less.normals, less.distances) is None


def test_hardening_fills_an_empty_domain():
    """k + H lam grows until there is a stress: the problem has an answer again."""
    normals = np.array([[1.0, 0, 0], [-1.0, 0, 0]])
    planes = Planes(normals, np.array([-1.0, -1.0]), hardening=0.5 * np.eye(2))
    assert empty_domain(planes.normals, planes.distances) == (0, 1)
    trial = np.array([[0.3], [1.0], [0.0]])
    _, projection = check(np.eye(3), planes, trial)
    expected = projection_by_piqp(np.eye(3), planes, trial[:, 0])
    np.testing.assert_allclose(projection.stress[:, 0], expected, atol=1e-8)


def test_what_contradicts_in_principal_stresses():
    upper, lower = [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]
    assert empty_principal_domain(coulomb(0.5, 1.0, tension=0.2).dual()) is None
    # The largest below -2 and the smallest above -1.
    planes = Planes(np.array([[1.0, 0.0, -0.2], upper, lower]), np.array([9.0, -2.0, 1.0]))
    assert empty_principal_domain(planes.dual()) == (1, 2)
    assert empty_principal_domain(coulomb(0.0, -1.0).dual()) == (0,)
    # Cohesion zero leaves the tip of the cone and what is below.
    assert empty_principal_domain(coulomb(0.5, 0.0).dual()) is None


def test_cohesion_zero_and_no_tension():
    elasticity = isotropic(1.0, 0.7, 4)
    for planes in (
        coulomb(0.5, 0.0),
        coulomb(0.5, 0.0, tension=0.0),
        coulomb(0.5, 0.0, dilation=0),
    ):
        law = principal(elasticity, planes)
        trial = np.random.default_rng(0).normal(size=(4, 500))
        trial[:, 0] = [1.0, 1.0, 1.0, 0.0]
        trial[:, 1] = 0.0
        projection = law.project(trial)
        assert law.excess(projection.stress).max() < 1e-14
        np.testing.assert_allclose(projection.stress[:, :2], 0.0, atol=1e-15)

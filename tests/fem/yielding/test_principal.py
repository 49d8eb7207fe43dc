"""Exact Mohr-Coulomb: independent returns, edges, apex, tangents and derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from support.plastic import Planes, brute_force_return, coulomb, isotropic, matrix_of, principal

from geoident.fem.yielding.domain import EmptyDomain

LAME, SHEAR = 1.3, 0.9
FRICTION, COHESION = 0.6, 0.8
FLOWS = [None, 0.0, 0.2]
CUTS = [None, 0.3]
SOME = 150
"""Points at which slopes are looked at."""


def trials(size, count, *, spread=2.0, seed=0):
    """Random stresses, and such with two or three equal principal values."""
    rng = np.random.default_rng([size, count, seed])
    stress = spread * rng.normal(size=(size, count))
    stress[3:, : count // 10] = 0.0
    stress[1, : count // 20] = stress[0, : count // 20]
    stress[:3, : count // 40] = stress[0, : count // 40]
    return stress


def turned_back(trial, values):
    """Stresses (s,) with the axes of a trial stress and other descending principal values."""
    _, axes = np.linalg.eigh(matrix_of(trial))
    full = (axes[:, ::-1] * values) @ axes[:, ::-1].T
    some = np.array([full[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))])
    return some[: len(trial)]


@pytest.mark.parametrize("cut", CUTS)
@pytest.mark.parametrize("dilation", FLOWS)
@pytest.mark.parametrize("size", [4, 6])
def test_stresses_are_those_of_all_active_sets_tried_one_by_one(size, dilation, cut):
    planes = coulomb(FRICTION, COHESION, tension=cut, dilation=dilation)
    elasticity = isotropic(LAME, SHEAR, size)
    trial = trials(size, 40)
    projection = principal(elasticity, planes).project(trial)
    apex = COHESION / np.tan(FRICTION)
    for point in range(trial.shape[1]):
        values = np.linalg.eigvalsh(matrix_of(trial[:, point]))[::-1]
        ends = brute_force_return(elasticity[:3, :3], planes, values)
        if ends is None:
            # Only a flow with too little dilation leaves tensions to the apex, where it is free.
            assert dilation is not None
            assert cut is None
            assert values.mean() > apex
            ends = np.full(3, apex)
        expected = turned_back(trial[:, point], ends)
        np.testing.assert_allclose(projection.stress[:, point], expected, rtol=0, atol=1e-8)


@pytest.mark.parametrize("cut", CUTS)
@pytest.mark.parametrize("dilation", FLOWS)
@pytest.mark.parametrize("size", [4, 6])
def test_conditions_hold_to_rounding(size, dilation, cut):
    planes = coulomb(FRICTION, COHESION, tension=cut, dilation=dilation)
    elasticity = isotropic(LAME, SHEAR, size)
    law = principal(elasticity, planes)
    trial = trials(size, 800, spread=3.0)
    projection = law.project(trial)
    lam = np.zeros((len(law.planes), trial.shape[1]))
    lam[:, projection.yielded] = projection.multipliers.T
    excess = law.excess(projection.stress)
    assert projection.multipliers.min() >= 0.0
    assert excess.max() < 1e-12 * np.abs(trial).max()
    assert np.abs(excess * lam).max() < 1e-12 * np.abs(trial).max() * max(1.0, lam.max())
    change = trial - projection.stress
    plastic = np.linalg.solve(elasticity, change)
    work = np.einsum("sm,sm->m", projection.stress, plastic)
    assert work.min() > -1e-12 * work.max()
    if dilation is None:  # the plastic work of one step is what the planes take: k lam
        np.testing.assert_allclose(work, planes.distances @ lam, rtol=0, atol=1e-10 * work.max())
    lost = 0.5 * np.einsum("sm,sm->m", change, plastic)[projection.yielded]
    np.testing.assert_allclose(projection.reserve, lost, rtol=1e-9)


def test_stress_without_dilation_keeps_its_volume_but_at_the_apex():
    law = principal(isotropic(LAME, SHEAR, 6), coulomb(FRICTION, COHESION, dilation=0.0))
    trial = trials(6, 800)
    projection = law.project(trial)
    apex = COHESION / np.tan(FRICTION)
    below = trial[:3].mean(axis=0) < apex
    change = (projection.stress - trial)[:3].sum(axis=0)
    assert np.abs(change[below]).max() < 1e-12 * np.abs(trial).max()
    ends = np.array([apex] * 3 + [0.0] * 3)[:, None]
    np.testing.assert_allclose(
        projection.stress[:, ~below], ends + 0 * trial[:, ~below], atol=1e-12
    )
    # The multiplier of the apex carries the plastic volume and so the dissipation k lam.
    volume = 3 * (trial[:3].mean(axis=0) - apex) / (3 * LAME + 2 * SHEAR)
    at_apex = ~below[projection.yielded]
    np.testing.assert_allclose(
        projection.multipliers[at_apex, 0],
        (volume / (2 * np.sin(FRICTION)))[~below],
        rtol=1e-9,
    )
    assert np.abs(projection.reduction[at_apex]).max() < 1e-12


@pytest.mark.parametrize("swapped", [False, True])
def test_of_two_cones_without_dilation_the_nearer_apex_counts(swapped):
    cones = [coulomb(0.6, 0.8, dilation=0.0), coulomb(0.3, 0.3, dilation=0.0)]
    one, other = reversed(cones) if swapped else cones
    planes = Planes(
        np.concatenate([one.normals, other.normals]),
        np.concatenate([one.distances, other.distances]),
        np.concatenate([one.flow, other.flow]),
    )
    trial = np.array([[4.0, 4.1, 3.9, 0.1]]).T
    stress = principal(isotropic(LAME, SHEAR, 4), planes).project(trial).stress[:, 0]
    apex = 0.3 / np.tan(0.3)
    assert apex < 0.8 / np.tan(0.6)
    np.testing.assert_allclose(stress, [apex, apex, apex, 0.0], atol=1e-12)


def planes_and_slopes(dilation, cut):
    """Planes of c, phi, psi and T, moved by a step of one of them, and their slopes by it."""

    def planes(step=0.0, name=""):
        def at(key, value):
            return None if value is None else value + step * (key == name)

        return coulomb(
            at("friction", FRICTION), at("cohesion", COHESION),
            tension=at("tension", cut), dilation=at("dilation", dilation),
        )  # fmt: skip

    def slopes(name):
        over, under = planes(1e-5, name), planes(-1e-5, name)
        parts = ("normals", "distances") if dilation is None else ("normals", "distances", "flow")
        return Planes(**{x: (getattr(over, x) - getattr(under, x)) / 2e-5 for x in parts})

    return planes, slopes


@pytest.mark.parametrize("cut", CUTS)
@pytest.mark.parametrize("dilation", FLOWS)
@pytest.mark.parametrize("size", [4, pytest.param(6, marks=pytest.mark.slow)])
def test_slopes_are_those_of_central_differences(size, dilation, cut):
    planes, slopes = planes_and_slopes(dilation, cut)
    rng = np.random.default_rng(3)
    elasticity, stiffer = isotropic(LAME, SHEAR, size), isotropic(0.3, -0.4, size)
    trial, move = 2.0 * rng.normal(size=(size, SOME)), rng.normal(size=(size, SOME))
    count = len(planes().normals)

    def at(name="", h=0.0, by=()):
        moduli = elasticity + (h * stiffer if name == "elasticity" else 0.0)
        law = principal(moduli, planes(h, name), by)
        projection = law.project(trial + (h * move if name == "trial" else 0.0))
        lam = np.zeros((count, SOME))
        lam[:, projection.yielded] = projection.multipliers.T
        return projection.stress, lam, projection

    points = at()[2].yielded
    # zz lies at the ends of the principal stresses and between them.
    assert points.size > 0.7 * SOME
    names = ["elasticity", "trial", "friction", "cohesion"] + ([] if cut is None else ["tension"])
    # The multipliers of the apex are another matter with the least dilation than with none.
    names += [] if dilation is None or (dilation == 0.0 and cut is None) else ["dilation"]
    for name in names:
        by = Planes(elasticity=stiffer) if name == "elasticity" else slopes(name)
        trial_slope = (move * (name == "trial"))[:, points, None]
        derivatives = at("", 0.0, [by])[2].derivatives(trial_slope, of_law=True)
        over, under = at(name, 1e-6), at(name, -1e-6)
        for place in (0, 1):
            expected = ((over[place] - under[place]) / 2e-6)[:, points]
            error = np.abs(derivatives[place][:, :, 0] - expected).max(axis=0)
            assert error.max() < 1e-6 * max(1.0, np.abs(expected).max()), name


@pytest.mark.parametrize("cut", CUTS)
@pytest.mark.parametrize("size", [4, 6])
@pytest.mark.parametrize("dilation", FLOWS)
def test_repeated_principal_values_have_the_tangent_of_their_limit(size, dilation, cut):
    """On edges, and with a cut-off on a plane that does not tie the equal ones to each other."""
    planes = coulomb(FRICTION, COHESION, dilation=dilation, tension=cut)
    law = principal(isotropic(LAME, SHEAR, size), planes)
    shears = [0.0] * (size - 3)
    cases = np.array([[1.0, 1.0, -4.0], [1.0, -4.0, -4.0], [1.0, -4.0, 1.0], [-4.0, -4.0, 1.0]])
    cases = np.concatenate([cases, [[0.9, -0.1, -0.1], [-0.1, -0.1, 0.9], [-0.1, 0.9, -0.1]]])
    cases = np.concatenate([cases, cases + 1e-13 * np.arange(3)])
    trial = np.array([[*case, *shears] for case in cases]).T
    rng = np.random.default_rng(0)
    tangent = law.project(trial).reduction
    for _ in range(5):
        change = rng.normal(size=trial.shape)
        step = 1e-5
        difference = law.project(trial + step * change).stress
        difference = (difference - law.project(trial - step * change).stress) / (2 * step)
        np.testing.assert_allclose(
            np.einsum("qst,tq->sq", tangent, change), difference, rtol=0, atol=1e-6
        )


def test_a_law_is_refused_that_makes_no_sense():
    elasticity = isotropic(LAME, SHEAR, 4)
    with pytest.raises(ValueError, match="isotropic"):
        principal(np.diag([1.0, 2.0, 3.0, 4.0]), coulomb(FRICTION, COHESION))
    with pytest.raises(ValueError, match="descend"):
        principal(elasticity, Planes(np.array([[0.0, 1.0, 0.0]]), np.ones(1)))
    with pytest.raises(EmptyDomain, match="planes 1"):
        principal(elasticity, coulomb(0.0, -1.0))
    with pytest.raises(ValueError, match="harden"):
        principal(elasticity, Planes(np.array([[1.0, 0.0, 0.0]]), np.ones(1), None, np.eye(1)))

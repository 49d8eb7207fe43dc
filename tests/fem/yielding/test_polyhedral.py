"""Projection on polyhedra: an independent solver, optimality, derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from support.plastic import Planes, definite, polyhedral, projection_by_piqp, random_planes

SHAPES = [(4, 3), (8, 4), (16, 4), (12, 6), (100, 6)]


def problem(count, size, *, points, hardening=0.0, spread=2.0):
    rng = np.random.default_rng([count, size, points])
    planes = random_planes(rng, count, size, hardening=hardening)
    elasticity = definite(rng, size)
    trial = spread * rng.normal(size=(size, points))
    hardened = rng.uniform(0.0, 0.2, (count, points)) if hardening else None
    return rng, elasticity, planes, trial, hardened


def whole(projection, count):
    """Multipliers of all points (y, m)."""
    full = np.zeros((count, projection.stress.shape[1]))
    full[:, projection.yielded] = projection.multipliers.T
    return full


@pytest.mark.parametrize("hardening", [0.0, 0.3])
@pytest.mark.parametrize(("count", "size"), SHAPES)
def test_stresses_are_those_of_an_independent_solver(count, size, hardening):
    points = 24 if count > 50 else 120
    _, elasticity, planes, trial, hardened = problem(
        count, size, points=points, hardening=hardening
    )
    stress = polyhedral(elasticity, planes).project(trial, hardened).stress
    for point in range(points):
        before = None if hardened is None else hardened[:, point]
        expected = projection_by_piqp(elasticity, planes, trial[:, point], before)
        np.testing.assert_allclose(
            stress[:, point], expected, rtol=0, atol=1e-8 * np.abs(trial[:, point]).max()
        )


@pytest.mark.parametrize("spread", [1.0, 1e6])
@pytest.mark.parametrize("hardening", [0.0, 0.3])
@pytest.mark.parametrize(("count", "size"), SHAPES)
def test_conditions_hold_to_rounding(count, size, hardening, spread):
    _, elasticity, planes, trial, hardened = problem(
        count, size, points=60 if count > 50 else 1000, hardening=hardening, spread=spread
    )
    law = polyhedral(elasticity, planes)
    projection = law.project(trial, hardened)
    lam = whole(projection, count)
    total = lam if hardened is None else lam + hardened
    excess = law.excess(projection.stress, total)
    scale = np.abs(planes.normals).sum(axis=1).max() * np.abs(trial).max(axis=0) + 1.5
    # The scale of a multiplier is what takes all of the trial stress away.
    strains = np.abs(lam).max(axis=0) + 1e-300
    np.testing.assert_array_less(excess.max(axis=0) / scale, 1e-12)
    np.testing.assert_array_less(np.abs(excess * lam).max(axis=0) / (scale * strains), 1e-12)
    assert lam.min() >= 0.0
    rest = trial - projection.stress - elasticity @ planes.normals.T @ lam
    np.testing.assert_array_less(np.abs(rest).max(axis=0) / scale, 1e-11)
    assert np.array_equal(np.flatnonzero(lam.any(axis=0)), projection.yielded)
    energy = np.einsum("sm,sm->m", trial - projection.stress, planes.normals.T @ lam)
    energy += np.einsum("im,im->m", lam, planes.hardening @ lam) if hardening else 0.0
    np.testing.assert_allclose(projection.reserve, 0.5 * energy[projection.yielded], rtol=1e-7)


ALONE = ("elasticity", "normals", "distances", "trial")


@pytest.mark.parametrize(
    ("what", "hardening"),
    [*((name, 0.0) for name in ALONE), *((name, 0.3) for name in (*ALONE, "hardening", "before"))],
)
def test_slopes_are_those_of_central_differences(what, hardening):
    rng, elasticity, planes, trial, before = problem(9, 4, points=500, hardening=hardening)
    given = {"elasticity": elasticity, "trial": trial, "before": before}
    given |= {name: getattr(planes, name) for name in ("normals", "distances", "hardening")}
    symmetric = what in ("elasticity", "hardening")
    shape = given[what].shape
    change = definite(rng, shape[0]) if symmetric else rng.normal(size=shape)
    of_law = what not in ("trial", "before")

    def at(step):
        moved = {**given, what: given[what] + step * change}
        numbers = Planes(moved["normals"], moved["distances"], hardening=moved["hardening"])
        slopes = [Planes(**{what: change})] if of_law else [Planes()]
        projection = polyhedral(moved["elasticity"], numbers, slopes).project(
            moved["trial"], moved["before"]
        )
        return projection.stress, whole(projection, 9), projection

    step, over, under = at(0.0)[2], at(1e-6), at(-1e-6)
    points = step.yielded
    columns = [
        (change if what == "trial" else 0.0 * trial)[:, points, None],
        change[:, points, None] if what == "before" else None,
    ]
    for place, slopes in enumerate(step.derivatives(*columns, of_law=True)):
        expected = ((over[place] - under[place]) / 2e-6)[:, points]
        error = np.abs(slopes[:, :, 0] - expected).max(axis=0) / np.abs(slopes).max()
        # No point of these lies at a kink.
        assert error.max() < 1e-6


def test_slopes_of_the_trial_stress_alone_are_the_reduction():
    rng, elasticity, planes, trial, _ = problem(9, 4, points=100)
    projection = polyhedral(elasticity, planes).project(trial)
    change = rng.normal(size=(4, projection.yielded.size, 3))
    stress, _ = projection.derivatives(change, of_law=False)
    expected = np.einsum("qst,tqn->sqn", projection.reduction, change)
    np.testing.assert_allclose(stress, expected, atol=1e-10)


def test_a_law_is_refused_that_makes_no_sense():
    with pytest.raises(ValueError, match="positive definite"):
        polyhedral(-np.eye(3), Planes(np.eye(3), np.ones(3)))
    with pytest.raises(ValueError, match="plane 2 has no normal"):
        polyhedral(np.eye(3), Planes(np.diag([1.0, 0.0, 1.0]), np.ones(3)))
    with pytest.raises(ValueError, match="finite"):
        polyhedral(np.eye(3), Planes(np.eye(3), np.array([1.0, np.inf, 1.0])))
    with pytest.raises(ValueError, match="flows inwards"):
        polyhedral(np.eye(3), Planes(np.eye(3), np.ones(3), flow=np.diag([1.0, -1.0, 1.0])))

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


@pytest.mark.parametrize("hardening", [0.0, 0.3])
def test_plastic_work_is_not_negative_and_reserve_is_its_potential(hardening):
    _, elasticity, planes, trial, hardened = problem(12, 4, points=2000, hardening=hardening)
    projection = polyhedral(elasticity, planes).project(trial, hardened)
    points = projection.yielded
    stress = projection.stress[:, points]
    plastic = np.linalg.solve(elasticity, trial[:, points] - stress)
    assert np.all(np.einsum("sq,sq->q", stress, plastic) >= 0.0)
    stored = 0.0
    if hardening:
        lam = projection.multipliers
        stored = np.einsum("qi,ij,qj->q", lam, planes.hardening, lam)
    expected = 0.5 * (np.einsum("sq,sq->q", trial[:, points] - stress, plastic) + stored)
    np.testing.assert_allclose(projection.reserve, expected, rtol=1e-9)


def derivative_case(hardening):
    rng, elasticity, planes, trial, hardened = problem(9, 4, points=500, hardening=hardening)
    stiffer, harder = definite(rng, 4), definite(rng, 9)
    change = {
        "elasticity": stiffer,
        "normals": rng.normal(size=planes.normals.shape),
        "distances": rng.normal(size=9),
        "trial": rng.normal(size=trial.shape),
    }
    if hardening:
        change |= {"hardening": harder, "hardened": rng.normal(size=(9, trial.shape[1]))}
    return elasticity, planes, trial, hardened, change


@pytest.mark.parametrize("hardening", [0.0, 0.3])
@pytest.mark.parametrize(
    "what", ["elasticity", "normals", "distances", "trial", "hardening", "hardened"]
)
def test_slopes_are_those_of_central_differences(what, hardening):
    if not hardening and what.startswith("harden"):
        return
    elasticity, planes, trial, hardened, changes = derivative_case(hardening)
    change = {what: changes[what]}
    names = ("elasticity", "normals", "distances", "hardening")

    def at(step):
        def moved(name, value):
            return value if name not in change else value + step * change[name]

        law = polyhedral(
            moved("elasticity", elasticity),
            Planes(
                moved("normals", planes.normals),
                moved("distances", planes.distances),
                hardening=moved("hardening", planes.hardening),
            ),
            [Planes(**{name: change[name] for name in names if name in change})],
        )
        projection = law.project(moved("trial", trial), moved("hardened", hardened))
        return projection.stress, whole(projection, 9), projection

    base = at(0.0)[2]
    points = base.yielded
    forward, backward = at(1e-6), at(-1e-6)
    columns = [
        change.get("trial", np.zeros_like(trial))[:, points, None],
        change["hardened"][:, points, None] if "hardened" in change else None,
    ]
    for place, slopes in enumerate(base.derivatives(*columns, of_law=True)):
        expected = ((forward[place] - backward[place]) / 2e-6)[:, points]
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
    with pytest.raises(ValueError, match="along their normals"):
        polyhedral(np.eye(3), Planes(np.eye(3), np.ones(3), flow=np.eye(3)))

"""Return to Coulomb's cone with a cut-off against its definition, and its exact derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from geoident.fem.yielding.coulomb_cone import ConeLimits, CoulombCone
from geoident.model.dual import Dual
from tests.support.derivatives import assert_slopes

NUMBERS = {"c": 30e3, "steep": 0.6, "opens": 0.2, "T": 20e3, "k_n": 5e9, "k_s": 2e9}
TIP = NUMBERS["c"] / NUMBERS["steep"]
PLACES = {
    "mantle": (-60e3, 90e3, 40e3),
    "cut-off": (50e3, 10e3, -8e3),
    "edge": (150e3, 50e3, -70e3),
    "tip": (120e3, 20e3, 35e3),
}  # of trial tractions; at the tip nothing cuts the cone off
AT = pytest.mark.parametrize("place", list(PLACES))


def cone(n_slips: int = 2, **changes: float) -> CoulombCone:
    """The law with derivatives by all constants."""
    values, one = {**NUMBERS, **changes}, np.eye(len(NUMBERS))
    c, steep, opens, T, k_n, k_s = (
        Dual(np.concatenate([[values[name]], one[k]])) for k, name in enumerate(NUMBERS)
    )
    return CoulombCone(k_n, k_s, ConeLimits(c, steep, opens, T), n_slips)


def at(place: str, **changes: float) -> CoulombCone:
    """The law with which the trial traction of a place ends there."""
    return cone(T=TIP, **changes) if place == "tip" else cone(**changes)


def trials(n: int = 3000) -> np.ndarray:
    """Trial tractions (3, n) all over and about the tip and the edge."""
    random = np.random.default_rng(1)
    spread = random.normal(size=(3, n)) * 10 ** random.uniform(2, 6, n)
    spread[0, ::3] += NUMBERS["T"]
    return spread


@pytest.mark.parametrize("T", [NUMBERS["T"], TIP, 0.0])
@pytest.mark.parametrize("opens", [0.0, 0.2, 0.6])
def test_the_end_is_within_the_limits_and_flow_is_theirs(T, opens):
    """Within both limits; slip is along t_s and opens by tan(psi), as the cut-off does.

    Multipliers are not negative, and zero off their limit.
    """
    law, trial = cone(T=T, opens=opens), trials()
    step = law.project(trial)
    end, size = step.stress, 1e-10 * (np.abs(trial).max(axis=0) + NUMBERS["c"])
    assert (law.excess(end) <= size).all()
    slip, parts = np.zeros((2, trial.shape[1]))
    slip[step.yielded], parts[step.yielded] = step.multipliers.T
    assert (step.multipliers >= 0.0).all()
    assert (step.multipliers.max(axis=1) > 0.0).all()
    plastic = (trial - end) / np.array([NUMBERS["k_n"], NUMBERS["k_s"], NUMBERS["k_s"]])[:, None]
    np.testing.assert_allclose(plastic[0], opens * slip + parts, atol=size.max() / 1e9)
    np.testing.assert_allclose(np.linalg.norm(plastic[1:], axis=0), slip, atol=size.max() / 1e9)
    across = end[1] * trial[2] - end[2] * trial[1]
    assert (np.abs(across) <= 1e-14 * (trial**2).max(axis=0)).all()
    assert ((end[1:] * trial[1:]).sum(axis=0) >= 0.0).all()
    off = law.excess(end) < -1e3 * size
    assert not (off & (np.stack([slip, parts]) > 0.0)).any()


@AT
def test_associated_flow_ends_at_the_nearest_traction(place):
    """In the norm of the elastic energy, which a general optimiser minimises; `reserve` is that."""
    law = at(place, opens=NUMBERS["steep"])
    trial, T = np.array(PLACES[place]), TIP if place == "tip" else NUMBERS["T"]
    stiff = np.array([NUMBERS["k_n"], *[NUMBERS["k_s"]] * 2]) / 1e9
    step = law.project(trial[:, None])

    def energy(x: np.ndarray) -> float:
        return float(0.5 * ((x - trial / 1e3) ** 2 / stiff).sum())

    found = minimize(
        energy, np.zeros(3), method="SLSQP", options={"ftol": 1e-14, "maxiter": 500},
        jac=lambda x: (x - trial / 1e3) / stiff,
        constraints=[
            {"type": "ineq", "fun": lambda x: -law.excess(1e3 * x[:, None])[0, 0] / 1e3},
            {"type": "ineq", "fun": lambda x: T / 1e3 - x[0]},
        ],
    )  # fmt: skip
    np.testing.assert_allclose(step.end[:, 0] / 1e3, found.x, rtol=1e-5, atol=1e-4)
    assert step.reserve[0] == pytest.approx(energy(step.end[:, 0] / 1e3) * 1e6 / 1e9)
    reduced = step.reduction[0] * stiff
    np.testing.assert_allclose(reduced, reduced.T, atol=1e-12)  # the tangent is symmetric


@AT
@pytest.mark.parametrize("opens", [0.01, 0.2, 0.6])
def test_the_tangent_and_derivatives_by_all_constants_are_exact(place, opens):
    """By the trial traction and by c, phi, psi, T, k_n and k_s, with differences to 1e-7."""
    start, trial = {**NUMBERS, "opens": opens}, np.array(PLACES[place])
    start["T"] = TIP if place == "tip" else start["T"]
    fixed = [name for name in start if place == "tip" and name in ("c", "steep", "T")]
    names = [name for name in start if name not in fixed]  # with these the tip itself moves
    step = cone(**start).project(trial[:, None])
    flows = {"mantle": [True, False], "cut-off": [False, True]}.get(place, [True, True])
    np.testing.assert_array_equal(step.multipliers[0] > 0.0, flows)

    def ends(x: np.ndarray) -> np.ndarray:
        changed = {**start, **dict(zip(names, x[3:], strict=True))}
        return cone(**changed).project(x[:3, None]).stress[:, 0]

    n = len(NUMBERS)
    columns = np.concatenate([np.zeros((3, 1, n)), np.eye(3)[:, None]], axis=2)
    slopes, _ = step.derivatives(columns, of_law=True)
    own = [list(NUMBERS).index(name) for name in names]
    jacobian = np.concatenate([slopes[:, 0, n:], slopes[:, 0, own]], axis=1)
    np.testing.assert_allclose(step.reduction[0], slopes[:, 0, n:], atol=1e-14)
    x = np.array([*trial, *(start[name] for name in names)])
    assert_slopes(ends, x, jacobian, ("t_n", "t_1", "t_2", *names), step=1e-3)


def test_every_direction_along_the_face_is_alike():
    """The traction and the tangent turn as the trial traction does; one t_s is that of a plane."""
    law, turns = cone(), np.linspace(0.0, 2 * np.pi, 37)
    trial = np.stack([np.full(37, -60e3), 9e4 * np.cos(turns), 9e4 * np.sin(turns)])
    step = law.project(trial)
    np.testing.assert_allclose(
        np.hypot(*step.stress[1:]), np.hypot(*step.stress[1:, 0]), rtol=1e-14
    )
    for T, turn in zip(step.reduction, turns, strict=True):
        Q = np.eye(3)
        Q[1:, 1:] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
        np.testing.assert_allclose(Q.T @ T @ Q, step.reduction[0], atol=1e-14)
    plane = cone(n_slips=1).project(trial[:2]).stress
    np.testing.assert_allclose(plane[:, 0], step.stress[:2, 0])


@pytest.mark.parametrize("opens", [0.0, 0.2, 0.6])
def test_newtons_method_with_the_tangent_converges_quadratically(opens):
    """A point on springs beside the joint, stressed before across the force that comes."""
    law = cone(opens=opens)
    springs = 1e9 * np.array([[2.0, 0.5, 0.2], [0.5, 2.0, 0.7], [0.2, 0.7, 1.0]])
    stiff = np.diag([NUMBERS["k_n"], NUMBERS["k_s"], NUMBERS["k_s"]])
    force, before, left = np.array([-60e3, 400e3, 90e3]), np.array([-30e3, -20e3, 60e3]), []
    jump = np.linalg.solve(springs + stiff, force - before)
    for _ in range(7):
        step = law.project((before + stiff @ jump)[:, None])
        rest = force - springs @ jump - step.stress[:, 0]
        left.append(np.abs(rest).max() / np.abs(force).max())
        jump = jump + np.linalg.solve(springs + step.reduction[0] @ stiff, rest)
    assert left[-1] < 1e-14
    last = next(n for n, part in enumerate(left) if part < 1e-7)
    assert left[last] < left[last - 1] ** 2

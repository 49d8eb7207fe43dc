"""Return to the surface of Hoek and Brown against its definition, and its exact derivatives."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from scipy.optimize import minimize, nnls

from geoident.fem.yielding import curved_return
from geoident.fem.yielding.curved_return import HoekBrownConstants, HoekBrownCurve, returned
from geoident.fem.yielding.hoek_brown import HoekBrownLaw
from geoident.model.dual import Dual

E, NU = 5e9, 0.28
LAME, G = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
COMPLIANCE = ((1 + NU) * np.eye(3) - NU) / E
NAMES = ("sigci", "mb", "s", "a", "dilation", "tension", "E", "nu")
ROCK = {"sigci": 40e6, "mb": 1.5, "s": 4e-3, "a": 0.51, "dilation": 0.2, "tension": 0.06e6}
TIP = ROCK["s"] * ROCK["sigci"] / ROCK["mb"]
FLOWS = pytest.mark.parametrize("dilation", [None, 0.0, 0.2], ids=["associated", "none", "some"])
CUTS = pytest.mark.parametrize("tension", [None, 0.6 * TIP, 0.0], ids=["tip", "cut", "no tension"])


def constants(**changes: float | None) -> HoekBrownConstants:
    given = {**ROCK, **changes}
    numbers = {n: None if x is None else Dual(np.array([float(x)])) for n, x in given.items()}
    return HoekBrownConstants(**numbers)


def curve(**changes: float | None) -> HoekBrownCurve:
    return HoekBrownCurve(constants(**changes), LAME, G)


def trials(surface: HoekBrownCurve, seed: int = 0) -> np.ndarray:
    """Sorted trial stresses (3, q) outside: all over, two alike, about the tip and the corner."""
    random = np.random.default_rng(seed)
    strength = ROCK["sigci"] * ROCK["s"] ** ROCK["a"]
    found = random.normal(size=(3, 400)) * 10 ** random.uniform(-2, 1, 400) * strength
    found -= random.uniform(-1, 3, 400) * np.abs(found).max(axis=0)
    found[1, 50:100] = found[0, 50:100]
    found[1, 100:150] = found[2, 100:150]
    found[:, 200:300] = surface.cut + 1e-4 * found[:, 200:300]
    found[:, 300:] = beyond_the_corner(surface, random)
    found = -np.sort(-found, axis=0)
    return found[:, surface.excess(found) > 1e-12 * np.abs(found).max(axis=0)]


def beyond_the_corner(surface: HoekBrownCurve, random: np.random.Generator) -> np.ndarray:
    """Trial stresses (3, 100) of flow on surface and cut-off together, sigma_2 at all places."""
    y = np.full(100, surface.y_cut)
    up, down, _ = surface.directions(y ** (1.0 - surface.a))
    width = surface.width(y)
    place = np.repeat([0.0, 0.3, 0.7, 1.0], 25)
    stress = surface.cut - np.stack([0.0 * y, place * width, width])
    plastic = np.zeros((3, 100))
    for k, share in enumerate(random.uniform(0.0, 1e-4, size=(4, 100))):
        i, j = ((0, 2), (1, 2), (0, 1), (0, 0))[k]
        on = {1: place == 0.0, 2: place == 1.0}.get(k, place >= 0.0)
        plastic[i] += share * up * on
        plastic[j] -= share * down * on * (i != j)
    return stress + np.linalg.solve(COMPLIANCE, plastic)


def flows_at(surface: HoekBrownCurve, stress: np.ndarray, near: float) -> np.ndarray:
    """Directions of flow (3, k) of all planes that pass through a stress, in all its orders."""
    found = []
    for i, j in permutations(range(3), 2):
        y = max(surface.s - surface.mb * stress[i] / surface.sigci, 0.0)
        z = y ** (1.0 - surface.a)
        f = stress[i] - stress[j] - surface.sigci * y**surface.a
        if abs(f) * min(1.0, z) <= near:
            up, down = (z + surface.mb * surface.a, z) if surface.flow is None else surface.flow
            found.append(up * np.eye(3)[i] - down * np.eye(3)[j])
    found += [np.eye(3)[i] for i in range(3) if abs(stress[i] - surface.cut) <= near]
    return np.array([flow / np.linalg.norm(flow) for flow in found]).T


@FLOWS
@CUTS
def test_return_is_admissible_and_flows_as_the_planes_that_it_ends_on(dilation, tension):
    surface = curve(dilation=dilation, tension=tension)
    trial = trials(surface)
    found = returned(surface, trial)
    size = np.abs(trial).max(axis=0)
    assert np.all(np.diff(found.stress, axis=0) <= 1e-12 * size)
    # The width of the surface at the tip is the root of a rounding error.
    assert np.all(surface.excess(found.stress) <= 1e-8 * size)
    for n in range(trial.shape[1]):
        plastic = COMPLIANCE @ (trial[:, n] - found.stress[:, n])
        _, rest = nnls(flows_at(surface, found.stress[:, n], 1e-9 * size[n]), plastic)
        assert rest <= 1e-8 * np.linalg.norm(plastic)
    sets = np.unique(found.active)
    assert len(sets) == (4 if tension is None else 9), sets


def test_associated_return_is_the_nearest_stress_in_energy():
    """Brute force: a general minimiser over all six yield functions, from inside the surface."""
    surface = curve(dilation=None, tension=None)
    trial = trials(surface, seed=3)
    trial = trial[:, np.abs(trial).max(axis=0) > 0.1 * ROCK["sigci"] * ROCK["s"] ** ROCK["a"]]
    size = np.abs(trial).max(axis=0)

    def room(x: np.ndarray, unit: float) -> np.ndarray:
        stress = unit * x
        y = surface.s - surface.mb * stress / surface.sigci
        pairs = list(permutations(range(3), 2))
        apart = np.array([max(stress[i] - stress[j], 0.0) / surface.sigci for i, j in pairs])
        return np.array([y[i] for i, _ in pairs]) - apart ** (1.0 / surface.a)

    worst = 0.0
    for n in range(0, trial.shape[1], 12):
        p, unit = trial[:, n], size[n]
        best = minimize(
            lambda x, p=p, unit=unit: 0.5 * (p / unit - x) @ (COMPLIANCE * E) @ (p / unit - x),
            np.full(3, -1.0),
            jac=lambda x, p=p, unit=unit: -(COMPLIANCE * E) @ (p / unit - x),
            constraints={"type": "ineq", "fun": room, "args": (unit,)},
            method="SLSQP",
            options={"ftol": 1e-15, "maxiter": 300},
        )
        ours = returned(surface, trial[:, n : n + 1]).stress[:, 0]
        energy = 0.5 * (p - ours) @ COMPLIANCE @ (p - ours) * E / unit**2
        assert energy <= best.fun * (1.0 + 1e-9) + 1e-14
        worst = max(worst, np.abs(ours / unit - best.x).max())
    assert worst < 1e-4


def law(values: dict[str, float], n_stress: int, *, associated: bool, natural: bool):
    numbers = {
        name: Dual(np.concatenate([[values[name]], np.eye(len(NAMES))[k]]))
        for k, name in enumerate(NAMES)
    }
    modulus, nu = numbers["E"], numbers["nu"]
    lame = modulus * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
    shear = modulus / (2.0 * (1.0 + nu))
    elasticity = np.zeros((n_stress, n_stress, 1 + len(NAMES)))
    elasticity[:3, :3] = lame.columns
    for k in range(n_stress):
        elasticity[k, k] += (2.0 if k < 3 else 1.0) * shear.columns
    surface = HoekBrownConstants(
        *(numbers[name] for name in ("sigci", "mb", "s", "a")),
        None if associated else numbers["dilation"],
        None if natural else numbers["tension"],
    )
    return HoekBrownLaw(Dual(elasticity), surface)


@pytest.mark.parametrize(
    ("n_stress", "associated", "natural"),
    [
        (4, True, True),
        (4, False, False),
        (6, True, False),
        (6, False, True),
        pytest.param(4, True, False, marks=pytest.mark.slow),
        pytest.param(4, False, True, marks=pytest.mark.slow),
        pytest.param(6, True, True, marks=pytest.mark.slow),
        pytest.param(6, False, False, marks=pytest.mark.slow),
    ],
)
def test_tangent_and_derivatives(n_stress, associated, natural):
    """By the trial stress and by all constants, on the face, the edges, the cut-off, the tip."""
    values, kind = {**ROCK, "E": E, "nu": NU}, {"associated": associated, "natural": natural}
    random = np.random.default_rng(5)
    strength = ROCK["sigci"] * ROCK["s"] ** ROCK["a"]
    size = 10 ** random.uniform(-1.5, 0.7, 400) * strength
    trial = random.normal(size=(n_stress, 400)) * size
    trial[3:] *= 0.1
    trial[:3] -= random.uniform(-1.5, 2, 400) * size
    if not natural:
        changes = {"dilation": None} if associated else {}
        trial[:, :100] *= 1e-3
        trial[:3, :100] += beyond_the_corner(curve(**changes), random)
    found = law(values, n_stress, **kind).project(trial)
    at, scale = found.yielded, np.abs(trial).max(axis=0)
    assert len(np.unique(found.step.found.active)) == (4 if natural else 9)

    def stress(trial, **changes):
        return law({**values, **changes}, n_stress, **kind).project(trial).stress[:, at]

    for k in range(n_stress):
        step = 1e-6 * scale * np.eye(n_stress)[k][:, None]
        numeric = (stress(trial + step) - stress(trial - step)) / (2e-6 * scale[at])
        np.testing.assert_allclose(found.reduction[:, :, k].T, numeric, atol=2e-7)
    exact, _ = found.derivatives(np.zeros((n_stress, len(at), len(NAMES))), of_law=True)
    for k, name in enumerate(NAMES):
        h = 1e-6 * values[name]
        more, less = (stress(trial, **{name: values[name] + side * h}) for side in (1, -1))
        numeric = (more - less) / 2e-6 / scale[at]
        np.testing.assert_allclose(exact[:, :, k] * values[name] / scale[at], numeric, atol=2e-7)


def test_associated_tangent_is_symmetric():
    surface = law({**ROCK, "E": E, "nu": NU}, 6, associated=True, natural=False)
    random = np.random.default_rng(1)
    found = surface.project(2e6 * random.normal(size=(6, 200)))
    moduli = np.zeros((6, 6))
    moduli[:3, :3] = LAME
    moduli += G * np.diag([2, 2, 2, 1, 1, 1])
    tangent = found.reduction @ moduli
    np.testing.assert_allclose(tangent, np.swapaxes(tangent, 1, 2), atol=1e-9 * E)


@pytest.mark.parametrize("s", [4e-3, 0.0])
def test_excess_is_the_strength_that_a_stress_lacks(s):
    surface = law({**ROCK, "s": s, "E": E, "nu": NU}, 6, associated=True, natural=True)
    random = np.random.default_rng(2)
    stress = np.zeros((6, 50))
    stress[0] = -random.uniform(0.01, 5, 50) * 1e6
    for needed in (0.5 * ROCK["sigci"], 2.0 * ROCK["sigci"]):
        y = s - ROCK["mb"] * stress[0] / needed
        stress[2] = stress[0] - needed * y ** ROCK["a"]
        stress[1] = 0.5 * (stress[0] + stress[2])
        np.testing.assert_allclose(surface.excess(stress)[0], needed - ROCK["sigci"], rtol=1e-9)
    within = surface.excess(np.zeros((6, 1)))[0]
    assert within < 0.0


def test_a_tension_beyond_the_tip_changes_nothing():
    trial = trials(curve(tension=None))
    for dilation in (None, 0.2):
        plain = returned(curve(dilation=dilation, tension=None), trial)
        cut = returned(curve(dilation=dilation, tension=1.5 * TIP), trial)
        np.testing.assert_array_equal(plain.stress, cut.stress)


@FLOWS
def test_roots_end_where_only_rounding_is_left(monkeypatch, dilation):
    """Tens of evaluations of an equation and not two hundred; its roots are those of halving."""
    found = []
    search = curved_return.bracketed

    def counted(equation, low, high):
        calls = []

        def seen(x):
            calls.append(x)
            return equation(x)

        root = search(seen, low, high)
        below, above = low.copy(), high.copy()
        for _ in range(80):
            middle = 0.5 * (below + above)
            under = equation(middle)[0] <= 0.0
            below, above = np.where(under, middle, below), np.where(under, above, middle)
        np.testing.assert_allclose(root, 0.5 * (below + above), rtol=1e-13, atol=1e-16)
        found.append(len(calls))
        return root

    monkeypatch.setattr(curved_return, "bracketed", counted)
    surface = curve(dilation=dilation, tension=None)
    returned(surface, trials(surface))
    assert found
    assert max(found) <= 45

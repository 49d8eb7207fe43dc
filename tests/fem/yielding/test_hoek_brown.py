"""Return to the surface of Hoek and Brown against its definition, and its exact derivatives."""

from __future__ import annotations

from decimal import Decimal, localcontext
from itertools import permutations
from math import sin

import numpy as np
import pytest
from scipy.optimize import nnls

from geoident.fem.yielding.hoek_brown import HoekBrownConstants, HoekBrownLaw
from geoident.model.dual import Dual

E, NU = 5e9, 0.28
LAME, G = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
COMPLIANCE = ((1 + NU) * np.eye(3) - NU) / E
NAMES = ("sigci", "mb", "s", "a", "dilation", "tension", "E", "nu")
ROCK = {"sigci": 40e6, "mb": 1.5, "s": 4e-3, "a": 0.51, "dilation": 0.2, "tension": 0.06e6}
ROCK |= {"E": E, "nu": NU}
SIGCI, MB, S, A = (ROCK[name] for name in ("sigci", "mb", "s", "a"))
TIP = S * SIGCI / MB
STRENGTH = SIGCI * S**A
FLOWS = pytest.mark.parametrize("dilation", [None, 0.0, 0.2], ids=["associated", "none", "some"])
CUTS = pytest.mark.parametrize("tension", [None, 0.6 * TIP, 0.0], ids=["tip", "cut", "no tension"])


def law(n_stress: int = 4, **changes: float | None) -> HoekBrownLaw:
    """The law with derivatives by all constants."""
    values = {**ROCK, **changes}
    numbers = {
        name: None
        if values[name] is None
        else Dual(np.concatenate([[values[name]], np.eye(len(NAMES))[k]]))
        for k, name in enumerate(NAMES)
    }
    modulus, nu = numbers.pop("E"), numbers.pop("nu")
    lame = modulus * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
    shear = modulus / (2.0 * (1.0 + nu))
    elasticity = np.zeros((n_stress, n_stress, 1 + len(NAMES)))
    elasticity[:3, :3] = lame.columns
    for k in range(n_stress):
        elasticity[k, k] += (2.0 if k < 3 else 1.0) * shear.columns
    return HoekBrownLaw(Dual(elasticity), HoekBrownConstants(**numbers))


def ends_of(principal: np.ndarray, **changes: float | None) -> np.ndarray:
    """Principal stresses (3, q) where sorted ones end."""
    trial = np.concatenate([principal, np.zeros((1, principal.shape[1]))])
    return law(**changes).project(trial).stress[:3]


def width(largest: np.ndarray) -> np.ndarray:
    return SIGCI * np.maximum(S - MB * largest / SIGCI, 0.0) ** A


def excess(stress: np.ndarray, tension: float | None) -> np.ndarray:
    cut = TIP if tension is None else tension
    return np.maximum(stress[0] - stress[2] - width(stress[0]), stress[0] - cut)


def flow_of_pair(largest: float, dilation: float | None) -> tuple[float, float]:
    """What a pair of principal stresses opens, and shortens."""
    if dilation is not None:
        return 1.0 + sin(dilation), 1.0 - sin(dilation)
    z = max(S - MB * largest / SIGCI, 0.0) ** (1.0 - A)
    return z + MB * A, z


def trials(tension: float | None, dilation: float | None, seed: int = 0) -> np.ndarray:
    """Sorted trial stresses (3, q) outside: all over, two alike, about the tip and the corner."""
    random = np.random.default_rng(seed)
    stress = random.normal(size=(3, 400)) * 10 ** random.uniform(-2, 1, 400) * STRENGTH
    stress -= random.uniform(-1, 3, 400) * np.abs(stress).max(axis=0)
    stress[1, 50:100] = stress[0, 50:100]
    stress[1, 100:150] = stress[2, 100:150]
    stress[:, 200:300] = (TIP if tension is None else tension) + 1e-4 * stress[:, 200:300]
    stress[:, 300:] = beyond_the_corner(tension, dilation, random)
    stress = -np.sort(-stress, axis=0)
    return stress[:, excess(stress, tension) > 1e-12 * np.abs(stress).max(axis=0)]


def beyond_the_corner(
    tension: float | None, dilation: float | None, random: np.random.Generator
) -> np.ndarray:
    """Trial stresses (3, 100) of flow on surface and cut-off together, sigma_2 at all places."""
    cut = TIP if tension is None else tension
    up, down = flow_of_pair(cut, dilation)
    place = np.repeat([0.0, 0.3, 0.7, 1.0], 25)
    stress = cut - np.stack([0.0 * place, place * width(cut), width(cut) + 0.0 * place])
    plastic = np.zeros((3, 100))
    for k, share in enumerate(random.uniform(0.0, 1e-4, size=(4, 100))):
        i, j = ((0, 2), (1, 2), (0, 1), (0, 0))[k]
        on = {1: place == 0.0, 2: place == 1.0}.get(k, place >= 0.0)
        plastic[i] += share * up * on
        plastic[j] -= share * down * on * (i != j)
    return stress + np.linalg.solve(COMPLIANCE, plastic)


def flows_at(
    stress: np.ndarray, tension: float | None, dilation: float | None, near: float
) -> np.ndarray:
    """Directions of flow (3, k) of all planes that pass through a stress, in all its orders."""
    flows = []
    for i, j in permutations(range(3), 2):
        z = max(S - MB * stress[i] / SIGCI, 0.0) ** (1.0 - A)
        f = stress[i] - stress[j] - width(stress[i])
        if abs(f) * min(1.0, z) <= near:
            up, down = flow_of_pair(stress[i], dilation)
            flows.append(up * np.eye(3)[i] - down * np.eye(3)[j])
    cut = TIP if tension is None else tension
    flows += [np.eye(3)[i] for i in range(3) if abs(stress[i] - cut) <= near]
    return np.array([flow / np.linalg.norm(flow) for flow in flows]).T


@FLOWS
@CUTS
def test_return_is_admissible_and_flows_as_the_planes_that_it_ends_on(dilation, tension):
    trial = trials(tension, dilation)
    stress = ends_of(trial, dilation=dilation, tension=tension)
    size = np.abs(trial).max(axis=0)
    assert np.all(np.diff(stress, axis=0) <= 1e-12 * size)
    # The width of the surface at the tip is the root of a rounding error.
    assert np.all(excess(stress, tension) <= 1e-8 * size)
    for n in range(trial.shape[1]):
        plastic = COMPLIANCE @ (trial[:, n] - stress[:, n])
        flows = flows_at(stress[:, n], tension, dilation, 1e-9 * size[n])
        _, rest = nnls(flows, plastic)
        assert rest <= 1e-8 * np.linalg.norm(plastic)
    all_places = law(dilation=dilation, tension=tension).project(np.pad(trial, ((0, 1), (0, 0))))
    places = np.unique(all_places.place)
    assert len(places) == (4 if tension is None else 9), places


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
    without = {name: None for name, no in (("dilation", associated), ("tension", natural)) if no}
    random = np.random.default_rng(5)
    size = 10 ** random.uniform(-1.5, 0.7, 400) * STRENGTH
    trial = random.normal(size=(n_stress, 400)) * size
    trial[3:] *= 0.1
    trial[:3] -= random.uniform(-1.5, 2, 400) * size
    if not natural:
        trial[:, :100] *= 1e-3
        dilation = None if associated else ROCK["dilation"]
        trial[:3, :100] += beyond_the_corner(ROCK["tension"], dilation, random)
    step = law(n_stress, **without).project(trial)
    at, scale = step.yielded, np.abs(trial).max(axis=0)
    assert len(np.unique(step.place)) == (4 if natural else 9)

    def stress(trial, **changes):
        return law(n_stress, **changes, **without).project(trial).stress[:, at]

    for k in range(n_stress):
        h = 1e-6 * scale * np.eye(n_stress)[k][:, None]
        numeric = (stress(trial + h) - stress(trial - h)) / (2e-6 * scale[at])
        np.testing.assert_allclose(step.reduction[:, :, k].T, numeric, atol=2e-7)
    exact, _ = step.derivatives(np.zeros((n_stress, len(at), len(NAMES))), of_law=True)
    for k, name in enumerate(NAMES):
        if name in without:
            continue
        h = 1e-6 * ROCK[name]
        more, less = (stress(trial, **{name: ROCK[name] + side * h}) for side in (1, -1))
        numeric = (more - less) / 2e-6 / scale[at]
        np.testing.assert_allclose(exact[:, :, k] * ROCK[name] / scale[at], numeric, atol=2e-7)


def test_derivatives_keep_their_digits_near_the_tip():
    """Against differences of the edge's equations in 50 digits, where y is 1e-9."""
    start = np.array([1215818.14121296, 850865.10167428, 624477.34709581])
    step = law(dilation=None, tension=None).project(np.array([[*start, 0.0]]).T)
    exact, _ = step.derivatives(np.zeros((4, 1, len(NAMES))), of_law=True)

    with localcontext() as context:
        context.prec = 50
        modulus, nu, sigci, mb, a = (Decimal(x) for x in (E, NU, SIGCI, MB, A))
        lame = modulus * nu / ((1 + nu) * (1 - 2 * nu))
        shear = modulus / (2 * (1 + nu))
        first, second, third = (Decimal(x) for x in start)

        def ends(s: Decimal) -> tuple[Decimal, Decimal]:
            """sigma_1 = sigma_2 and sigma_3, by the secant method for ln y."""

            def rest(log: Decimal) -> Decimal:
                y, z = log.exp(), (log * (1 - a)).exp()
                largest, volume = (s - y) * sigci / mb, lame * mb * a
                lam = ((first + second) / 2 - largest) / (volume + shear * (z + mb * a))
                return third - (volume - 2 * shear * z) * lam - largest + sigci * (a * log).exp()

            one, two = Decimal("1.08e-9").ln(), Decimal("1.09e-9").ln()
            while abs(two - one) > Decimal("1e-40"):
                one, two = two, two - rest(two) * (two - one) / (rest(two) - rest(one))
            y = two.exp()
            largest = (s - y) * sigci / mb
            return largest, largest - sigci * (a * two).exp()

        h = Decimal("1e-20")
        more, less = ends(Decimal(S) + h), ends(Decimal(S) - h)
        by_s = [float((one - other) / (2 * h)) for one, other in zip(more, less, strict=True)]
    k = NAMES.index("s")
    np.testing.assert_allclose(exact[[0, 1, 2], 0, k], [by_s[0], by_s[0], by_s[1]], rtol=1e-12)


@FLOWS
@CUTS
def test_multipliers_are_the_plastic_strains_of_surface_and_cut_off(dilation, tension):
    """sigma_1 opens by g of the pairs and by the cut-off, sigma_3 shortens by d of the pairs."""
    trial = np.pad(trials(tension, dilation), ((0, 1), (0, 0)))
    step = law(dilation=dilation, tension=tension).project(trial)
    assert step.yielded.size == trial.shape[1]
    stress = step.stress[:3]
    plastic = COMPLIANCE @ (trial[:3] - stress)
    np.testing.assert_allclose(
        step.reserve, 0.5 * ((trial[:3] - stress) * plastic).sum(axis=0), rtol=1e-9
    )
    for n in range(0, trial.shape[1], 7):
        if stress[0, n] >= TIP * (1.0 - 1e-9):
            continue
        up, down = flow_of_pair(stress[0, n], dilation)
        pairs = step.multipliers[n, 0]
        cut = step.multipliers[n, 1] if tension is not None else 0.0
        volume = (up - down) * pairs + cut
        assert plastic[:, n].sum() == pytest.approx(volume, rel=1e-6, abs=1e-9 * pairs)
        within = 1e-8 * np.abs(trial[:, n]).max()
        assert stress[0, n] - stress[2, n] >= width(stress[0, n]) - within or pairs == 0.0


@FLOWS
def test_reached_without_flow_is_biactive(dilation):
    """At the corner of surface and cut-off: flow of the cut-off alone, of pairs alone, of both."""
    cut = ROCK["tension"]
    up, down = flow_of_pair(cut, dilation)
    corner = cut - np.array([0.0, 0.4, 1.0]) * width(cut)
    plastic = 1e-4 * np.array([[1.0, 0.0, 0.0], [up, 0.0, -down], [1.0 + up, 0.0, -down]]).T
    trial = np.pad(corner[:, None] + np.linalg.solve(COMPLIANCE, plastic), ((0, 1), (0, 0)))
    step = law(dilation=dilation).project(trial)
    np.testing.assert_allclose(step.stress[:3], corner[:, None] + 0.0 * plastic, atol=1e-6)
    assert step.biactive.tolist() == [[True, False], [False, True], [False, False]]


@pytest.mark.parametrize("s", [4e-3, 0.0])
def test_excess_is_the_strength_that_a_stress_lacks(s):
    surface = law(6, s=s, dilation=None, tension=None)
    random = np.random.default_rng(2)
    stress = np.zeros((6, 50))
    stress[0] = -random.uniform(0.01, 5, 50) * 1e6
    for needed in (0.5 * SIGCI, 2.0 * SIGCI):
        y = s - MB * stress[0] / needed
        stress[2] = stress[0] - needed * y**A
        stress[1] = 0.5 * (stress[0] + stress[2])
        np.testing.assert_allclose(surface.excess(stress)[0], needed - SIGCI, rtol=1e-9)
    within = surface.excess(np.zeros((6, 1)))[0]
    assert within < 0.0


def test_a_tension_beyond_the_tip_changes_nothing():
    trial = trials(None, None)
    for dilation in (None, 0.2):
        plain = ends_of(trial, dilation=dilation, tension=None)
        cut = ends_of(trial, dilation=dilation, tension=1.5 * TIP)
        np.testing.assert_array_equal(plain, cut)

"""The identifiers on the staged finite element model: same optimum, cost in counts, coverage."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from support.cases import displacement, material, model, rollers
from support.meshes import box, regroup

from geoident.identify.assessment.uncertainty import assess
from geoident.identify.problem.methods import identify
from geoident.identify.problem.problem import Problem
from geoident.model.actions import Pressure
from geoident.model.case import Material, Stage, Support
from geoident.model.ground import Isotropic
from geoident.model.in_situ import ConstantStress, HeimStress
from geoident.model.methods import CondensationOptions, GaussNewtonOptions, SimplexOptions
from geoident.model.parameter import Parameter, Scalar
from geoident.model.results.findings import sentences_of

ZERO = Scalar(0.0)
SIDES = (*rollers(2), Support("x1", (0,)))


def _silent(_):
    return None


def _opening(parameters, rock, in_situ, *, kind="quad8", n=8):
    """An opening in a square of 8 m made in three stages, with gauges around."""
    mesh = regroup(
        box(kind, (n, n), size=(8.0, 8.0)),
        **{
            f"b{k}": (lambda c, k=k: (abs(c[:, 0] - 4) < 1) & (c[:, 1] > 2 + k) & (c[:, 1] < 3 + k))
            for k in range(3)
        },
    )
    points = [(2.5, 3.5), (5.5, 3.5), (2.5, 5.5), (5.5, 4.5), (4.0, 6.0), (1.5, 6.5), (6.5, 2.0)]
    channels = tuple(
        displacement(f"c{k}{axis}", point, direction)
        for k, point in enumerate(points)
        for axis, direction in (("x", (1.0, 0.0)), ("y", (0.0, 1.0)))
    )
    return model(
        mesh,
        parameters=parameters,
        materials={"rock": rock},
        groups=dict.fromkeys(("rock", "b0", "b1", "b2"), "rock"),
        supports=(*rollers(2), Support("x1", (0,))),
        in_situ=in_situ,
        stages=tuple(Stage(f"s{k}", excavate=(f"b{2 - k}",)) for k in range(3)),
        channels=channels,
    )


def _pairs(staged):
    return [(c.name, s.name) for s in staged.case.stages for c in staged.case.channels]


BULK = (
    Parameter("K", 4e9, 0.5e9, 50e9, "log"),
    Parameter("G", 4e9, 0.5e9, 50e9, "log"),
    Parameter("xx", -5e6, -30e6, -0.1e6),
)
BULK_TRUTH = np.array([6.4e9, 2.7e9, -8.1e6])


def _bulk(kind):
    """K, G and the horizontal stress unknown; the vertical stress is known."""
    rock = Material("rock", Isotropic(K=Scalar(1.0, "K"), G=Scalar(1.0, "G")))
    stress = ConstantStress((Scalar(1.0, "xx"), Scalar(-6e6), Scalar(-6e6), ZERO, ZERO, ZERO))
    return _opening(BULK, rock, stress, kind=kind)


@pytest.fixture(scope="module")
def bulk():
    return _bulk("quad8")


def _problem(staged, truth, parameters, *, sd=1e-5, noise=None):
    response = staged.response(_pairs(staged))
    measured = response.readings(truth)
    if noise is not None:
        measured = measured + noise.normal(0.0, sd, len(measured))
    return Problem(response, measured, np.full(len(measured), sd), parameters)


def test_gauss_newton_finds_the_truth_of_exact_readings(bulk):
    outcome = identify(_problem(bulk, BULK_TRUTH, BULK), [GaussNewtonOptions()], _silent)
    assert outcome.status == "converged"
    np.testing.assert_allclose(outcome.values, BULK_TRUTH, rtol=1e-8)


@pytest.mark.parametrize("weighting", ["output", "equation"])
def test_condensation_finds_the_same_optimum(bulk, weighting):
    options = CondensationOptions(weighting=weighting, tolerance=1e-10)
    outcome = identify(_problem(bulk, BULK_TRUTH, BULK), [options], _silent)
    assert outcome.status == "converged"
    np.testing.assert_allclose(outcome.values, BULK_TRUTH, rtol=1e-6)


@pytest.mark.slow  # of functions: tests/identify/direct/test_simplex.py
def test_simplex_finds_the_same_optimum(bulk):
    options = SimplexOptions(delta=1e-8)
    outcome = identify(_problem(bulk, BULK_TRUTH, BULK), [options], _silent)
    np.testing.assert_allclose(outcome.values, BULK_TRUTH, rtol=1e-4)


def test_condensation_converges_from_far_above_and_below_as_in_figure_6(bulk):
    """One modulus: after the first iteration it is at the truth, from wherever it starts."""
    for start in (0.2, 5.0):
        parameters = tuple(
            Parameter(p.name, v * (start if p.name == "K" else 1.0), p.lower, p.upper, p.scale)
            for p, v in zip(BULK, BULK_TRUTH, strict=True)
        )
        outcome = identify(_problem(bulk, BULK_TRUTH, parameters), [CondensationOptions()], _silent)
        path = np.array([i.values for i in outcome.iterations])
        errors = np.abs(path / BULK_TRUTH - 1).max(axis=1)
        assert errors[-1] < 1e-6
        assert len(errors) <= 16
        settled = errors[np.argmax(errors < 0.5) :]
        assert np.all(settled[1:] <= np.maximum(settled[:-1], 1e-8))


def test_a_chain_starts_each_method_where_the_one_before_ended(bulk):
    chain = [CondensationOptions(max_iterations=3), GaussNewtonOptions()]
    noisy = _problem(bulk, BULK_TRUTH, BULK, noise=np.random.default_rng(3))
    together = identify(noisy, chain, _silent)
    alone = identify(noisy, [GaussNewtonOptions()], _silent)
    np.testing.assert_allclose(together.values, alone.values, rtol=1e-5)
    assert {i.method for i in together.iterations} == {"condensation", "gauss-newton"}


# Cost ---------------------------------------------------------------------------------------------


def _ten_moduli():
    """Ten blocks of ground of different stiffness under an excavation and two surface loads."""
    names = tuple(f"E{k}" for k in range(10))
    truth = 5e9 * np.array([1.0, 1.6, 0.5, 2.2, 0.8, 1.3, 0.4, 2.0, 0.7, 1.1])

    def block(k):
        column, row = k % 2, k // 2
        return lambda c: (
            (c[:, 0] > 4 * column)
            & (c[:, 0] < 4 * column + 4)
            & (c[:, 1] > 1.6 * row)
            & (c[:, 1] < 1.6 * row + 1.6)
        )

    def opening(c):
        return (abs(c[:, 0] - 4) < 0.8) & (c[:, 1] > 3.2) & (c[:, 1] < 4.8)

    groups = {f"g{k}": block(k) for k in range(10)}
    mesh = regroup(box("quad8", (10, 10), size=(8.0, 8.0)), opening=opening, **groups)
    grid = [(x, y) for x in (0.8, 2.4, 5.6, 7.2) for y in (0.8, 1.6, 3.2, 4.8, 5.6, 7.2, 8.0)]
    staged = model(
        mesh,
        parameters=tuple(Parameter(n, 5e9 * 1.5, 5e8, 5e10, "log") for n in names),
        materials={
            "core": material("core", 4e9, 0.25),
            **{n: material(n, Scalar(1.0, n), 0.25) for n in names},
        },
        groups={"opening": "core", **{f"g{k}": f"E{k}" for k in range(10)}},
        supports=SIDES,
        in_situ=ConstantStress((Scalar(-7e6), Scalar(-6e6), Scalar(-6e6), ZERO, ZERO, ZERO)),
        stages=(
            Stage("open", excavate=("opening",)),
            Stage("load", loads={"q": Pressure("y1", Scalar(3e6))}),
        ),
        channels=tuple(
            displacement(f"c{n}{a}", p, d)
            for n, p in enumerate(grid)
            for a, d in (("x", (1.0, 0.0)), ("y", (0.0, 1.0)))
        ),
    )
    return staged, truth


def test_ten_moduli_are_found_at_once():
    staged, truth = _ten_moduli()
    problem = _problem(staged, truth, staged.case.parameters)
    outcome = identify(problem, [GaussNewtonOptions()], _silent)
    np.testing.assert_allclose(outcome.values, truth, rtol=1e-8)


# Statistics ---------------------------------------------------------------------------------------


@pytest.mark.slow
def test_intervals_cover_the_truth_in_95_of_100_noisy_replicates(bulk, verification):
    replicates, hits = 200, np.zeros(len(BULK_TRUTH))
    exact = _problem(bulk, BULK_TRUTH, BULK, sd=5e-5)
    rng = np.random.default_rng(11)
    for _ in range(replicates):
        noisy = exact.measured + rng.normal(0.0, exact.sd)
        problem = Problem(exact.response, noisy, exact.sd, BULK)
        outcome = identify(problem, [GaussNewtonOptions()], _silent)
        _, jacobian = exact.response.evaluate(outcome.values)
        known = assess(problem, outcome.values, jacobian)
        hits += (known.lower95 <= BULK_TRUTH) & (known.upper95 >= BULK_TRUTH)
    # Binomial: 95 % of 200 with a standard deviation of 1.5 %; three of them on either side.
    share = hits / replicates
    assert np.all(np.abs(share - 0.95) < 3 * np.sqrt(0.95 * 0.05 / replicates)), share
    names = [parameter.name for parameter in BULK]
    verification("coverage", "", names, exact=0.95, found=share)


def test_young_modulus_and_stress_scale_together_is_said():
    """Displacements depend on E and the stress level by their ratio alone."""
    parameters = (
        Parameter("E", 10e9, 1e9, 100e9, "log"),
        Parameter("sv", 6e6, 1e6, 40e6, "log"),
        Parameter("K0", 1.0, 0.2, 4.0),
    )
    staged = _opening(
        parameters,
        material("rock", Scalar(1.0, "E"), 0.25),
        HeimStress(K0=Scalar(1.0, "K0"), vertical=Scalar(1.0, "sv")),
    )
    truth = np.array([14e9, 7e6, 1.4])
    problem = _problem(staged, truth, parameters, sd=1e-5, noise=np.random.default_rng(5))
    outcome = identify(problem, [GaussNewtonOptions()], _silent)
    _, jacobian = problem.response.evaluate(outcome.values)
    known = assess(problem, outcome.values, jacobian)
    assert list(known.determined) == [False, False, True]
    assert np.isnan(known.sd[0])
    assert np.isnan(known.sd[1])
    (finding,) = [f for f in sentences_of(known.findings) if "E" in f and "sv" in f]
    assert "ratio" in finding or "/" in finding
    assert outcome.values[1] / outcome.values[0] == pytest.approx(7e6 / 14e9, rel=0.02)


def test_equations_of_ground_that_never_yields_answer_with_the_readings_of_the_march():
    """The system has no complementary pairs, and its equations determine all unknowns."""
    staged = _bulk("quad4")
    response = staged.response(_pairs(staged))
    system = response.system()
    assert system.n_pairs == 0
    rest, operator = system.equations.at(BULK_TRUTH)
    x = spsolve(operator.tocsc(), -rest)
    added, read = system.readings.at(BULK_TRUTH)
    np.testing.assert_allclose(
        added + read @ x, response.readings(BULK_TRUTH), rtol=1e-8, atol=1e-12
    )

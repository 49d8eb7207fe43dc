"""The reduced model: exact where it was made, elsewhere off by what it estimates."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from support.cases import displacement
from support.reduced import (
    PAIRS_GAUGED,
    PAIRS_PLANE,
    PAIRS_SINKING,
    PAIRS_SOLID,
    braced,
    gauged,
    plane,
    released,
    settling,
    sinking,
    solid,
    spread,
    strata,
)

from geoident.fem.solvers import pick_solver
from geoident.forward.model import staged_model
from geoident.forward.reduced.kept import RestoredModel, kept_model
from geoident.forward.reduced.projection import DEPENDENT
from geoident.model.actions import PointForce
from geoident.model.case import Stage
from geoident.model.in_situ import HeimStress
from geoident.model.parameter import Parameter, Scalar
from geoident.model.structures import Bolts

CASES = {
    "plane": (plane, PAIRS_PLANE),
    "solid": (solid, PAIRS_SOLID),
    "strata": (strata, PAIRS_PLANE),
    "settling": (settling, PAIRS_PLANE),
    "released": (released, PAIRS_PLANE),
    "braced": (braced, PAIRS_PLANE),
    "sinking": (sinking, PAIRS_SINKING),
    "gauged": (gauged, PAIRS_GAUGED),
}


@cache
def made(name: str):
    """A model, its response, and its reduced model around the start."""
    build, pairs = CASES[name]
    staged = build()
    response = staged.response(pairs)
    start = np.array([q.start for q in staged.case.parameters])
    training = spread(staged, 30, seed=4, part=0.6)
    return staged, response, response.surrogate_around(start, training, most=4)


@pytest.mark.parametrize("name", CASES)
def test_readings_and_derivatives_are_exact_at_every_analysis_it_was_made_of(name):
    """Up to rounding, which the basis magnifies.

    It keeps directions of which no more than DEPENDENT is new, so the rounding of a column counts
    1 / DEPENDENT times in them. Derivatives, each relative to its own size, lose a digit more.
    """
    staged, response, reduced = made(name)
    rounding = np.finfo(np.float64).eps / DEPENDENT
    for p in response.visited():
        v, J = staged.response(CASES[name][1]).by_tangents(p)
        w, K = reduced.evaluate(p)
        np.testing.assert_allclose(w, v, rtol=0.0, atol=rounding * np.abs(v).max())
        scale = np.abs(J).max(axis=0)
        np.testing.assert_allclose(K / scale, J / scale, rtol=0.0, atol=10.0 * rounding)
        assert reduced.error(p) < rounding


@pytest.mark.parametrize(
    ("name", "count"),
    [
        *((name, 25) for name in CASES if name != "braced"),
        *(pytest.param(name, 1000, marks=pytest.mark.slow) for name in CASES),
    ],
)
def test_readings_are_off_by_what_is_estimated_or_less(name, count):
    """All over the bounds, up to a hundredfold ratio of moduli; one in a hundred may miss."""
    staged, response, reduced = made(name)
    values = spread(staged, count, seed=1)
    found, estimated = reduced.estimated(values)
    error = np.abs(np.array([response.readings(p) for p in values]) - found)
    assert np.mean(error > estimated) <= 0.01
    assert np.all(error <= 5.0 * estimated)
    assert np.median(estimated / np.maximum(error, 1e-300)) < 1e4


def test_the_error_of_the_stresses_is_that_of_the_work_of_a_load():
    """One load on ground without stress: F (u - u_r) is the square of the error in energy.

    Both are by themselves: the error of the stresses is estimated by Prager and Synge's theorem,
    from above; the displacement of the load is read by a gauge.
    """
    at = (4.0, 12.0)
    stages = (Stage("test", loads={"jack": PointForce(at, (Scalar(0.0), Scalar(-1e6)))}),)
    gauge = displacement("jack", at, (0.0, -1.0))
    staged = plane(
        in_situ=None, stages=stages, channels=(gauge,), parameters=plane().case.parameters[:3],
        groups={"rock": "rock", "heading": "shotcrete", "bench": "shotcrete", "lining": "rock"},
    )  # fmt: skip
    response = staged.response([("jack", "test")])
    response.record(economical=False)
    start = np.array([q.start for q in staged.case.parameters])
    response.evaluate(start)
    reduced = response.surrogate(response.visited())
    for p in spread(staged, 12, seed=2):
        (u,), (u_r,) = response.readings(p), reduced.readings(p)
        exact = np.sqrt(max((u - u_r) / u_r, 0.0))
        assert exact - 1e-7 <= reduced.error(p) <= 30.0 * exact + 1e-7


def test_derivatives_are_those_of_its_readings():
    staged, _, reduced = made("strata")
    p = spread(staged, 1, seed=6)[0]
    _, J = reduced.evaluate(p)
    for h, step in enumerate(1e-6 * np.abs(p)):
        ahead, behind = p.copy(), p.copy()
        ahead[h] += step
        behind[h] -= step
        slope = (reduced.readings(ahead) - reduced.readings(behind)) / (2 * step)
        np.testing.assert_allclose(J[:, h], slope, rtol=1e-4, atol=1e-5 * np.abs(J[:, h]).max())


def test_one_march_is_right_to_second_order_in_the_moduli():
    """At twice the step the error is eight times as large; by first derivatives, four times."""
    staged = plane()
    response = staged.response(PAIRS_PLANE)
    response.record(economical=False)
    p = np.array([q.start for q in staged.case.parameters])
    response.evaluate(p)
    reduced = response.surrogate(response.visited())
    errors = []
    for step in (0.1, 0.2):
        q = p * np.exp(np.array([step, -step, 0.0, step, -step]))
        errors.append(np.abs(reduced.readings(q) - response.readings(q)).max())
    assert errors[1] / errors[0] > 6.0


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"stages": (Stage("heading", excavate=("heading",)), Stage("lined"), Stage("test"),
                     Stage("bench", excavate=("bench",), release={"bench": Scalar(0.4)}))},
         "'bench' releases in part the stress of ground that other stages"),
        ({"stages": (Stage("heading", excavate=("heading",), temperature={"rock": Scalar(9.0)}),
                     Stage("lined"), Stage("test"), Stage("bench"))},
         "the stage 'heading' changes temperatures"),
        ({"structures": {"nails": Bolts((((6.0, 2.0), (9.0, 2.0)),), Scalar(1.0), EA=Scalar(1e8))},
          "stages": (Stage("heading", build=("nails",), prestress={"nails": Scalar(1e5)}),
                     Stage("lined", prestress={"nails": Scalar(2e5)}), Stage("test"),
                     Stage("bench"))},
         "the bars of 'nails' are stressed more than once"),
        ({"parameters": ()}, "nothing is sought"),
    ],
)  # fmt: skip
def test_what_is_not_covered_says_why(changes, why):
    parameters = plane().case.parameters
    fixed = {}
    if not changes.get("parameters", parameters):
        fixed = {
            "materials": {
                name: replace(m, elastic=replace(m.elastic, E=Scalar(8e9), nu=Scalar(0.2)))
                for name, m in plane().case.materials.items()
            },
            "in_situ": HeimStress(vertical=Scalar(5e6), K0=Scalar(1.0)),
        }
    response = plane(**{**fixed, **changes}).response([("side", "heading")])
    response.record()
    assert why in response.surrogate_obstacle()
    assert response.surrogate(response.visited()) is None


def test_loads_that_are_no_polynomials_are_refused_and_the_full_model_answers():
    """An azimuth of the horizontal stress: cosines."""
    azimuth = Parameter("azimuth", 0.5, 0.0, 1.5)
    staged = solid(
        parameters=(*solid().case.parameters, azimuth),
        in_situ=HeimStress(
            vertical=Scalar(1.0, "sv"),
            K0=Scalar(1.0, "K0"),
            K0_across=Scalar(0.5, "K0"),
            azimuth=Scalar(1.0, "azimuth"),
        ),
    )
    response = staged.response(PAIRS_SOLID)
    response.record(economical=False)
    response.evaluate(np.array([q.start for q in staged.case.parameters]))
    assert response.surrogate(response.visited()) is None
    why = "its loads are no polynomials of low degree in the parameters"
    assert response.surrogate_obstacle() == why


def test_a_group_without_elements_is_no_part_of_it():
    """A mesh may name groups that nothing is of."""
    whole = plane()
    mesh = whole.on_mesh.mesh
    mesh = replace(mesh, groups={**mesh.groups, "nothing": np.zeros(0, np.int64)})
    case = replace(whole.case, groups={**whole.case.groups, "nothing": "young"})
    staged = staged_model(mesh, case, solver=pick_solver("auto"))
    response = staged.response(PAIRS_PLANE)
    response.record(economical=False)
    start = np.array([q.start for q in case.parameters])
    readings = response.evaluate(start)[0]
    found = response.surrogate(response.visited())
    np.testing.assert_allclose(found.readings(start), readings, atol=1e-9 * np.abs(readings).max())


def test_a_mesh_too_small_for_it_has_none():
    staged = plane(n=4)
    response = staged.response([("side", "heading")])
    response.record()
    response.evaluate(np.array([q.start for q in staged.case.parameters]))
    assert response.surrogate(response.visited()) is None
    why = "for a mesh of this size it costs more than the analyses that it saves"
    assert response.surrogate_obstacle() == why


def test_what_does_not_fit_into_the_memory_is_said(monkeypatch):
    monkeypatch.setattr("geoident.forward.reduced.reduction.MOST_ENTRIES", 1000)
    response = plane().response(PAIRS_PLANE)
    response.record(economical=False)
    response.evaluate(np.array([q.start for q in plane().case.parameters]))
    assert response.surrogate(response.visited()) is None
    why = "what an analysis leaves for it does not fit into the memory"
    assert response.surrogate_obstacle() == why


@pytest.mark.parametrize("name", ["plane", "braced", "gauged"])
def test_a_model_that_is_kept_answers_as_the_one_it_was(name):
    """Readings, derivatives and errors of all and of some readings, without the mesh."""
    staged, response, reduced = made(name)
    pairs, case, visited = CASES[name][1], staged.case, response.visited()
    kept = kept_model(reduced, staged, visited)
    again = RestoredModel(kept, case)
    assert again.pairs == tuple(pairs)
    some = [5, 0, 3]
    answers = again.response(pairs), again.response([pairs[k] for k in some])
    values = spread(staged, 2, seed=9, part=0.3)
    v, J = reduced.evaluate(values[0])
    table, estimated = reduced.estimated(values)
    for answer, which in zip(answers, (slice(None), some), strict=True):
        own_v, own_J = answer.evaluate(values[0])
        np.testing.assert_allclose(own_v, v[which], rtol=1e-12)
        np.testing.assert_allclose(own_J, J[which], rtol=1e-10, atol=1e-12 * np.abs(J).max())
        own_table, own_estimates = answer.estimated(values)
        np.testing.assert_allclose(own_table, table[:, which], rtol=1e-12)
        np.testing.assert_allclose(own_estimates, estimated[:, which], rtol=1e-9)
        np.testing.assert_allclose(answer.increments(values[1]), reduced.increments(values[1]),
                                   rtol=1e-12)  # fmt: skip
        assert answer.error(values[0]) == pytest.approx(reduced.error(values[0]), rel=1e-9)
        assert answer.admissible(kept.upper * 1.1) is not None

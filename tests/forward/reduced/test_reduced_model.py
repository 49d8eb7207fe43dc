"""The reduced model: exact where it was made, and never further off than it says."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from support.reduced import (
    PAIRS_GAUGED,
    PAIRS_PLANE,
    PAIRS_SINKING,
    PAIRS_SOLID,
    braced,
    errors_and_bounds,
    gauged,
    plane,
    reduced_stresses,
    released,
    settling,
    sinking,
    solid,
    spread,
    strata,
)

from geoident.fem.solvers import pick_solver
from geoident.forward.march.march import RunOptions
from geoident.forward.model import staged_model
from geoident.forward.reduced.kept import RestoredModel, kept_model
from geoident.forward.reduced.moduli import relative_eigenvalues, span_of
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


QUICK = tuple(name for name in CASES if name != "braced")
"""All that is braced is gauged too."""
MOST = [*QUICK, pytest.param("braced", marks=pytest.mark.slow)]


@cache
def made(name: str, marches: int = 3):
    """A model, its response, its reduced model of so many marches, and where they were."""
    build, pairs = CASES[name]
    staged = build()
    response = staged.response(pairs)
    response.record(economical=False)
    start = np.array([q.start for q in staged.case.parameters])
    points = [*spread(staged, marches - 1, seed=4, part=0.6), start]
    for p in points:
        response.evaluate(p)
    return (
        staged,
        response,
        response.bounded_surrogate(response.visited(), response.visited()[-1]),
        points,
    )


@pytest.mark.parametrize("name", MOST)
def test_readings_and_derivatives_are_exact_at_every_march_it_was_made_of(name):
    staged, _, reduced, points = made(name)
    for p in points:
        v, J = staged.response(CASES[name][1]).by_tangents(p)
        w, K = reduced.evaluate(p)
        pointwise = name == "gauged"  # stresses at a point are known less sharply
        np.testing.assert_allclose(w, v, atol=(1e-7 if pointwise else 1e-8) * np.abs(v).max())
        scale = np.abs(J).max(axis=0)
        np.testing.assert_allclose(K / scale, J / scale, atol=1e-5 if pointwise else 1e-6)
        assert reduced.error(p) < 1e-6


@pytest.mark.parametrize(
    ("name", "count"),
    [
        *((name, 25) for name in QUICK),
        *(pytest.param(name, 1000, marks=pytest.mark.slow) for name in CASES),
    ],
)
def test_no_reading_is_further_off_than_its_bound(name, count):
    """All over the bounds, up to a hundredfold ratio of moduli."""
    staged, response, reduced, _ = made(name)
    values = spread(staged, count, seed=1)
    error, bound = errors_and_bounds(reduced, response, values)
    assert np.all(error <= bound)
    assert np.median(bound / np.maximum(error, 1e-300)) < 100


IN_OTHERS = ("plane", "braced")  # all their terms are among those of `gauged`


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] * (name in IN_OTHERS)) for name in CASES],
)
def test_adjoints_at_the_place_itself_give_the_error_of_every_reading(name):
    """Where the reference is no march, nothing is left to be bounded: each term must be right."""
    # its own, since the projection is made anew; one march will do, but for what a part releases
    staged, response, _, _ = made.__wrapped__(name, 3 if name == "released" else 1)
    p = spread(staged, 1, seed=1)[0]
    reduced = response.bounded_surrogate(response.visited(), p)
    states = reduced.model.states(p[None], derivatives=False)
    bounds = reduced.duals.bounds(states, reduced.model.bounds(states))
    readings = response.readings(p)
    error = readings - reduced.readings(p)
    basis = reduced.duals.bases[0]
    spans = reduced.model.form.spans
    moduli = {name: span.matrix(states.at.moduli[name]) for name, span in spans.items()}
    measures = basis.measures(moduli, basis.only(np.ones(1)))
    whole = basis.measures(moduli, basis.only(np.zeros(1)))  # the stresses alone
    for stage in basis.stages:
        left = basis.unbalanced(stage, measures, 1)
        assert np.all(left <= 1e-24 * basis.unbalanced(stage, whole, 1))
    small = 1e-10 * np.abs(readings).max()  # rounding; a term that lacks is 1e-7 and more
    np.testing.assert_allclose(bounds.correction[0], error, rtol=0, atol=small)


@pytest.mark.parametrize("name", ["plane", "strata", "gauged", "sinking"])
def test_derivatives_of_adjoints_leave_an_error_of_second_order(name):
    """At twice the distance they leave four times as much out of balance; adjoints alone, twice."""
    _, _, reduced, _ = made(name)
    basis, model = reduced.duals.bases[0], reduced.model
    assert basis.size > 1
    grown = []
    for step in (0.01, 0.02):
        p = model.reference * np.exp(step * np.cos(np.arange(len(model.reference))))
        states = model.states(p[None], derivatives=False)
        moduli = {m: span.matrix(states.at.moduli[m]) for m, span in model.form.spans.items()}
        weights = np.ones((1, len(basis.stages)))
        alone = basis.only(np.ones(1))
        for some in (alone, basis.best(moduli, weights)):
            measures = basis.measures(moduli, some)
            squared = [basis.unbalanced(stage, measures, 1) for stage in basis.stages]
            grown.append(np.sqrt(np.sum(squared)))
    assert grown[2] / grown[0] == pytest.approx(2.0, abs=0.1)
    assert grown[3] / grown[1] == pytest.approx(4.0, abs=0.5)


@pytest.mark.parametrize("name", MOST)
def test_the_error_of_the_stresses_is_below_its_bound(name):
    """In complementary energy, where the stress of the march is at hand."""
    staged, response, reduced, _ = made(name)
    points, model = response.reduction.projection.affine.points, reduced.model
    for p in spread(staged, 5, seed=2):
        states = model.states(p[None])
        bounds = model.bounds(states)
        run = staged.at(p, RunOptions(derivatives=False))
        for end in run.states():
            number, squared, whole = end.state, 0.0, 0.0
            at_end = points.joined(end.stress, end.members)
            for zone, stress in reduced_stresses(response.reduction, model, states, number):
                mine = zone.points
                span = model.form.spans[zone.material]
                E = span.matrix(span.coordinates(p[None])[0][0])
                gap = at_end[:, mine, 0] - stress
                squared += np.sum(points.volume[mine] * gap * np.linalg.solve(E, gap))
                moved = at_end[:, mine, 0]
                whole += np.sum(points.volume[mine] * moved * np.linalg.solve(E, moved))
            bound = bounds.stress[number, 0]
            assert np.sqrt(squared) <= bound + 1e-9 * np.sqrt(whole)


def test_a_bound_of_a_few_percent_is_not_far_above_the_error_in_energy():
    """Prager and Synge: the reduced stress and the best equilibrated one lie on both sides."""
    staged, _, reduced, _ = made("plane")
    values = spread(staged, 30, seed=3)
    states = reduced.model.states(values)
    relative = reduced.model.bounds(states).relative
    assert np.median(relative) < 0.05


def test_many_at_once_are_as_one_by_one():
    staged, _, reduced, _ = made("plane")
    values = spread(staged, 7, seed=5)
    together, _ = reduced.many(values)
    one_by_one = np.array([reduced.readings(p) for p in values])
    np.testing.assert_allclose(together, one_by_one, rtol=1e-12, atol=1e-15)


def test_derivatives_are_those_of_its_readings():
    staged, _, reduced, _ = made("strata")
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
    found = response.bounded_surrogate(response.visited(), response.visited()[-1])
    np.testing.assert_allclose(found.readings(start), readings, atol=1e-9 * np.abs(readings).max())


def test_a_mesh_too_small_for_it_has_none():
    staged = plane(n=4)
    response = staged.response([("side", "heading")])
    response.record()
    response.evaluate(np.array([q.start for q in staged.case.parameters]))
    assert response.surrogate(response.visited()) is None
    why = "for a mesh of this size it costs more than the marches that it saves"
    assert response.surrogate_obstacle() == why


def test_moduli_of_one_material_span_few_directions_and_bound_each_other():
    for staged, expected in ((plane(), {"rock": 2, "shotcrete": 1}), (strata(), {"rock": 10})):
        names = tuple(q.name for q in staged.case.parameters)
        samples = spread(staged, 30, seed=8)
        for name, rank in expected.items():
            assert span_of(staged.case.materials[name], names, samples, 4).rank <= rank
    E = np.diag([3.0, 2.0, 1.0])
    np.testing.assert_allclose(relative_eigenvalues(2.0 * E[None], E), [[2.0, 2.0, 2.0]])


def test_what_does_not_fit_into_the_memory_is_said(monkeypatch):
    monkeypatch.setattr("geoident.forward.reduced.reduction.MOST_ENTRIES", 1000)
    response = plane().response(PAIRS_PLANE)
    response.record(economical=False)
    response.evaluate(np.array([q.start for q in plane().case.parameters]))
    assert response.surrogate(response.visited()) is None
    why = "what a march leaves for it does not fit into the memory"
    assert response.surrogate_obstacle() == why


@pytest.mark.parametrize("marches", [1.5, 2.5, 4.5])
def test_older_marches_give_way_where_the_memory_is_small(monkeypatch, marches):
    """Of a march without second derivatives, the least; with them it is up to three times that."""
    staged = plane()
    points = staged.discretization.points
    one = (4 * points.n_dofs + 5 * len(staged.case.channels)) * (1 + len(staged.names))
    monkeypatch.setattr("geoident.forward.reduced.reduction.MOST_ENTRIES", int(marches * one))
    response = staged.response(PAIRS_PLANE)
    response.record(economical=False)
    for p in spread(staged, 5, seed=4):
        response.evaluate(p)
    snapshots = list(response.reduction.snapshots.values())
    assert sum(s.entries for s in snapshots) <= marches * one
    assert np.array_equal(snapshots[-1].p, p)
    assert response.surrogate(response.visited()) is not None


@pytest.mark.parametrize("name", ["plane", "braced", "gauged"])
def test_a_model_that_is_kept_answers_as_the_one_it_was(name):
    """Readings, derivatives and bounds of all and of some readings, without the mesh."""
    staged, _, reduced, points = made(name)
    pairs, case = CASES[name][1], staged.case
    kept = kept_model(reduced, staged.observation, case, marches=points,
                      built_on=staged.sequence.built_on)  # fmt: skip
    assert kept.names == tuple(q.name for q in case.parameters)
    np.testing.assert_array_equal(kept.lower, [q.lower for q in case.parameters])
    np.testing.assert_array_equal(kept.upper, [q.upper for q in case.parameters])
    np.testing.assert_array_equal(kept.marches, points)
    again = RestoredModel(kept, case)
    assert again.pairs == tuple(pairs)
    assert again.observation.channels == tuple(c.name for c in case.channels)
    some = [5, 0, 3]
    answers = again.response(pairs), again.response([pairs[k] for k in some])
    values = spread(staged, 2, seed=9, part=0.3)
    found, bounds = reduced.certified(values)
    assert np.all(bounds > 0.0)
    for answer, mine in zip(answers, (slice(None), some), strict=True):
        v, J = reduced.evaluate(values[0])
        found_v, found_J = answer.evaluate(values[0])
        np.testing.assert_allclose(found_v, v[mine], rtol=1e-12)
        np.testing.assert_allclose(found_J, J[mine], rtol=1e-10, atol=1e-12 * np.abs(J).max())
        here, limits = answer.certified(values)
        np.testing.assert_allclose(here, found[:, mine], rtol=1e-12)
        if mine != some:  # what is rounding is seen of all readings that are asked for
            np.testing.assert_allclose(limits, bounds, rtol=1e-9)
        np.testing.assert_allclose(answer.increments(values[1]), reduced.increments(values[1]),
                                   rtol=1e-12)  # fmt: skip
        assert answer.error(values[0]) == pytest.approx(reduced.error(values[0]), rel=1e-9)
        assert answer.admissible(kept.upper * 1.1) is not None
    without = SimpleNamespace(duals=None)
    with pytest.raises(ValueError, match="without bounds of its readings is not kept"):
        kept_model(without, staged.observation, case, marches=points,
                   built_on=staged.sequence.built_on)  # fmt: skip

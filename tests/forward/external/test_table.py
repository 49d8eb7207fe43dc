"""A table of runs: surfaces of a function that they can follow exactly, and readings beyond it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import qmc
from support.cases import displacement, make_case

from geoident.forward.external.table import TableModel
from geoident.model.case import Stage
from geoident.model.external import RunTable
from geoident.model.gauges import Reading, Reads
from geoident.model.mesh import Mesh
from geoident.model.parameter import Parameter, Scalar

NOWHERE = Mesh(np.empty((0, 2)), ())
PARAMETERS = (
    Parameter("K", 1.2, 0.5, 2.5),
    Parameter("unused", 1.0, 0.5, 2.0),
    Parameter("E", 5e9, 1e9, 5e10, scale="log"),
)
P = np.array([1.7, 1.1, 4e9])
GIVEN = np.array([[1, 1, 0], [1, 1, 1], [0, 1, 1]], dtype=bool)
SIZES = 1e-3 * np.arange(1.0, 10.0).reshape(3, 3)


def formula(E, K):
    """(3, 3) polynomials of the second order in K and the logarithm of E."""
    x = np.log(E / 1e9)
    return SIZES * (1.0 + 0.3 * K * x + 0.1 * x**2) + SIZES**2 * 50.0 * K


def formula_slopes(E, K):
    """By E and by K."""
    x = np.log(E / 1e9)
    return SIZES * (0.3 * K + 0.2 * x) / E, SIZES * 0.3 * x + SIZES**2 * 50.0


def channel(name, **changes):
    return replace(displacement(name, (0.0, 0.0), (1.0, 0.0)), **changes)


CHANNELS = (
    channel("plain", reads=Reads.VALUE, accuracy=2e-3),
    channel("since"),
    channel("late", zero="b", accuracy=5e-4),
)
ENDS = np.array([[1.1e9, 4.5e10], [0.55, 2.4]])


def table_of(names=("E", "K"), count=17):
    cube = qmc.LatinHypercube(2, seed=4).random(count)
    cube = (cube - cube.min(axis=0)) / np.ptp(cube, axis=0)
    E = ENDS[0, 0] * (ENDS[0, 1] / ENDS[0, 0]) ** cube[:, 0]
    K = ENDS[1] @ [1 - cube[:, 1], cube[:, 1]]
    readings = np.array([np.where(GIVEN, formula(*p), np.nan) for p in zip(E, K, strict=True)])
    values = np.column_stack([{"E": E, "K": K}[name] for name in names])
    return RunTable("there/runs.csv", "polynomial", names, values, readings, ("one left out",))


def case_of(*readings, channels=CHANNELS):
    stages = tuple(Stage(name) for name in "abc")
    return make_case(
        NOWHERE, parameters=PARAMETERS, stages=stages, channels=channels, readings=readings
    )


@pytest.mark.parametrize("names", [("E", "K"), ("K", "E")])
def test_surfaces_give_the_function_and_its_derivatives(names):
    model = TableModel(case_of(), table_of(names))
    exact = np.where(GIVEN, formula(P[2], P[0]), np.nan)
    zero = formula(P[2], P[0])[1, 2]
    exact[1:, 2] -= zero
    by_E, by_K = formula_slopes(P[2], P[0])
    slopes = np.stack([by_K, 0.0 * by_K, by_E], axis=-1)
    slopes[1:, 2] -= slopes[1, 2].copy()
    readable = GIVEN.copy()
    readable[0, 2] = False  # before its zero
    exact[~readable], slopes[~readable] = np.nan, np.nan
    survey = model.survey(P, fields=False)
    np.testing.assert_allclose(survey.computed, exact.T, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(survey.sensitivity, slopes.swapaxes(0, 1), rtol=1e-7, atol=1e-12)
    np.testing.assert_array_equal(model.computed(P), survey.computed)
    assert model.notes == ("one left out",)


def test_accuracies_are_those_of_the_channels_and_errors_are_none():
    model = TableModel(case_of(), table_of())
    root = model.error_root(P)
    assert root.shape[:2] == (3, 3)
    assert (root[~GIVEN] == 0.0).all()
    assert np.abs(root).max() < 1e-9
    kept = model.surface_table(P)
    assert (kept.file, kept.runs) == ("runs.csv", 17)
    assert kept.channels == ("plain", "since", "plain", "since", "late", "since", "late")
    assert kept.stages == ("a", "a", "b", "b", "b", "c", "c")
    np.testing.assert_allclose(kept.own, np.linalg.norm(root, axis=2)[GIVEN], atol=1e-20)
    np.testing.assert_allclose(kept.accuracy, [2e-3, 1e-4, 2e-3, 1e-4, 5e-4, 1e-4, 5e-4])
    read = model.read
    np.testing.assert_array_equal(kept.lower, read.min(axis=0))
    np.testing.assert_array_equal(kept.upper, read.max(axis=0))
    assert (read[:, 4] == 0.0).all()  # the gauge at its zero
    assert kept.units == ("mm",) * 7
    assert max(kept.left_out) < 1e-9


@pytest.mark.parametrize(
    ("p", "why"),
    [
        (P, None),
        (np.array([2.4, 9.0, 1.1e9]), None),
        (np.array([2.4 + 1.85e-10, 1.0, 4e9]), None),
        (np.array([2.4 + 1.85e-8, 1.0, 4e9]), "K is beyond the runs of the table"),
        (np.array([0.5, 1.0, 4e9]), "K is beyond the runs of the table"),
        (np.array([0.5, 1.0, 1e9]), "E is beyond the runs of the table"),
        (np.array([np.nan, 1.0, 4e9]), "a parameter is not finite"),
    ],
)
def test_nothing_is_said_beyond_the_runs(p, why):
    model = TableModel(case_of(), table_of())
    assert model.admissible(p) == why


def outside(*readings, channels=CHANNELS):
    case = case_of(*readings, channels=channels)
    model = TableModel(case, table_of())
    _, *said = model.notes
    return said, model.read


def test_readings_beyond_all_runs_are_named():
    """Three accuracies beyond are not: 0.3 mm of the gauge `since`."""
    _, read = outside()
    low, high = read[:, 1].min(), read[:, 1].max()
    for value, told in (
        (high + 2.9e-4, False), (high + 3.1e-4, True), (low - 2.9e-4, False), (low - 3.1e-4, True)
    ):  # fmt: skip
        said, _ = outside(Reading("since", "a", value))
        exact = (
            f"readings beyond what any run of the table gave: since at a ({1e3 * value:.4g} mm; "
            f"the runs gave {1e3 * low:.4g} to {1e3 * high:.4g} mm)"
        )
        assert said == ([exact] if told else [])


def test_readings_that_say_nothing_of_the_runs_are_passed_over():
    far = Reading("since", "a", 9.0)
    assert len(outside(far)[0]) == 1
    for other in (
        replace(far, value=None), replace(far, bad="torn off"), replace(far, stage="later")
    ):  # fmt: skip
        assert outside(other)[0] == []
    for own in ({"offset": Scalar(0.1)}, {"drift": Scalar(0.1)}, {"drift_per_stage": Scalar(0.1)}):
        channels = (CHANNELS[0], replace(CHANNELS[1], **own), CHANNELS[2])
        assert outside(far, channels=channels)[0] == []
    places = [("plain", "a"), ("plain", "b"), *(("since", s) for s in "abc"), ("late", "b")]
    (said,) = outside(*(Reading(*place, 9.0) for place in places))[0]
    assert said.count("the runs gave") == 6
    assert " more" not in said
    (said,) = outside(*(Reading(*place, 9.0) for place in [*places, ("late", "c"), places[0]]))[0]
    assert said.count("the runs gave") == 6
    assert said.endswith(" and 2 more")

"""Whether a quantity is affine in the parameters is found by its derivatives at a few points."""

from __future__ import annotations

import numpy as np
import pytest

from geoident.forward.affine import EquationPart, _Slopes, first_obstacle, trial_points
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.parameter import Parameter, Scalar

H = Parameter("h", 3.0, 1.0, 9.0)
K = Parameter("k", 2e9, 1e8, 5e10, scale="log")
T = Parameter("t", 0.5, -np.inf, np.inf)


def obstacle(formula, *parameters: Parameter, explain=lambda names: None) -> str | None:
    def columns(point: ParameterPoint) -> np.ndarray:
        found: Dual = formula(*(point.number(Scalar(1.0, p.name)) for p in parameters))
        return found.columns

    return first_obstacle([EquationPart("the force", columns, explain)], parameters)


@pytest.mark.parametrize(
    "formula",
    [
        lambda h, k, t: 3.0 * h + k * 1e-9 - t,
        lambda h, k, t: h * 1e-3 + k * np.arange(5.0),
        lambda h, k, t: (h * k) / k + k,  # rounding is no obstacle
        lambda h, k, t: (k * 0.0).plus(7.0),
        lambda h, k, t: (h.plus(10.0)).positive_part(),  # the kink lies outside the bounds
    ],
)
def test_what_is_affine_is_no_obstacle(formula):
    assert obstacle(formula, H, K, T) is None


def test_nothing_free_is_no_obstacle():
    assert first_obstacle([EquationPart("the force", lambda _: np.ones((2, 1)))], ()) is None


@pytest.mark.parametrize(
    ("formula", "said"),
    [
        (lambda h, k, t: k * t, "the force contains the product of k and t, and both are free"),
        (lambda h, k, t: h + k * h, "the force contains the product of h and k, and both are free"),
        (lambda h, k, t: k + h * h, "the force is not linear in h"),
        (lambda h, k, t: h * h + t * t, "the force is not linear in h"),
        (lambda h, k, t: h + k * k * 1e-9, "the force is not linear in k"),
        (lambda h, k, t: h / k, "the force is not linear in k"),
        (lambda h, k, t: h + t.sine(), "the force is not linear in t"),
        (lambda h, k, t: k + (h.plus(-8.8)).positive_part(), "the force is not linear in h"),
        (lambda h, k, t: k + (h.plus(-1.2)).positive_part(), "the force is not linear in h"),
        (lambda h, k, t: (h * (2 * np.pi / 8.0)).sine(), "the force is not linear in h"),
    ],
)
def test_what_is_not_affine_is_named(formula, said):
    assert obstacle(formula, H, K, T) == said


def test_two_levels_that_cross_are_found():
    """Parameters do not move together: a kink where they are equal is met."""
    levels = [Parameter(name, 5.0, 0.0, 10.0) for name in "ab"]
    found = obstacle(lambda a, b: (a - b).positive_part(), *levels)
    assert found is not None
    assert found.startswith("the force is ")


def test_the_quantity_explains_what_is_not_linear():
    seen = []

    def explain(names):
        seen.append(list(names))
        return "h turns the planes"

    assert obstacle(lambda h, k: h * h + k, H, K, explain=explain) == "h turns the planes"
    assert seen == [["h"]]


def test_trial_points_are_admissible_and_inside_the_bounds():
    points = trial_points((H, K, T), lambda values: values["h"] < 4.0)
    assert len(points) == 3
    for point in points:
        assert 1.0 < point.values["h"] < 4.0
        assert 1e8 < point.values["k"] < 5e10
        assert 0.0 < point.values["t"] < 1.0
    assert len({point.values["h"] for point in points}) == 3


def test_each_parameter_is_once_low_once_between_and_once_high_in_an_order_of_its_own():
    names = "abcdef"
    points = trial_points([Parameter(name, 0.5, 0.0, 1.0) for name in names], lambda _: True)
    found = np.array([[point.values[name] for name in names] for point in points])
    places = np.array([0.013, 0.518, 0.987])
    assert np.sort(found, axis=0) == pytest.approx(np.tile(places[:, None], 6), abs=0.005)
    orders = {tuple(np.argsort(column)) for column in found.T}
    assert len(orders) == 6
    # the thousandths are those of the multiples of the golden ratio
    golden = np.add.outer(7 * np.arange(3), 1 + np.arange(6)) * (np.sqrt(5.0) - 1.0) / 2.0 % 1.0
    nearest = places[np.abs(found[..., None] - places).argmin(axis=-1)]
    assert found - nearest == pytest.approx(0.01 * (golden - 0.5), abs=1e-12)


@pytest.mark.parametrize(
    ("start", "lower", "upper", "low", "high"),
    [
        (4.0, -np.inf, np.inf, 2.0, 6.0),
        (-4.0, -np.inf, np.inf, -6.0, -2.0),
        (0.0, -np.inf, np.inf, -0.5, 0.5),
        (4.0, 3.0, np.inf, 3.0, 6.0),
        (4.0, -np.inf, 5.0, 2.0, 5.0),
    ],
)
def test_without_bounds_the_points_lie_half_the_start_around_it(start, lower, upper, low, high):
    points = trial_points([Parameter("a", start, lower, upper)], lambda _: True)
    parts = sorted((point.values["a"] - low) / (high - low) for point in points)
    assert parts == pytest.approx([0.013, 0.518, 0.987], abs=0.005)


def test_places_of_a_logarithmic_parameter_are_those_of_its_logarithm():
    points = trial_points([Parameter("k", 1e3, 1e2, 1e6, scale="log")], lambda _: True)
    parts = sorted(np.log10(point.values["k"] / 1e2) / 4.0 for point in points)
    assert parts == pytest.approx([0.013, 0.518, 0.987], abs=0.005)


def test_whether_a_point_is_inside_the_domain_is_asked_once():
    asked = []
    trial_points([Parameter("a", 0.25, 0.0, 1.0)], lambda values: asked.append(values) is None)
    assert len(asked) == 3


def test_points_outside_the_domain_are_halved_towards_the_start_twenty_times():
    asked = []

    def never(values):
        asked.append(values["a"])
        return False

    points = trial_points([Parameter("a", 0.25, 0.0, 1.0)], never)
    assert len(asked) == 60
    first = np.array(asked).reshape(3, 20)
    steps = (first[:, :1] - 0.25) * 0.5 ** np.arange(21)
    assert first == pytest.approx(0.25 + steps[:, :-1], rel=1e-12)
    assert [p.values["a"] for p in points] == pytest.approx(0.25 + steps[:, -1], rel=1e-12)


@pytest.mark.parametrize(
    ("slope", "value", "differs"),
    [
        (1.0 + 0.9e-9, 0.0, False),
        (1.0 + 1.1e-9, 0.0, True),
        (1.0 - 1.1e-9, 0.0, True),
        (1.0 + 1e-5, -3.9e8, True),  # a value v at 4 rounds the derivative by 1e-13 |v| / 4
        (1.0 + 1e-5, -4.1e8, False),
        (1.0 - 1e-5, 3.9e8, True),
        (1.0 - 1e-5, 4.1e8, False),
    ],
)
def test_derivatives_differ_by_more_than_rounding(slope, value, differs):
    at = {4.0: 1.0, 5.0: slope}
    part = EquationPart("it", lambda point: np.array([[0.0, 0.5], [value, at[point.values["a"]]]]))
    here, there = (ParameterPoint({"a": x}, ("a",)) for x in at)
    assert _Slopes(part, here).differ(part, there).tolist() == [differs]

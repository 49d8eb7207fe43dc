"""Whether a quantity is affine in the parameters is found by its derivatives at a few points."""

from __future__ import annotations

import numpy as np
import pytest

from geoident.forward.affine import EquationPart, first_obstacle, trial_points
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


def test_where_only_the_start_is_admissible_the_points_come_close_to_it():
    points = trial_points([Parameter("a", 0.25, 0.0, 1.0)], lambda values: values["a"] < 0.26)
    assert all(0.0 < point.values["a"] < 0.26 for point in points)


@pytest.mark.parametrize(
    ("bend", "value", "is_affine"),
    [(1e-11, 0.0, True), (1e-7, 0.0, False), (1e-7, 1e9, True), (1e-7, 1e3, False)],
)
def test_a_bend_within_rounding_of_value_or_slope_is_no_obstacle(bend, value, is_affine):
    formula = lambda h: (h + h * h * bend).plus(value)  # noqa: E731
    assert (obstacle(formula, H) is None) == is_affine

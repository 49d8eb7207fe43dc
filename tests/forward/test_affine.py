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
        (lambda h, k, t: k + (h.plus(-1.001)).positive_part(), "the force is not linear in h"),
        (lambda h, k, t: k + (h.plus(-8.999)).positive_part(), "the force is not linear in h"),
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


@pytest.mark.parametrize(
    ("bend", "value", "is_affine"),
    [(1e-11, 0.0, True), (1e-7, 0.0, False), (1e-7, 1e9, True), (1e-7, 1e3, False)],
)
def test_a_bend_within_rounding_of_value_or_slope_is_no_obstacle(bend, value, is_affine):
    formula = lambda h: (h + h * h * bend).plus(value)  # noqa: E731
    assert (obstacle(formula, H) is None) == is_affine

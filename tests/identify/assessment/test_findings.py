"""Sentences on what is not determined, and the limits at which they are said."""

import numpy as np
import pytest
from scipy.stats import norm

from geoident.identify.assessment.prediction_bands import predict_band
from geoident.identify.assessment.uncertainty import assess
from geoident.identify.problem.problem import Problem
from geoident.model.parameter import Parameter, Prior
from geoident.model.results.findings import sentences_of

Z = norm.ppf(0.975)


def assessed(jacobian, sd, parameters, values):
    J = np.array(jacobian, dtype=float)
    problem = Problem(None, np.zeros(len(J)), np.broadcast_to(sd, len(J)).copy(), parameters)
    return assess(problem, np.array(values, dtype=float), J)


LINEAR = (Parameter("a", 0.5, 0.0, 1.0),)


@pytest.mark.parametrize(("sd", "determined"), [(0.249, True), (0.261, False)])
def test_a_parameter_is_determined_if_its_interval_is_no_wider_than_its_bounds(sd, determined):
    assert (Z * sd < 0.5) == determined
    found = assessed([[1.0]], sd, LINEAR, [0.5])
    assert found.determined.tolist() == [determined]


@pytest.mark.parametrize(("size", "determined"), [(0.12, True), (0.14, False)])
def test_a_quarter_of_the_range_may_come_from_what_is_not_determined(size, determined):
    """The second parameter is free between its bounds and moves the first by ``size`` of them."""
    q = (*LINEAR, Parameter("b", 0.5, 0.0, 1.0))
    assert (Z * size < 0.25) == determined
    found = assessed([[1.0, -size]], 1e-6, q, [0.5, 0.5])
    assert found.determined.tolist() == [determined, False]


@pytest.mark.parametrize(("sd", "from_prior"), [(0.28, False), (0.40, True)])
def test_a_parameter_hardly_better_known_than_by_its_prior_is_known_from_it(sd, from_prior):
    """The prior has 0.1; with readings of sd the ratio is 1 / sqrt(1 + (0.1 / sd)^2)."""
    q = (Parameter("a", 0.5, 0.0, 1.0, prior=Prior(0.5, 0.1)),)
    assert (1.0 / np.hypot(1.0, 0.1 / sd) >= 0.95) == from_prior
    found = assessed([[1.0]], sd, q, [0.5])
    assert found.from_prior.tolist() == [from_prior]
    assert found.determined.tolist() == [not from_prior]


def test_a_parameter_without_bounds_has_a_range_of_ten_references():
    q = (Parameter("a", 2.0, -np.inf, np.inf),)
    limit = 0.5 * 10.0 * 2.0 / Z
    assert assessed([[1.0]], 0.99 * limit, q, [2.0]).determined.tolist() == [True]
    assert assessed([[1.0]], 1.01 * limit, q, [2.0]).determined.tolist() == [False]


@pytest.mark.parametrize(("away", "at_bound"), [(0.5e-12, True), (2e-12, False)])
def test_a_value_on_a_bound_up_to_rounding_is_on_it(away, at_bound):
    for value in (away, 1.0 - away):
        found = assessed([[10.0]], 0.01, LINEAR, [value])
        assert found.at_bound.tolist() == [at_bound]
        side = "lower" if value < 0.5 else "upper"
        way, beyond = ("above", "less") if side == "lower" else ("below", "more")
        said = (
            f"a lies on its {side} bound: the readings limit how far {way} it the value may "
            f"be, but the bound itself is an assumption. If the ground may have {beyond}, widen "
            "the bound."
        )
        assert sentences_of(found.findings) == ((said,) if at_bound else ())


def test_a_parameter_that_is_held_is_not_said_to_lie_on_a_bound():
    held = (Parameter("a", 0.5, 0.5, 0.5), Parameter("b", 0.5, 0.0, 1.0))
    found = assessed([[1.0, 1.0]], 0.01, held, [0.5, 0.5])
    assert found.at_bound.tolist() == [True, False]
    assert found.findings == ()


@pytest.mark.parametrize(("value", "beyond"), [(0.21, True), (0.19, False)])
def test_intervals_that_reach_beyond_a_bound_are_marked(value, beyond):
    sd = 0.2 / Z
    for at in (0.4 - value, 0.6 + value):
        assert assessed([[1.0]], sd, LINEAR, [at]).beyond_bounds.tolist() == [beyond]


# Sentences


def pair(half, *, sign=1.0):
    """E and s that scale together (or make up for each other); log E - log s known to ``half``."""
    q = tuple(Parameter(n, 1.0, 0.01, 100.0, "log") for n in ("E", "s"))
    return sentences_of(assessed([[1.0 / 8.0, -sign / 2.0]], half / Z, q, [8.0, 2.0]).findings)


def test_the_ratio_or_the_product_of_what_is_open_is_said():
    low, high = np.exp(-0.1), np.exp(0.1)
    assert pair(0.1) == (
        "The readings cannot separate E and s: scaled by one factor, they leave the readings "
        "the same within the errors. s / E is determined: 0.25 (95 %: "
        f"{0.25 * low:.4g} to {0.25 * high:.4g}, SI units).",
    )
    assert pair(0.1, sign=-1.0) == (
        "The readings cannot separate E and s: one can make up for the other. E * s is "
        f"determined: 16 (95 %: {16 * low:.4g} to {16 * high:.4g}, SI units).",
    )


def test_three_that_cannot_be_separated_are_said_with_what_makes_up_for_what():
    """Two readings of a, b and c leave one direction open: (1, 1, -1) by relative changes."""
    q = tuple(Parameter(n, 1.0, 0.01, 100.0, "log") for n in "abc")
    found = assessed([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0]], 0.01, q, [1.0, 1.0, 1.0])
    assert sentences_of(found.findings) == (
        "The readings cannot separate a, b and c: a fall of c can make up for a rise of a and b.",
    )


@pytest.mark.parametrize(("half", "said"), [(0.49, True), (0.51, False)])
def test_a_ratio_is_said_where_it_is_known_to_a_factor_of_one_and_a_half(half, said):
    assert any("is determined" in text for text in pair(half)) == said


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(("share", "leans"), [(0.48, False), (0.52, True)])
def test_what_rests_mainly_on_the_prior_of_another_is_said(share, leans, turned):
    """a + b is read, with the variance that leaves this share of that of a to the prior of b.

    Whichever comes first.
    """
    prior = 0.05
    reading = prior * np.sqrt(1.0 / share - 1.0)
    q = (Parameter("a", 0.5, 0.0, 1.0), Parameter("b", 0.5, 0.0, 1.0, prior=Prior(0.5, prior)))
    found = assessed([[1.0, 1.0]], reading, q[::-1] if turned else q, [0.5, 0.5])
    assert (
        any(
            "The results for a rest mainly on that prior." in t
            for t in sentences_of(found.findings)
        )
        == leans
    )


def test_two_priors_separate():
    q = tuple(
        Parameter(n, 1.0, 0.01, 100.0, "log", prior=Prior(1.0, 0.1, "lognormal")) for n in "ab"
    )
    found = assessed([[1.0, 1.0]], 1e-3, q, [1.0, 1.0])
    assert any(
        "Only the priors of a and b separate them." in text for text in sentences_of(found.findings)
    )


# Predictions


@pytest.mark.parametrize(("part", "known"), [(0.99, True), (1.01, False)])
def test_a_prediction_is_determined_while_what_is_not_stays_below_the_rest(part, known):
    q = (Parameter("a", 0.5, 0.0, 1.0), Parameter("b", 0.5, 0.0, 1.0))
    found = assessed([[1.0, 0.0]], 0.01, q, [0.5, 0.5])
    rest = np.hypot(0.01, 0.02)
    (band,) = predict_band(found, np.array([[1.0, part * rest]]), np.array([0.02])).sd
    assert np.isfinite(band) == known
    assert not known or band == pytest.approx(np.hypot(rest, part * rest / np.sqrt(12.0)), rel=2e-3)

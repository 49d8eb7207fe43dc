"""Sentences of what singular values say, given as they are, word by word."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from geoident.identify.assessment.findings import Knowledge, describe_gaps
from geoident.identify.assessment.spectrum import SingularDirections
from geoident.model.parameter import Parameter, Prior

Z = norm.ppf(0.975)


def knowledge(vectors, *, priors=(), S=None, **more):
    """Of three parameters in ranges; undetermined are those of the vectors (3, u)."""
    q = tuple(
        replace(one, prior=Prior(1.0, 0.1)) if one.name in priors else one
        for one in (
            Parameter("E", 8.0, 0.5, 90.0, "log"),
            Parameter("s", -3.0, -9.0, -1.0),
            Parameter("c", 0.7, -2.0, 5.0),
        )
    )
    whole = SingularDirections(np.array(vectors, float).reshape(3, -1), np.zeros(0) if S is None
                               else np.array(S, float))  # fmt: skip
    given = {
        "parameters": q,
        "values": np.array([8.0, -4.0, 0.7]),
        "at_bound": np.zeros(3, dtype=bool),
        "from_prior": np.zeros(3, dtype=bool),
        "prior_rows": np.zeros((0, 3)),
        "width": np.array([24.0, 8.0, 7.0]),
        "whole": whole,
        "readings": whole,
    }
    return Knowledge(**(given | more))


def unit(*entries):
    return np.array(entries) / np.linalg.norm(entries)


NONE = SingularDirections(np.zeros((3, 0)), np.zeros(0))


def test_directions_are_read_in_relative_changes():
    """In ranges times width by value: 3 and -2 of E and s; c has zero between its bounds."""
    known = knowledge(np.eye(3))
    assert known.relative == [True, True, False]
    (found,) = known.directions(unit(1.0, -1.0, 0.9)[:, None])
    assert found.names == ("E", "s", "c")
    np.testing.assert_allclose(found.weights, [1.0, 2.0 / 3.0, 0.3], rtol=1e-12)
    assert not found.relative
    (found,) = known.directions(unit(-1.0, 1.5, 0.0)[:, None])
    np.testing.assert_allclose(found.weights, [1.0, 1.0], rtol=1e-12)
    assert (found.relative, found.equal, found.single) == (True, True, False)
    assert found.indices == (0, 1)


def test_a_gap_of_one_is_said_and_one_that_a_prior_fills():
    gap = unit(1.0, 0.0, 0.0)[:, None]
    known = knowledge(gap, S=[0.0])
    assert describe_gaps(known, np.eye(3)) == ("The readings do not determine E.",)
    filled = replace(known, whole=NONE)
    (said,) = describe_gaps(filled, np.eye(3))
    assert said == "The readings do not determine E: it is known only from the priors."
    own = knowledge(gap, S=[0.0], priors=("E", "c"), whole=NONE)
    (said,) = describe_gaps(own, np.eye(3))
    assert said == "The readings do not determine E: it is known only from its prior."
    # what is said once is not said again of the same parameter
    again = replace(own, from_prior=np.array([True, False, False]), prior_rows=np.eye(3)[:1])
    assert describe_gaps(again, np.eye(3)) == (said,)


@pytest.mark.parametrize(
    ("priors", "who"),
    [((), "the priors separate"), (("c",), "the priors separate"),
     (("s",), "the prior of s separates"), (("E", "s"), "the priors of E and s separate")],
)  # fmt: skip
def test_who_separates_what_the_readings_do_not(priors, who):
    both = unit(-1.0, 1.5, 0.0)[:, None]
    known = knowledge(both, S=[0.0], priors=priors, whole=NONE)
    (said,) = describe_gaps(known, 100.0 * np.eye(3))
    assert said == (
        "The readings cannot separate E and s: scaled by one factor, they leave the readings "
        f"the same within the errors. Only {who} them."
    )


@pytest.mark.parametrize(("sign", "name"), [(1.0, "s / E"), (-1.0, "E * s")])
def test_what_stays_determined_has_the_interval_of_its_logarithm(sign, name):
    """Var(ln E -+ ln s) from the covariance, of values 8 and -4."""
    known = knowledge(unit(-1.0, sign * 1.5, 0.0)[:, None], S=[0.0])
    C = np.array([[0.9, 0.2 * sign, 0.1], [0.2 * sign, 0.11, 0.3], [0.1, 0.3, 5.0]])
    variance = 0.9 / 64.0 + 0.11 / 16.0 - 2.0 * sign * 0.2 * sign / (8.0 * -4.0)
    half = Z * np.sqrt(variance)
    value = -0.5 if sign > 0.0 else -32.0
    ends = sorted([value * np.exp(-half), value * np.exp(half)])
    (said,) = describe_gaps(known, C)
    assert said.endswith(
        f" {name} is determined: {value:.4g} (95 %: {ends[0]:.4g} to {ends[1]:.4g}, SI units)."
    )
    # values whose sizes are the other way round
    turned = replace(known, values=np.array([3.0, -4.0, 0.7]), width=np.array([9.0, 8.0, 7.0]))
    (said,) = describe_gaps(turned, 0.1 * C)
    assert f" {'E / s' if sign > 0.0 else 'E * s'} is determined" in said


def test_no_ratio_is_said_of_three_or_of_what_changes_unlike():
    for vector in (unit(-1.0, 1.5, 3.0), unit(-1.0, 1.2, 0.0)):
        (said,) = describe_gaps(knowledge(vector[:, None], S=[0.0]), 1e-9 * np.eye(3))
        assert "determined:" not in said


def test_what_lies_on_a_bound_is_said_with_its_side():
    at_bound = np.array([True, True, False])
    known = knowledge(
        np.eye(3), S=[9.0, 9.0, 9.0], at_bound=at_bound, values=np.array([0.5, -1.0, 0.7])
    )
    low, high = describe_gaps(known, np.eye(3))
    assert low == (
        "E lies on its lower bound: the readings limit how far above it the value may be, but the "
        "bound itself is an assumption. If the ground may have less, widen the bound."
    )
    assert high == (
        "s lies on its upper bound: the readings limit how far below it the value may be, but the "
        "bound itself is an assumption. If the ground may have more, widen the bound."
    )
    held = (replace(known.parameters[0], lower=0.5, upper=0.5), *known.parameters[1:])
    assert describe_gaps(replace(known, parameters=held), np.eye(3)) == (high,)


def test_what_leans_on_a_prior_is_what_has_most_of_its_variance_from_it():
    """(C P^T)_i^2 / C_ii of the determined directions: a half of that of s, less of c."""
    columns = np.array([[0.2, 0.0, 0.0], [0.25, 0.2, 0.0], [0.1, 0.0, 0.3]]) / 4.0
    U, S, _ = np.linalg.svd(columns)
    directions = SingularDirections(U, 1.0 / S)
    known = knowledge(
        np.eye(3),
        S=[9.0] * 3,
        whole=directions,
        from_prior=np.array([True, False, False]),
        prior_rows=np.array([[20.0, 0.0, 0.0], [0.0, 120.0, 0.0]]),
    )
    C = columns @ columns.T
    np.testing.assert_allclose(directions.determined_covariance, C)
    shares = (C @ [20.0, 0.0, 0.0]) ** 2 / np.diag(C)
    assert (shares[1] > 0.5, shares[2] > 0.5) == (True, False)
    (said,) = describe_gaps(known, np.eye(3))
    assert said == (
        "E is known only from its prior: the readings hardly add to it. The results for s rest "
        "mainly on that prior."
    )
    both = replace(known, from_prior=np.array([True, True, False]))
    first, second = describe_gaps(both, np.eye(3))
    assert first == "E is known only from its prior: the readings hardly add to it."
    assert second.startswith("s is known only from its prior")

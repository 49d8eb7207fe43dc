"""Whether a model is linear over an interval: against a closed form."""

from dataclasses import replace

import numpy as np
import pytest

from geoident.identify.assessment.linearity import interval_ends
from geoident.identify.assessment.uncertainty import assess
from geoident.model.methods import HuberOptions
from geoident.model.parameter import Parameter, Prior
from geoident.workflow.estimating.diagnosis import linearity_findings

MOTION = np.array([3.0, 1.0, 2.0])
E = Parameter("E", 1.0, 1e-3, 1e3, "log")


def softly(p):
    """Readings of an elastic ground: inversely proportional to the modulus."""
    return MOTION / p[0]


def asked(make_problem, sd, *, function=softly, loss=None):
    problem = make_problem(function, [E], MOTION, sd)
    problem = problem if loss is None else replace(problem, loss=loss)
    values = np.ones(1)
    v, J = problem.response.evaluate(values)
    known = assess(problem, values, J, v)
    before = problem.response.evaluations
    ends = interval_ends(problem, known, values)
    return ends, linearity_findings(problem, known, values), problem.response.evaluations - before


@pytest.mark.parametrize(("relative", "doubtful"), [(0.16, False), (0.25, True), (0.4, True)])
def test_phi_at_the_ends_is_that_of_the_closed_form(make_problem, relative, doubtful):
    size = np.linalg.norm(MOTION)
    ends, said, _ = asked(make_problem, relative * size)
    to = 1.959964 * relative
    expected = [((np.exp(-x) - 1.0) / relative) ** 2 for x in (-to, to)]
    assert [ends.below, ends.above] == pytest.approx(expected, rel=1e-6)
    assert ends.doubtful == doubtful
    assert bool(said) == doubtful
    assert not said or "over the interval of E" in said[0]


def test_nothing_is_asked_where_it_is_known_well(make_problem):
    ends, said, evaluations = asked(make_problem, 0.14 * np.linalg.norm(MOTION))
    assert (ends, said, evaluations) == (None, (), 0)


def test_a_linear_model_raises_no_alarm(make_problem):
    ends, said, _ = asked(make_problem, 1.0, function=lambda p: -MOTION * np.log(p[0]) + MOTION)
    assert [ends.below, ends.above] == pytest.approx([3.8415] * 2, rel=1e-3)
    assert said == ()


def test_a_robust_loss_is_not_judged(make_problem):
    ends, _, evaluations = asked(make_problem, 2.0, loss=HuberOptions())
    assert (ends, evaluations) == (None, 0)


def test_no_solution_at_an_end_is_not_linear(make_problem):
    def breaks(p):
        return MOTION / p[0] if p[0].real > 0.8 else np.full(3, np.nan)

    ends, said, _ = asked(make_problem, 0.5 * np.linalg.norm(MOTION), function=breaks)
    assert ends.below == np.inf
    assert said


def test_the_least_known_parameter_that_counts_is_asked_and_the_others_follow(make_problem):
    """By its standard deviation in its value; determined, inside its bounds, no mode of a field."""
    three = (
        Parameter("E", 2.0, 0.5, 40.0, "log"),
        Parameter("s", 3.0, 1.0, 16.0),
        Parameter("k", 1.0, -6.0, 9.0, prior=Prior(1.2, 0.7)),
    )
    M = np.random.default_rng(1).normal(size=(5, 3))
    at = np.array([2.2, 2.5, 1.1])
    problem = make_problem(lambda p: M @ np.abs(p) ** 1.5, three, M @ at**1.5 + 0.1, 0.4)
    known = assess(problem, at, M * 1.5 * np.sqrt(at), M @ at**1.5)
    every = np.ones(3, dtype=bool)
    known = replace(known, determined=every, beyond_bounds=~every, at_bound=~every)
    C = known.uncut_factor @ known.uncut_factor.T

    def phi(p):
        r = (M @ p**1.5 - problem.measured) / 0.4
        return r @ r + ((p[2] - 1.2) / 0.7) ** 2

    def judged(relative, problem=problem, **more):
        found = interval_ends(problem, replace(known, sd=np.array(relative) * at, **more), at)
        return None if found is None else found.parameter

    for i in range(3):
        sd = np.full(3, 0.2)
        sd[i] = 0.21
        found = interval_ends(problem, replace(known, sd=sd * at), at)
        step = 1.959964 * C[:, i] / np.sqrt(C[i, i]) * [1.0, 3.0, 1.5]
        ends = [np.array([at[0] * np.exp(k * step[0]), *(at + k * step)[1:]]) for k in (-1, 1)]
        if all(np.all(end > 0.0) for end in ends):
            rises = [phi(end) - phi(at) for end in ends]
            assert [found.below, found.above] == pytest.approx(rises, rel=1e-5)
        assert found.parameter == i
    assert judged([0.149, 0.1, 0.149]) is None
    assert judged([0.151, 0.1, 0.149]) == 0
    first = np.array([True, False, False])
    assert judged([0.5, 0.2, 0.3], determined=~first) == 2
    assert judged([0.5, 0.2, 0.3], beyond_bounds=first) == 2
    assert judged([0.5, 0.2, 0.3], at_bound=first) is None
    field = (replace(three[0], field="E"), *three[1:])
    assert judged([0.5, 0.2, 0.3], replace(problem, parameters=field)) == 2

"""Whether a model is linear over an interval: against a closed form."""

from dataclasses import replace

import numpy as np
import pytest

from geoident.identify.assessment.linearity import interval_ends
from geoident.identify.assessment.uncertainty import assess
from geoident.model.methods import HuberOptions
from geoident.model.parameter import Parameter

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
    return ends, problem.response.evaluations - before


@pytest.mark.parametrize(("relative", "doubtful"), [(0.16, False), (0.25, True), (0.4, True)])
def test_phi_at_the_ends_is_that_of_the_closed_form(make_problem, relative, doubtful):
    size = np.linalg.norm(MOTION)
    ends, _ = asked(make_problem, relative * size)
    to = 1.959964 * relative
    expected = [((np.exp(-x) - 1.0) / relative) ** 2 for x in (-to, to)]
    assert [ends.below, ends.above] == pytest.approx(expected, rel=1e-6)
    assert ends.doubtful == doubtful


def test_nothing_is_asked_where_it_is_known_well(make_problem):
    ends, evaluations = asked(make_problem, 0.14 * np.linalg.norm(MOTION))
    assert (ends, evaluations) == (None, 0)


def test_a_linear_model_raises_no_alarm(make_problem):
    ends, _ = asked(make_problem, 1.0, function=lambda p: -MOTION * np.log(p[0]) + MOTION)
    assert [ends.below, ends.above] == pytest.approx([3.8415] * 2, rel=1e-3)
    assert not ends.doubtful


def test_a_robust_loss_is_not_judged(make_problem):
    ends, evaluations = asked(make_problem, 2.0, loss=HuberOptions())
    assert (ends, evaluations) == (None, 0)


def test_no_solution_at_an_end_is_not_linear(make_problem):
    def breaks(p):
        return MOTION / p[0] if p[0].real > 0.8 else np.full(3, np.nan)

    ends, _ = asked(make_problem, 0.5 * np.linalg.norm(MOTION), function=breaks)
    assert ends.below == np.inf
    assert ends.doubtful


def test_the_least_known_parameter_in_its_value_is_asked(make_problem):
    two = (Parameter("a", 1.0, -9.0, 9.0), Parameter("b", 1.0, -9.0, 9.0))
    values = np.array([2.0, 1.0])
    problem = make_problem(lambda p: p, two, values, np.array([0.5, 0.4]))
    ends = interval_ends(problem, assess(problem, values, np.eye(2), values), values)
    assert ends.parameter == 1
    assert [ends.below, ends.above] == pytest.approx([3.8415] * 2, rel=1e-3)

"""The search on formulas in place of a model: which readings take part, and what is said."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from geoident.identify.least_squares.closed_form import closed_form
from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.identify.problem.methods import identify
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.responses import HasOpening
from geoident.identify.problem.shared_errors import SharedErrors
from geoident.model.methods import ClosedFormOptions, GaussNewtonOptions
from geoident.model.parameter import Parameter
from geoident.model.results.costs import Counts

PARAMETERS = (Parameter("E", 4.0, 0.5, 40.0, "log"), Parameter("s", 1.0, -3.0, 9.0))
COVERED = np.array([True, False, True, True, False])
MEASURED = np.array([0.9, 77.0, 1.2, 2.6, -55.0])
SD = np.array([0.1, 9.0, 0.2, 0.3, 9.0])


class Formulas:
    """Three of five readings: s / E, s and E / 4; no solution where ``broken`` says so."""

    names = ("E", "s")
    counts = Counts()

    def __init__(self, covered=COVERED, broken=False):
        self.covered, self.broken = covered, broken

    def admissible(self, p):
        return "The ring is broken." if self.broken else None

    def readings(self, p):
        return np.array([p[1] / p[0], p[1], p[0] / 4.0])

    def evaluate(self, p):
        J = np.array([[-p[1] / p[0] ** 2, 1.0 / p[0]], [0.0, 1.0], [0.25, 0.0]])
        return self.readings(p), J

    def remarks(self, p):
        return (f"E is {p[0]:.3f}",)


class Ground:
    """A model that has such a form, or says why it has none."""

    names = ("E", "s")
    counts = Counts()

    def __init__(self, form):
        self.form, self.asked = form, []

    def admissible(self, p):
        return None

    def readings(self, p):
        raise AssertionError("The model itself is not computed.")

    evaluate = readings

    def opening(self, centre, radius):
        self.asked.append((centre, radius))
        return self.form


def problem(form, shared=None):
    return Problem(Ground(form), MEASURED, SD, PARAMETERS, shared=shared)


def silent(entry):
    return None


def smaller(shared=None):
    kept = np.flatnonzero(COVERED)
    return Problem(Formulas(), MEASURED[kept], SD[kept], PARAMETERS, shared=shared)


def test_the_readings_that_it_answers_are_met_as_by_gauss_newton():
    given = problem(Formulas())
    options = ClosedFormOptions((1.0, 2.0), 3.0, starts=2, tolerance=1e-6, max_iterations=30)
    found = closed_form(given, options, silent)
    plain = gauss_newton(smaller(), GaussNewtonOptions(1e-6, 30, 2), silent)
    assert isinstance(given.response, HasOpening)
    assert set(given.response.asked) == {((1.0, 2.0), 3.0)}
    np.testing.assert_array_equal(found.values, plain.values)
    assert (found.objective, found.status) == (plain.objective, "converged")
    assert found.objective == pytest.approx(
        np.sum(((Formulas().readings(found.values) - MEASURED[COVERED]) / SD[COVERED]) ** 2)
    )
    assert {entry.method for entry in found.iterations} == {"closed-form"}
    assert [e.note for e in found.iterations] == [e.note for e in plain.iterations]
    assert found.remarks == (
        f"E is {found.values[0]:.3f}",
        "the closed form does not give 2 of 5 readings",
    )


def test_errors_that_readings_share_stay_shared():
    columns = np.array([[0.1, 0.0], [9.0, 9.0], [0.3, 0.2], [0.0, 0.4], [7.0, 7.0]])
    found = closed_form(
        problem(Formulas(), SharedErrors(sp.csr_array(columns))), ClosedFormOptions(), silent
    )
    whole = np.diag(SD[COVERED] ** 2) + columns[COVERED] @ columns[COVERED].T
    r = Formulas().readings(found.values) - MEASURED[COVERED]
    assert found.objective == pytest.approx(r @ np.linalg.solve(whole, r))


@pytest.mark.parametrize(
    ("form", "why"),
    [
        ("the ground is square", "there is none, as the ground is square"),
        (
            Formulas(np.zeros(5, bool)),
            "there is none, as no reading is of a stage and a point that the closed form covers",
        ),
        (Formulas(broken=True), "The ring is broken."),
    ],
)
def test_where_there_is_none_the_rest_begins_at_the_start(form, why):
    found = closed_form(problem(form), ClosedFormOptions(), silent)
    assert found.values.tolist() == [4.0, 1.0]
    assert (found.objective, found.status, found.iterations) == (np.inf, "not-converged", ())
    assert found.remarks == (f"the closed form was skipped: {why}",)
    assert found.reason == f"The closed form was not possible: {why}."


def test_a_chain_goes_on_from_it_and_passes_over_none():
    given = problem(Formulas())
    model = Formulas(np.ones(3, bool))
    model.opening = lambda centre, radius: Formulas(np.array([True, True, True]))
    chain = (ClosedFormOptions(starts=1), GaussNewtonOptions(starts=1))
    found = identify(replace(smaller(), response=model), chain, silent)
    methods = [entry.method for entry in found.iterations]
    assert list(dict.fromkeys(methods)) == ["closed-form", "gauss-newton"]
    assert methods.count("gauss-newton") == 1
    with pytest.raises(AssertionError, match="itself"):
        identify(given, chain, silent)
    model.opening = lambda centre, radius: "it is square"
    passed = identify(replace(smaller(), response=model), chain, silent)
    assert {entry.method for entry in passed.iterations} == {"gauss-newton"}
    assert passed.remarks == ("the closed form was skipped: there is none, as it is square",)
    assert passed.status == "converged"

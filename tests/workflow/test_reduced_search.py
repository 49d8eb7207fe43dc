"""A fit by way of the reduced model: fewer analyses, the same answer, also when cut short."""

from __future__ import annotations

import numpy as np
import pytest
from support.reduced import PAIRS_PLANE, plane

from geoident.identify.problem.methods import identify
from geoident.identify.problem.problem import Problem
from geoident.model.methods import GaussNewtonOptions, ScanAxis, ScanOptions
from geoident.workflow.running.cached_response import CachedResponse, substituting
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Request, plan_scan
from geoident.workflow.running.reduced_scan import with_reduced_readings
from geoident.workflow.scan import scan
from tests.support.trench import write_case

from .test_remember import Notebook

SD = 1e-4


def truth(staged):
    p = np.array([q.start for q in staged.case.parameters]) * [0.4, 0.7, 1.2, 1.2, 0.7]
    noise = 0.1 * SD * np.sin(np.arange(1.0, len(PAIRS_PLANE) + 1))
    return staged.response(PAIRS_PLANE).readings(p) + noise


@pytest.fixture(scope="module")
def measured():
    return truth(plane())


def solved(measured, log, *, reduced, stop=10**9):
    """The outcome of a fit, and how many analyses it made; ended after some evaluations."""
    staged = plane()
    inner = staged.response(PAIRS_PLANE)
    if reduced:
        inner.record(economical=False)
    left = [stop]

    def before():
        left[0] -= 1
        if left[0] < 0:
            raise KeyboardInterrupt

    response = CachedResponse(inner, log, before=before)
    sd = np.full(len(measured), SD)
    parameters = tuple(q for q in staged.case.parameters)
    problem = Problem(response, measured, sd, parameters)
    with substituting(response):
        outcome = identify(problem, [GaussNewtonOptions(tolerance=1e-10)], lambda _: None)
    return outcome, response.counts.evaluations, staged.counts.evaluations


def test_fewer_evaluations_lead_to_the_same_answer(measured):
    plain, usual, _ = solved(measured, Notebook(), reduced=False)
    led, few, _ = solved(measured, Notebook(), reduced=True)
    assert few < usual
    assert led.status == "converged"
    assert led.objective - plain.objective < 1e-6  # a thousandth of a standard deviation
    np.testing.assert_allclose(led.values, plain.values, rtol=1e-4)


@pytest.mark.parametrize("stop", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_a_run_that_was_cut_short_goes_on_to_the_same_numbers(measured, stop):
    whole, count, _ = solved(measured, Notebook(), reduced=True)
    log = Notebook()
    with pytest.raises(KeyboardInterrupt):
        solved(measured, log, reduced=True, stop=stop)
    again, counted, made = solved(measured, log, reduced=True)
    np.testing.assert_array_equal(again.values, whole.values)
    assert counted == count
    assert made <= count


def test_a_run_that_ended_is_replayed_without_a_march(measured):
    log = Notebook()
    whole, count, _ = solved(measured, log, reduced=True)
    again, counted, made = solved(measured, log, reduced=True)
    assert made == 0
    assert counted == count
    np.testing.assert_array_equal(again.values, whole.values)


def test_a_small_grid_is_not_worth_a_reduced_model(measured):
    staged = plane()
    sd = np.full(len(measured), SD)
    problem = Problem(staged.response(PAIRS_PLANE), measured, sd, tuple(staged.case.parameters))
    options = ScanOptions({"E": ScanAxis(3e9, 9e9, 20)})
    again = with_reduced_readings(problem, staged.response(PAIRS_PLANE), options)
    assert again is problem


def test_a_scan_whose_checkpoint_cannot_be_kept_has_its_reduced_model_all_the_same(tmp_path):
    case, objectives = write_case(tmp_path), []
    for place in ("kept", "not"):
        (tmp_path / place).mkdir()
        if place == "not":  # nothing can be written there, as on a full disk
            (tmp_path / place / "case.scan.checkpoint").mkdir()
        request = Request(str(case), ("fit.scan.points=10",), str(tmp_path / place))
        result = scan(plan_scan(request), Control()).result
        assert any("a reduced model" in note for note in result.notes)
        objectives.append(result.grid.objective)
    np.testing.assert_array_equal(*objectives)

"""Priors that contradict the readings, and parameters that are tied to each other."""

from __future__ import annotations

import numpy as np
import pytest
from support.commands import run_command
from support.trench import CASE, write_case

from geoident.identify.assessment.conflicts import (
    FALSE_ALARMS,
    PriorConflict,
    conflict_findings,
    prior_conflicts,
)
from geoident.identify.assessment.uncertainty import assess
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.scaling import Scaling
from geoident.io.result.file import read_result
from geoident.model.parameter import Parameter, Prior
from geoident.model.results.findings import sentences_of

A = np.array([[1.0, 0.4], [0.3, 1.0], [0.8, -0.5], [0.2, 0.6]])
SD = 0.3
BESIDE = np.array([0.9, 0.4])


def estimated(problem):
    """The estimate of a linear problem with its priors."""
    scaling = Scaling(problem.parameters)
    rows = np.array([[1.0 / q.prior.sd if i == j else 0.0 for j in range(2)]
                     for i, q in enumerate(problem.parameters) if q.prior])  # fmt: skip
    means = np.array([q.prior.mean / q.prior.sd for q in problem.parameters if q.prior])
    whole = np.vstack([A / SD, rows.reshape(-1, 2)])
    values = np.linalg.lstsq(whole, np.concatenate([problem.measured / SD, means]), rcond=None)[0]
    return scaling, values


def problem_of(measured, priors):
    parameters = tuple(
        Parameter(name, 1.0, -500.0, 500.0, prior=prior)
        for name, prior in zip(("a", "b"), priors, strict=True)
    )
    return Problem(None, np.asarray(measured), np.full(4, SD), parameters)


def conflicts(problem):
    scaling, p = estimated(problem)
    rows = scaling.prior_jacobian(p)
    whole = np.vstack([A * scaling.dp_dx(p) / SD, rows])
    covariance = np.linalg.inv(whole.T @ whole)
    named = np.ones(2, dtype=bool)
    x, residuals = scaling.to_scaled(p), scaling.prior_residuals(p)
    return scaling, prior_conflicts(x, rows, residuals, covariance, named)


def test_right_priors_are_said_to_be_wrong_in_so_many_fits_and_no_more():
    """Truths from the priors, errors as stated: 800 fits of two priors that the readings mix."""
    rng = np.random.default_rng(0)
    priors = (Prior(2.0, 0.5), Prior(-1.0, 1.0))
    said = 0
    for _ in range(800):
        truth = [rng.normal(q.mean, q.sd) for q in priors]
        measured = A @ truth + SD * rng.standard_normal(4)
        said += bool(conflicts(problem_of(measured, priors))[1])
    assert said / 800 == pytest.approx(FALSE_ALARMS, abs=0.024)  # three standard deviations


def test_what_the_rest_gives_is_the_fit_without_that_prior():
    measured = A @ [10.0, 1.0]
    priors = (Prior(20.0, 3.0), Prior(1.2, 0.5))
    scaling, (found,) = conflicts(problem_of(measured, priors))
    _, without = estimated(problem_of(measured, (None, priors[1])))
    assert found.parameter == 0
    assert found.x * scaling.reference[0] == pytest.approx(without[0], rel=1e-9)
    whole = np.vstack([A / SD, [[0.0, 1.0 / 0.5]]])
    sd = np.sqrt(np.linalg.inv(whole.T @ whole)[0, 0])
    assert found.sd_x * scaling.reference[0] == pytest.approx(sd, rel=1e-9)
    assert found.distance == pytest.approx((without[0] - 20.0) / np.hypot(sd, 3.0), rel=1e-9)


def test_a_prior_of_twice_what_the_readings_say_is_named(tmp_path):
    """20 +- 4 GPa against 5 GPa from the readings."""
    prior = ", prior: {mean: 20 GPa, sd: 4 GPa}}"
    text = CASE.replace("50 GPa], scale: log}", f"50 GPa], scale: log{prior}")
    path = write_case(tmp_path)
    path.write_text(text)
    ended = run_command("fit", path)
    (said,) = [
        q
        for q in sentences_of(read_result(tmp_path / "case.fit.h5").findings)
        if "contradicts" in q
    ]
    assert "The prior of E (20 +- 4 GPa) contradicts the readings: without it they give" in said
    assert "GPa (95 %:" in said
    assert "the prior, the accuracies or the model is wrong" in said
    assert "contradicts the readings" in " ".join(ended.stderr.split())
    path.write_text(text.replace("20 GPa, sd", "6 GPa, sd"))
    run_command("fit", path)
    assert not any(
        "contradicts" in q for q in sentences_of(read_result(tmp_path / "case.fit.h5").findings)
    )


@pytest.mark.parametrize("scale", ["log", "linear"])
def test_the_sentence_has_the_fit_without_the_prior_and_how_seldom_chance_makes_it(scale):
    """2.8 standard deviations: twice the tail of a normal distribution is 1 of 196."""
    prior = Prior(8e9, 2e9)
    parameter = Parameter("E", 5e9, 1e9, 50e9, scale, prior, unit="GPa", dimension="pressure")
    of = 1.0 if scale == "log" else 5e9
    x, sd = (np.log(14e9), 0.1) if scale == "log" else (14e9 / of, 1e9 / of)
    found = PriorConflict(0, -2.8, x, sd)
    (conflict,) = conflict_findings([found], [parameter], np.array([of]))
    ends = (11.5, 17.0) if scale == "log" else (12.0, 16.0)
    assert (conflict.kind, conflict.subject) == ("prior-conflict", "E")
    assert conflict.numbers["value"] == pytest.approx(14e9)
    assert conflict.sentence == (
        "The prior of E (8 +- 2 GPa) contradicts the readings: without it they give 14 GPa "
        f"(95 %: {ends[0]:.3g} to {ends[1]:.3g}), 2.8 standard deviations from it. By chance "
        "this happens in 1 of 196 fits. The result lies between the two: the prior, the "
        "accuracies or the model is wrong."
    )


@pytest.mark.parametrize(
    ("x", "side"), [(4e-175, "less than its lower"), (1e15, "more than its upper")]
)
def test_a_prior_is_not_contradicted_by_a_number_beyond_the_bounds(x, side):
    parameter = Parameter(
        "E", 5e9, 1e9, 50e9, "log", Prior(8e9, 2e9), unit="GPa", dimension="pressure"
    )
    found = PriorConflict(0, -5.0, np.log(x), 1.0)
    (conflict,) = conflict_findings([found], [parameter], np.ones(1))
    assert f"without it they give {side} bound, 5.0 standard deviations" in conflict.sentence


def tied(jacobian, sd=0.01):
    parameters = (Parameter("E", 2.0, 0.1, 50.0, "log"), Parameter("K0", 1.0, 0.2, 4.0))
    J = np.array(jacobian)
    problem = Problem(None, np.zeros(len(J)), np.full(len(J), sd), parameters)
    return assess(problem, np.array([2.0, 1.0]), J)


def test_parameters_that_can_make_up_for_each_other_are_named_though_both_have_intervals():
    found = tied([[1.0, 1.0], [1.0, 1.3], [1.0, 0.9]])
    assert found.determined.all()
    assert found.correlation[0, 1] < -0.95
    (said,) = sentences_of(found.findings)
    assert said.startswith("E and K0 are strongly correlated (-0.9")
    assert "). A larger value of one with a smaller value of the other would fit " in said
    (said,) = sentences_of(tied([[1.0, -1.0], [1.0, -1.3], [1.0, -0.9]]).findings)
    assert said.startswith("E and K0 are strongly correlated (0.9")
    assert "). Larger or smaller values of both would fit the readings nearly " in said


def test_nothing_is_said_of_less_tied_ones_or_twice_of_what_cannot_be_separated():
    assert tied([[1.0, 1.0], [1.0, -0.3], [1.0, 0.9]]).findings == ()
    alone = sentences_of(tied([[1.0, 1.0], [1.0, 1.0]], sd=0.01).findings)
    assert len(alone) == 1
    assert "cannot separate" in alone[0]


def test_an_estimate_beside_the_least_misfit_has_the_conflicts_of_that():
    """As the best point of a grid: its distance along a narrow valley says nothing of the prior."""
    measured, priors = A @ [10.0, 1.0], (Prior(10.5, 1.0), Prior(1.2, 0.5))
    problem = problem_of(measured, priors)
    _, p = estimated(problem)
    beside = p + BESIDE
    assert not [
        said
        for said in sentences_of(assess(problem, p, A, A @ p).findings)
        if "contradicts" in said
    ]
    found = sentences_of(assess(problem, beside, A, A @ beside).findings)
    assert not [said for said in found if "contradicts" in said]
    wrong = problem_of(A @ [20.0, 1.0], priors)
    _, p = estimated(wrong)
    said = [
        [one for one in sentences_of(assess(wrong, q, A, A @ q).findings) if "contradicts" in one]
        for q in (p, p + BESIDE)
    ]
    assert said[0] == said[1] != []

"""The outcome in sentences, with every number worked out from the tables."""

from dataclasses import replace

import numpy as np
import pytest

from geoident.model.results.findings import Finding, sentences_of
from geoident.model.results.summary import Identifiability
from geoident.report.text.residuals import rms
from geoident.report.text.result import (
    compared_outcomes,
    outcome_sentences,
    plan_text,
    result_text,
    summary_text,
    warnings,
)
from tests.support.results import changed_gauges, example_result, small_result


@pytest.fixture(scope="module")
def result():
    return example_result()


def sentence(result, words):
    (found,) = [text for text in outcome_sentences(result) if words in text]
    return found


def test_what_was_identified_from_which_readings(result):
    assert sentence(result, "identified") == (
        "3 parameters were identified from 6 readings (drift to bench 1) by gauss-newton."
    )
    known = result.parameters.determined[:1]
    one = replace(result, parameters=replace(result.parameters, names=("E",), determined=known))
    assert sentence(one, "identified").startswith("1 parameter was")
    single = result.gauges.used.copy()
    single[:, 0] = False
    later = replace(result, gauges=changed_gauges(result.gauges, used=single))
    assert "from 5 readings (bench 1)" in sentence(later, "identified")
    assert not any("identified" in text for text in outcome_sentences(small_result()))


@pytest.mark.parametrize(
    ("status", "words"),
    [
        ("converged", "The search converged."),
        ("not-converged", "did not converge: the values are the best found so far."),
        ("not-determined", "The readings do not determine all parameters."),
        ("out-of-budget", "ran out of its budget: the values are the best found so far."),
        ("done", "The computation is complete."),
    ],
)
def test_every_ending_is_said_in_words(result, status, words):
    assert any(text.endswith(words) for text in outcome_sentences(replace(result, status=status)))


def test_values_are_those_of_what_is_determined(result):
    assert (
        sentence(result, "E_rock")
        == "E_rock = 12.3 GPa (95 %: 11.6 to 13.1); K0 = 3.00 (95 %: 2.80 to 3.00)."
    )
    assert sentence(result, "sigma_v") == "sigma_v is known only from its prior."


@pytest.mark.parametrize(
    ("far", "words"),
    [
        ((), "no reading exceeds 3 standard deviations"),
        ((3.1,), "one reading exceeds 3 standard deviations"),
        ((3.1, -3.1), "2 readings exceed 3 standard deviations"),
    ],
)
def test_residuals_are_said_in_the_stated_standard_deviation(result, far, words):
    gauges = result.gauges
    in_sd = np.full(6, 0.5)
    in_sd[: len(far)] = far
    measured = gauges.measured.copy()
    measured[gauges.used] = gauges.computed[gauges.used] + 1e-4 * in_sd
    given = replace(result, gauges=changed_gauges(gauges, measured=measured))
    expected = np.sqrt(np.mean(in_sd**2))
    assert rms(given) == pytest.approx(expected)
    said = sentence(given, "root mean square")
    assert f"is {expected:.2f} of their standard deviations (about 1 if" in said
    assert words in said


def test_nothing_is_said_of_residuals_or_predictions_where_there_are_none(result):
    unused = np.zeros_like(result.gauges.used)
    none = replace(result, gauges=changed_gauges(result.gauges, used=unused), prediction=None)
    assert not any("root mean" in text or "95 % bands" in text for text in outcome_sentences(none))


def test_predictions_are_scored(result):
    assert sentence(result, "bands") == "4 of 4 predicted readings lie within their 95 % bands."
    measured = result.gauges.measured.copy()
    measured[0, 2] = 1.0
    off = replace(result, gauges=changed_gauges(result.gauges, measured=measured))
    assert sentence(off, "bands").startswith("3 of 4 ")


def test_warnings_have_the_reason_and_what_lies_on_a_bound(result):
    said = warnings(result)
    assert said[0] == result.reason
    assert said[1:] == [*sentences_of(result.findings), "K0 lies on its upper bound."]
    assert warnings(replace(result, status="converged"))[0] == sentences_of(result.findings)[0]
    known = replace(result, findings=(Finding("at-bound", "K0", "K0 is at its largest."),))
    assert len(warnings(known)) == 2
    quiet = replace(result.parameters, at_bound=np.zeros(3, dtype=bool))
    assert warnings(replace(result, status="converged", findings=(), parameters=quiet)) == []


def test_results_are_compared_by_outcome(result):
    header = compared_outcomes([]).header
    assert header[4:] == ("misfit", "readings used", "rms residual (sd)", "in 95 % band")
    first, second = compared_outcomes([("a", result), ("b", small_result(objective=np.nan))]).rows
    expected = np.sqrt(np.mean(np.square([1.0, -1.0, 8.0, 2.0, 1.0, -1.0])))
    assert first == [
        "a",
        "fit",
        "not-determined",
        "gauss-newton",
        "12.5",
        "6",
        f"{expected:.2f}",
        "4 of 4",
    ]
    assert second == ["b", "scan", "done", "gauss-newton", "-", "1", "2.00", "-"]


def test_the_terminal_shows_every_part_and_the_cost(result):
    text = result_text(result, title="case.fit.h5")
    titles = ("Parameters", "Findings", "Readings (mm; 6 used, misfit 12.5)", "Most influential",
              "Predictions (mm, 95 % band)", "Notes")  # fmt: skip
    places = [text.index(f"\n{title}") for title in titles]
    assert places == sorted(places)
    assert text.startswith("case.fit.h5\nnot-determined by gauss-newton: The next step would lower")
    assert text.endswith("Cost: 5 evaluations, 12 factorizations, 40 solves")


def test_the_end_of_a_run_has_outcome_parameters_and_findings(result):
    lines = summary_text(result).splitlines()
    assert lines[0].startswith("not-determined by gauss-newton")
    assert lines[-1].startswith("- The readings do not determine sigma_v")
    assert not any(line.startswith("EX-1") for line in lines)
    predicted = replace(result, kind="predict", status="done", reason="")
    assert summary_text(predicted).splitlines()[0] == "done"


def test_a_plan_counts_the_planned_readings(result):
    plan = Identifiability(
        result.parameters, (Finding("not-determined", "", "So."),), np.ones(3), 42
    )
    text = plan_text("case.yaml", plan)
    assert text.startswith("case.yaml: 42 planned readings\n")
    assert "E_rock" in text
    assert text.endswith("- So.")

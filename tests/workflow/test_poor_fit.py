"""A misfit has consequences, whatever the loss: status, exit code, and the readings by name."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.commands import run_command
from support.results import changed_gauges, gauges
from support.trench import CASE, READINGS, write_case

from geoident.model.results.findings import sentences_of
from geoident.workflow.estimating.diagnosis import why_poor
from geoident.workflow.estimating.wrong_readings import accuracy_residuals
from tests.support.commands import said_findings

LOSSES = ["squared", "huber", "student-t"]


def fitted(tmp_path, loss, *, readings=READINGS, stages="[first, second]", more=()):
    case = write_case(tmp_path)
    case.write_text(CASE.replace("stages: [first]", f"stages: {stages}"))
    case.with_name("readings.csv").write_text(readings)
    run = run_command("fit", str(case), "--json", "-q", "--set", f"fit.loss={loss}", *more)
    return run.exit_code, json.loads(run.stdout)


@pytest.mark.parametrize("loss", LOSSES)
def test_readings_that_the_model_meets_end_with_0(tmp_path, loss):
    code, found = fitted(tmp_path, loss)
    assert (code, found["status"]) == (0, "converged")
    assert found["diagnostics"]["above"] > 0.01


ESTIMATED = ("--set", "fit.accuracies=estimate")


@pytest.mark.parametrize(
    ("loss", "more", "value"),
    [
        ("squared", (), "1e20"),
        ("huber", (), "-250"),
        ("student-t", (), "1e20"),
        ("squared", ESTIMATED, "-250"),
        pytest.param("squared", (), "-250", marks=pytest.mark.slow),
        pytest.param("huber", (), "1e20", marks=pytest.mark.slow),
        pytest.param("student-t", (), "-250", marks=pytest.mark.slow),
        pytest.param("squared", ESTIMATED, "1e20", marks=pytest.mark.slow),
    ],
)
def test_an_absurd_reading_is_named_with_its_place_and_ends_with_4(tmp_path, loss, value, more):
    line = next(row for row in READINGS.splitlines() if row.startswith("CV,second"))
    absurd = ",".join([*line.split(",")[:2], value, "mm"])
    number = READINGS.splitlines().index(line) + 1
    code, found = fitted(tmp_path, loss, readings=READINGS.replace(line, absurd), more=more)
    assert (code, found["status"]) == (4, "poor-fit")
    assert "does not fit the readings" in found["reason"]
    (said,) = [text for text in said_findings(found) if "grossly wrong" in text]
    assert f"readings.csv:{number}:" in said
    assert "CV at second" in said
    assert not any("accuracies: estimate" in text for text in said_findings(found))


def test_predictions_from_a_poor_fit_are_not_to_be_relied_on(tmp_path):
    readings = READINGS.replace("CV,first,-0.598", "CV,first,-250")
    code, _ = fitted(tmp_path, "squared", readings=readings, stages="[first]")
    assert code == 4
    run = run_command("predict", str(tmp_path / "case.fit.h5"), "--json", "-q")
    found = json.loads(run.stdout)
    assert (run.exit_code, found["status"]) == (4, "poor-fit")
    assert "not to be relied on" in found["reason"]


@pytest.mark.parametrize(
    ("kind", "size", "lower", "poor"),
    [
        ("estimated", 0.6, 0.4, True),
        ("estimated", 0.6, 0.2, False),  # few readings: it may as well be usual
        ("estimated", 0.4, 0.35, False),
        ("given", 0.6, 0.6, False),  # whoever gives it wants it
    ],
)
def test_a_model_error_that_no_usable_model_has_is_a_poor_fit(kind, size, lower, poor):
    explained = SimpleNamespace(above=0.4, below=0.6, misfit=1.0)
    error = SimpleNamespace(kind=kind, size=size, lower95=lower, upper95=0.9, large=lower > 0.3)
    said = why_poor(explained, np.zeros(0, dtype=np.int64), error)
    assert bool(said) == poor
    assert not poor or "model error of 60 %" in said


def test_the_residual_of_most_accuracies_is_named_whatever_else_explains_it():
    """By the accuracies as stated: of 0.1 mm and, of the settlement, 0.05 mm."""
    table = gauges(2)
    last = np.array([name == table.channels[-1] for name in table.readings.channel])
    stated = replace(table.readings, sd=np.where(last, 5e-5, 1e-4), own_sd=None)
    table = replace(table, readings=stated)
    (said,) = sentences_of(accuracy_residuals(table))
    assert said.startswith("EX-1.a8 at bench 1 is 0.8 mm from what is computed, 8.0 of its")
    measured = table.measured.copy()
    measured[-1, 0] -= 4.2e-4
    (said,) = sentences_of(accuracy_residuals(changed_gauges(table, measured=measured)))
    assert said.startswith(f"{table.channels[-1]} at {table.stages[0]} is 0.52 mm")
    assert "10.4 of its accuracies" in said
    near = np.where(np.abs(table.measured - table.computed) > 4.9e-4, np.nan, table.measured)
    assert accuracy_residuals(changed_gauges(table, measured=near)) == ()

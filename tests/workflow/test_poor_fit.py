"""A misfit has consequences, whatever the loss: status, exit code, and the readings by name."""

from __future__ import annotations

import json

import pytest
from support.commands import run_command
from support.trench import CASE, READINGS, write_case

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


@pytest.mark.parametrize(
    ("loss", "more"),
    [*((loss, ()) for loss in LOSSES), ("squared", ("--set", "fit.accuracies=estimate"))],
)
@pytest.mark.parametrize("value", ["1e30", "-250"])
def test_an_absurd_reading_is_named_with_its_place_and_ends_with_4(tmp_path, loss, value, more):
    line = next(row for row in READINGS.splitlines() if row.startswith("CV,second"))
    absurd = ",".join([*line.split(",")[:2], value, "mm"])
    number = READINGS.splitlines().index(line) + 1
    code, found = fitted(tmp_path, loss, readings=READINGS.replace(line, absurd), more=more)
    assert (code, found["status"]) == (4, "poor-fit")
    assert "does not fit the readings" in found["reason"]
    (said,) = [text for text in found["findings"] if "grossly wrong" in text]
    assert f"readings.csv:{number}:" in said
    assert "CV at second" in said
    assert not any("accuracies: estimate" in text for text in found["findings"])

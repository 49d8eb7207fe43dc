"""The time that is given: looked at between the stages of an evaluation."""

import numpy as np
import pytest

from geoident.errors import ExitCode, Interrupted
from geoident.workflow.backtest import backtest
from geoident.workflow.fit import fit
from geoident.workflow.running import control as module
from geoident.workflow.running.control import Control, Monitor
from geoident.workflow.running.jobs import Request, plan_backtest, plan_fit
from tests.support.lifts import SAME, readings_of, write_case, write_readings

LIMIT = 100.0
STEPS = 5  # virgin ground and four lifts


@pytest.fixture
def pit(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = write_case(tmp_path)
    write_readings(tmp_path, readings_of(path, SAME, seed=1))
    return tmp_path


class Clock(Monitor):
    """Every stage of an evaluation takes some seconds."""

    def __init__(self, monkeypatch, seconds):
        self.now, self.seconds, self.stages = 0.0, seconds, 0
        monkeypatch.setattr(module.time, "monotonic", lambda: self.now)

    def stage(self, name, number, total):
        self.now += self.seconds
        self.stages += 1


def fitted(clock, limit=LIMIT):
    control = Control(clock, max_time=limit, started=0.0)
    return fit(plan_fit(Request("case.yaml")), control).result


def latest(seconds):
    """When a run must have ended: one stage, and the grace, of the search and of the survey."""
    return LIMIT + 2.0 * (module.GRACE + seconds) + module.FOR_THE_END * LIMIT


def test_a_search_ends_within_one_stage_of_its_time(pit, monkeypatch):
    """Each evaluation takes 45 s: the third would end 35 s late, and the survey 80 s."""
    clock = Clock(monkeypatch, 9.0)
    found = fitted(clock)
    assert (found.status, found.exit_code) == ("out-of-budget", ExitCode.NOT_CONVERGED)
    assert clock.now <= latest(9.0)
    assert np.isfinite(found.parameters.values).all()
    readings = found.gauges.readings
    assert np.isfinite(readings.computed[readings.used]).all()
    assert found.fields is None
    assert (
        "No time was left to compute all stages at the answer: the result has the fitted readings "
        "alone, no predictions, forces and fields."
    ) in found.notes
    again = fit(plan_fit(Request("case.yaml")), Control()).result
    whole = fit(plan_fit(Request("case.yaml", output="whole.h5")), Control()).result
    assert again.status == "converged"
    assert (again.parameters.values == whole.parameters.values).all()


def test_what_is_known_of_the_readings_is_what_the_model_says(pit, monkeypatch):
    found = fitted(Clock(monkeypatch, 9.0))
    known = found.parameters
    units = {"E": " Pa", "K0": ""}
    at = [
        f"parameters.{n}.start={float(v)!r}{units[n]}"
        for n, v in zip(known.names, known.values, strict=True)
    ]
    rows = readings_of(pit / "case.yaml", at, seed=1, noise=0.0)
    exact = {(channel, stage): 1e-3 * value for channel, stage, value in rows}
    readings = found.gauges.readings
    for k in np.flatnonzero(readings.used).tolist():
        place = readings.channel[k], readings.stage[k]
        assert readings.computed[k] == pytest.approx(exact[place], rel=1e-9, abs=1e-12)


def test_a_quick_survey_is_still_made(pit, monkeypatch):
    """The 7.5 s of its five stages are within a tenth of the time and the grace."""
    found = fitted(Clock(monkeypatch, 1.5), limit=30.0)
    assert found.status == "out-of-budget"
    assert found.fields is not None
    assert not any("No time was left" in note for note in found.notes)


def test_no_time_for_a_single_evaluation_is_said_and_nothing_written(pit, monkeypatch):
    clock = Clock(monkeypatch, 60.0)
    with pytest.raises(Interrupted, match="before the model was evaluated once") as caught:
        fitted(clock)
    assert caught.value.exit_code == ExitCode.NOT_CONVERGED
    assert clock.stages < STEPS
    assert not (pit / "case.fit.h5").exists()


def test_a_backtest_keeps_the_fits_that_were_done(pit, monkeypatch):
    clock = Clock(monkeypatch, 4.0)
    control = Control(clock, max_time=LIMIT, started=0.0)
    found = backtest(plan_backtest(Request("case.yaml")), control).result
    assert found.status == "out-of-budget"
    assert len(found.backtest.steps) >= 1
    assert found.reason.endswith(f" Fits that were done: {len(found.backtest.steps)}.")
    assert not found.backtest.skipped
    assert clock.now <= latest(4.0)

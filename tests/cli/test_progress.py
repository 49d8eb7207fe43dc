"""What is said while a search runs: stages, iterations, parameters, and what is left."""

import time

import numpy as np
import pytest

from geoident.cli.options import Options
from geoident.cli.terminal import Pace, Terminal
from geoident.model.parameter import Parameter
from geoident.model.results.costs import Counts
from geoident.model.results.result import Iteration
from geoident.workflow.fit import fit
from geoident.workflow.running.control import Control, Monitor
from geoident.workflow.running.jobs import Request, plan_fit


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


def paced(steps, seconds=1.0, max_time=None):
    clock = Clock()
    pace = Pace(max_time, clock)
    for step in steps:
        clock.now += seconds
        pace.add(step)
    return pace


def test_steps_that_shrink_tenfold_reach_their_end_one_by_one():
    assert paced([1.0, 1e-1, 1e-2], seconds=2.0).remaining() == pytest.approx(6 * 2.0)


@pytest.mark.parametrize("steps", [[], [0.0], [0.5, 0.7], [0.0, 0.3]])
def test_nothing_is_promised_while_steps_do_not_shrink(steps):
    assert paced(steps).remaining() is None


def test_the_time_that_was_given_bounds_what_is_left():
    assert paced([1.0, 0.9], max_time=5.0).remaining() == pytest.approx(3.0)
    assert paced([0.5, 0.7], max_time=5.0).remaining() == pytest.approx(3.0)


def test_between_two_iterations_it_counts_down_and_does_not_grow():
    pace = paced([1.0, 1e-1, 1e-2], seconds=2.0)
    pace.clock.now += 5.0
    assert pace.remaining() == pytest.approx(12.0 - 5.0)
    pace.clock.now += 50.0
    assert pace.remaining() == 0.0
    pace.done = 0.5
    assert pace.remaining() == pytest.approx(61.0)
    pace.clock.now += 11.0
    assert pace.remaining() == pytest.approx(50.0)


class Told(Monitor):
    def __init__(self):
        self.stages = []

    def stage(self, name, number, total):
        self.stages.append((name, number, total))


def test_every_stage_of_every_evaluation_is_told(trench):
    told = Told()
    fit(plan_fit(Request(case="case.yaml")), Control(told))
    assert set(told.stages) == {("virgin", 0, 2), ("first", 1, 2), ("second", 2, 2)}
    assert told.stages.count(("first", 1, 2)) >= 3


E_ROCK = Parameter("E_rock", 1e9, 1e8, 1e11, "log", None, "pressure", "GPa")


def iteration(number=3, step=0.01):
    return Iteration("gauss-newton", number, 12.5, np.array([9.9e9]), step, Counts())


def test_the_live_line_has_all_of_it(monkeypatch):
    terminal = Terminal(Options(), (E_ROCK,))
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    with terminal.live("case.yaml"):
        terminal.step(iteration(2, 0.1))
        terminal.step(iteration(3, 0.01))
        time.sleep(0.11)  # what comes sooner is not shown
        terminal.stage("bench [1]", 2, 6)
        shown = str(terminal.__rich__())
    for words in ("gauss-newton 3", "12.5", "E_rock 9.9 GPa", "stage 2 of 6, bench [1]", "left"):
        assert words in shown


def test_under_a_script_lines_come_with_v_only(capsys):
    Terminal(Options(), (E_ROCK,)).step(iteration())
    assert capsys.readouterr().err == ""
    Terminal(Options(verbose=True), (E_ROCK,)).step(iteration())
    assert "step 1.0e-02" in capsys.readouterr().err

"""Parts of a search in processes: the numbers, the counts and the checkpoint of a serial run."""

import pickle

import numpy as np
import pytest
from support.executors import InThisProcess, sent

from geoident.errors import (
    CollapseError,
    ExitCode,
    Fault,
    InputError,
    Interrupted,
    Location,
    ModelError,
    TimeIsUp,
)
from geoident.identify.problem.ahead import BESIDE, prefetched_readings
from geoident.identify.problem.problem import Problem
from geoident.io.result.checkpoint import EvaluationLog
from geoident.model.parameter import Parameter
from geoident.workflow.executing.executor import Answered
from geoident.workflow.fit import fit
from geoident.workflow.running import workers
from geoident.workflow.running.cached_response import CachedResponse
from geoident.workflow.running.control import Control
from geoident.workflow.running.evaluation_log import Recording
from geoident.workflow.running.jobs import Request, plan_fit, plan_scan
from geoident.workflow.running.prefetching import ResponseBeside
from geoident.workflow.scan import scan
from tests.support.plastic_bars import Frame, PlasticBars
from tests.support.trench import write_case, write_yielding_case


@pytest.fixture
def trench(tmp_path):
    return write_case(tmp_path)


@pytest.fixture
def yielding(tmp_path):
    return write_yielding_case(tmp_path)


class OnOtherModels(InThisProcess):
    """Answers with models of its own, the last task first."""

    def run(self, tasks):
        for number, task in reversed(list(enumerate(tasks))):
            yield Answered(number, sent(self.answer(sent(task))))


@pytest.fixture
def on_other_models(monkeypatch):
    """What processes would answer, without waiting for them to begin."""
    monkeypatch.setattr(workers, "LocalProcesses", OnOtherModels)


def scanned(case, jobs, *overrides, folder="out", **given):
    place = case.parent / folder
    place.mkdir(exist_ok=True)
    said = (*overrides, "fit.reduced=false")
    request = Request(str(case), said, str(place), fresh=True)
    return scan(plan_scan(request), Control(jobs=jobs, **given)).result


def same(one, other):
    """Whether two searches are one to the last bit, and have asked for the same."""
    for mine, its in zip(one.history, other.history, strict=True):
        assert np.array_equal(mine.values, its.values)
        assert mine.objective == its.objective
        assert mine.counts.evaluations == its.counts.evaluations
    assert one.counts.evaluations == other.counts.evaluations
    return np.array_equal(one.parameters.values, other.parameters.values)


GRID = (
    "fit.scan.grid={k2: {from: LOW, to: 2 MPa, points: 2}, "
    "k1: {from: FROM, to: 0.9 MPa, points: 12}}"
)


def test_a_scan_where_ground_yields_or_does_not_stand_has_them_too(yielding, on_other_models):
    """Rows of twelve points: what begins near an earlier point begins so in any process."""
    grid = GRID.replace("FROM", "0.02 MPa").replace("LOW", "1 MPa")
    alone, together = scanned(yielding, 1, grid), scanned(yielding, 2, grid, folder="two")
    assert np.isinf(alone.grid.objective).any()
    assert np.isfinite(alone.grid.objective).sum() > 6
    assert np.array_equal(alone.grid.objective, together.grid.objective)
    assert same(alone, together)


@pytest.mark.parametrize(
    "method",
    [("fit.method=complementarity",), ("fit.method=gauss-newton", "fit.gauss-newton.starts=3")],
    ids=["restarts", "starts"],
)
def test_a_search_from_several_points_has_them_too(yielding, method, on_other_models):
    said = (*method, "fit.backtest=false", "fit.model_error=none")
    found = []
    for jobs, folder in ((1, "one"), (2, "two")):
        (yielding.parent / folder).mkdir()
        request = Request(str(yielding), said, str(yielding.parent / folder))
        found.append(fit(plan_fit(request), Control(jobs=jobs)).result)
    assert same(*found)


class Beside:
    """Processes that are none: each part on a model of its own, the last one first."""

    def __init__(self, model, *, lose=(), stop_after=None):
        self.model, self.lose, self.stop_after = model, lose, stop_after
        self.sent, self.stopping = [], False

    def at_once(self, tasks=()):
        return 4

    def evaluate_ahead(self, tasks, pairs, times):
        self.sent.append([len(task.points) for task in tasks])
        for number in reversed(range(len(tasks))):
            if number in self.lose:
                yield Answered(number, None, ("was killed",) * 3)
                continue
            found = Recording()
            response = CachedResponse(self.model(), found, before=lambda: None)
            tasks[number](response)
            found.failures = response.failures
            yield Answered(number, found)
            if self.stop_after is not None and len(tasks) - number >= self.stop_after:
                self.stopping = True

    def check(self):
        if self.stopping:
            raise Interrupted("enough")


def bars():
    return PlasticBars(
        [
            Frame([1.0, 2.0, 1.0, 0.3], [0, 1, 2, None], [2.0, 5.0, 9.0]),
            Frame([3.0, 1.0, 1.0, 0.2], [0, 2, 1, None], [1.5, 4.0, 9.0]),
        ],
        3,
    )


POINTS = np.linspace(0.5, 4.0, 20)[:, None] * np.ones(3)


def asked(log, beside=None, points=POINTS):
    """The readings at points, None where there is no solution, and what was computed here."""
    model = bars()
    where = None if beside is None else ResponseBeside(beside, (), ())
    before = (lambda: None) if beside is None else beside.check
    response = CachedResponse(model, log, before=before, elsewhere=where)
    parameters = tuple(Parameter(f"k{i}", 5.0, 0.1, 20.0, "log") for i in (1, 2, 3))
    problem = Problem(response, np.zeros(6), np.ones(6), parameters)
    found = []
    with prefetched_readings(problem, points) as turn:
        for k, p in enumerate(points):
            turn(k)
            try:
                found.append(tuple(response.readings(p)))
            except ModelError as error:
                found.append(str(error))
    return found, model.costs.evaluations, response.counts


@pytest.fixture
def log(tmp_path):
    with EvaluationLog.open(tmp_path / "log", "here") as kept:
        yield kept


def test_what_others_have_computed_is_not_computed_here(log, tmp_path):
    with EvaluationLog.open(tmp_path / "other", "here") as other:
        alone, evaluations, counts = asked(other)
    beside = Beside(bars)
    together, here, same_counts = asked(log, beside)
    assert together == alone
    assert same_counts.evaluations == counts.evaluations
    assert (evaluations, here) == (20, 0)
    assert beside.sent == [[BESIDE, BESIDE, 4]]


def test_a_run_that_goes_on_sends_only_what_it_does_not_know(log):
    first, _, _ = asked(log, Beside(bars), POINTS[:10])
    beside = Beside(bars)
    found, here, _ = asked(log, beside)
    assert found[:10] == first
    assert here == 0
    assert beside.sent == [[6, 4]]


def test_a_part_that_has_cost_its_processes_has_no_solution(log):
    found, here, _ = asked(log, Beside(bars, lose=(1,)))
    assert all("was killed" in text for text in found[BESIDE : 2 * BESIDE])
    assert not any(isinstance(one, str) for one in (*found[:BESIDE], *found[2 * BESIDE :]))
    assert here == 0


def test_when_a_stop_is_wished_what_was_found_is_kept(log):
    with pytest.raises(Interrupted):
        asked(log, Beside(bars, stop_after=2))
    assert all(log.find("readings", p) for p in POINTS)


def test_a_stop_ends_a_scan_and_the_same_command_goes_on(trench, on_other_models):
    """The wish comes with the second point; what is known then is not computed again."""

    class Stopping:
        def __init__(self, control):
            self.control = control

        def __getattr__(self, name):
            return lambda *told: None

        def step(self, iteration):
            self.control.stop.ask(ExitCode.INTERRUPTED)

    whole = scanned(trench, 1, "fit.scan.points=4", folder="whole")
    request = Request(str(trench), ("fit.scan.points=4", "fit.reduced=false"))
    control = Control(jobs=2)
    control.monitor = Stopping(control)
    with pytest.raises(Interrupted, match="continues from there"):
        scan(plan_scan(request), control)
    job = plan_scan(request)
    with EvaluationLog.open(job.place.checkpoint, job.identity) as kept:
        assert len(kept) >= 1
    found = scan(job, Control(jobs=2)).result
    assert np.array_equal(found.grid.objective, whole.grid.objective)
    assert found.counts.evaluations == whole.counts.evaluations


@pytest.mark.parametrize(
    "error",
    [
        CollapseError("it falls", "support it", stage="two", fraction=0.3),
        InputError([Fault("bad", "wrong", "right it", Location("case.yaml", 3, 4))]),
        Interrupted("enough", exit_code=ExitCode.TERMINATED),
        TimeIsUp("too late"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_errors_come_from_other_processes_as_they_were(error):
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert str(again) == str(error)
    assert again.__dict__ == error.__dict__
    assert again.exit_code == error.exit_code

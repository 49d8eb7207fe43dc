"""An interrupted run goes on as if it had never stopped: the same numbers, nothing twice."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from geoident.errors import ExitCode, Interrupted, ModelError
from geoident.model.response import Condensed, Evaluation
from geoident.model.results.costs import Counts
from geoident.workflow.running.cached_response import CachedResponse
from geoident.workflow.running.control import StopRequest


@dataclass
class Spring:
    """v = p * length, analysed at the first evaluation."""

    names: tuple[str, ...] = ("k",)
    counts: Counts = field(default_factory=Counts)
    asked: list[str] = field(default_factory=list)

    def admissible(self, p):
        return None if p[0] > 0 else "negative"

    def obstacle(self):
        return None

    def readings(self, p):
        return self.evaluation(p, derivatives=False).readings

    def evaluate(self, p):
        found = self.evaluation(p)
        return found.readings, found.jacobian

    def forget(self):
        self.asked.append("forget")

    def evaluation(self, p, *, derivatives=True):
        if not derivatives:
            self._work("readings", solves=1)
            return Evaluation(2.0 * p)
        self._work("evaluate", solves=2)
        if p[0] > 100:
            raise ModelError("collapse")
        return Evaluation(2.0 * p, np.array([[2.0]]))

    def condense(self, p, measured, sd):
        self._work("condense", solves=3)
        return Condensed(2.0 * p, np.eye(1), np.array([[2.0]]), measured)

    def _work(self, kind, *, solves):
        self.asked.append(kind)
        c = self.counts
        self.counts = replace(
            c,
            evaluations=c.evaluations + 1,
            analyses=1,
            factorizations=c.factorizations + 1,
            solves=c.solves + solves,
        )


class Notebook:
    def __init__(self):
        self.pages = {}

    def find(self, kind, p):
        return self.pages.get((kind, p.tobytes()))

    def add(self, kind, p, arrays):
        self.pages[kind, p.tobytes()] = arrays


def remembered(log, spring=None, before=lambda: None):
    return CachedResponse(spring or Spring(), log, before=before)


def a_search(model):
    """What an identifier might ask; the counts after each answer."""
    counts = []
    for x in (1.0, 2.0, 1.0, 3.0):
        p = np.array([x])
        model.readings(p)
        counts.append(model.counts)
        model.evaluate(p)
        counts.append(model.counts)
    model.condense(p, p, p)
    return [*counts, model.counts]


def test_a_second_run_computes_nothing_and_counts_what_it_asked_for():
    """Evaluations count where they are asked for, so that limits by them do not depend on stops."""
    log = Notebook()
    first, again = Spring(), Spring()
    counts = a_search(remembered(log, first))
    assert counts[-1] == first.counts
    resumed = a_search(remembered(log, again))
    assert again.asked == []
    assert [c.evaluations for c in resumed] == [c.evaluations for c in counts]
    assert resumed[-1].factorizations == 0


def test_a_run_that_goes_on_counts_as_one_that_was_never_interrupted():
    whole = a_search(remembered(Notebook()))
    log, left = Notebook(), [4]

    def stop():
        left[0] -= 1
        if left[0] < 0:
            raise Interrupted("stop")

    with pytest.raises(Interrupted):
        a_search(remembered(log, before=stop))
    rest = Spring()
    resumed = a_search(remembered(log, rest))
    assert [c.evaluations for c in resumed] == [c.evaluations for c in whole]
    assert len(rest.asked) == 3


def test_answers_are_the_same_bit_by_bit_and_are_not_shared():
    log, p = Notebook(), np.array([0.1])
    v, J = remembered(log).evaluate(p)
    v[0] = -1.0
    again, J_again = remembered(log).evaluate(p)
    assert again[0] == 0.2
    assert np.array_equal(J, J_again)


def test_readings_are_answered_from_an_evaluation():
    spring = Spring()
    model, p = remembered(Notebook(), spring), np.array([2.0])
    model.evaluate(p)
    assert model.readings(p) == [4.0]
    assert spring.asked == ["evaluate"]


def test_a_failed_evaluation_costs_and_is_not_kept():
    log, p = Notebook(), np.array([200.0])
    model = remembered(log)
    with pytest.raises(ModelError):
        model.evaluate(p)
    assert model.counts.solves == 2
    assert log.pages == {}


def test_a_wish_to_stop_is_heard_before_the_next_evaluation():
    stop = StopRequest()
    model, p = remembered(Notebook(), before=stop.check), np.array([1.0])
    model.readings(p)
    stop.ask(ExitCode.TERMINATED)
    model.readings(p)
    with pytest.raises(Interrupted) as caught:
        model.evaluate(p)
    assert caught.value.exit_code == ExitCode.TERMINATED

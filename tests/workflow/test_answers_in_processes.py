"""Thousands of answers in several processes: the bits of one process, and no process in vain."""

import pickle
from functools import partial
from typing import ClassVar

import numpy as np
import pytest

from geoident.workflow.estimating.setup import prepare
from geoident.workflow.executing.executor import Answered
from geoident.workflow.running.answers import Asked, here, in_processes
from geoident.workflow.running.jobs import Request, plan_fit
from tests.support.trench import write_yielding_case


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """A trench whose ground yields: an evaluation begins from one near by."""
    return write_yielding_case(tmp_path_factory.mktemp("yielding"))


def model_of(path):
    setup = prepare(plan_fit(Request(str(path))))
    return Asked(setup.model, setup.case, setup.readings)


@pytest.fixture(scope="module")
def points():
    chance = np.random.default_rng(3)
    return np.column_stack([chance.uniform(0.4e6, 0.9e6, 21), chance.uniform(1.5e6, 3e6, 21)])


@pytest.fixture(scope="module")
def alone(case, points):
    return bits(here(model_of(case))(points))


def bits(answers):
    return [(None if a.used is None else a.used.tobytes(), a.later.tobytes()) for a in answers]


class OnOtherModels:
    """An executor in this process that answers on a model of its own, the last task first."""

    begun: ClassVar[list[int]] = []

    def __init__(self, jobs, set_up):
        self.begun.append(jobs)
        self.answer = pickle.loads(pickle.dumps(set_up))()

    def __enter__(self):
        return self

    def __exit__(self, *told):
        pass

    def run(self, tasks):
        for number, task in reversed(list(enumerate(tasks))):
            yield Answered(number, self.answer(pickle.loads(pickle.dumps(task))))


@pytest.fixture
def begun(monkeypatch):
    monkeypatch.setattr(OnOtherModels, "begun", [])
    return OnOtherModels.begun


def elsewhere(case, asked):
    return in_processes(partial(OnOtherModels, 2), partial(model_of, case), asked.beside)


def test_they_have_the_bits_of_one_process(case, points, alone, begun):
    asked = model_of(case)
    assert asked.beside > 1
    with elsewhere(case, asked) as compute:
        assert bits(compute(points)) == alone
    assert begun == [2]
    list(asked.answers(points[::-1]))  # whatever the model was asked before
    assert bits(here(asked)(points)) == alone

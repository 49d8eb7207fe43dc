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
from tests.support.trench import write_case

PLANES = """E: 5 GPa, nu: 0.25, yield: {type: planes, planes: [
    {name: shear, normal: [0.7071067811865476, -0.7071067811865476, 0], distance: $k1},
    {name: push, normal: [-1, 0, 0], distance: $k2}]}"""


K1 = "k1: {start: 0.7 MPa, bounds: [0.3 MPa, 2 MPa]"
K2 = "k2: {start: 2 MPa, bounds: [1 MPa, 5 MPa], scale: log"


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """A trench whose ground yields: an evaluation begins from one near by."""
    path = write_case(tmp_path_factory.mktemp("yielding"))
    text = path.read_text()
    for old, new in (
        ("E:  {start: 2 GPa, bounds: [0.1 GPa, 50 GPa]", K1),
        ("K0: {start: 1.0, bounds: [0.2, 4]", K2),
        ("E: $E, nu: 0.25", PLANES),
        ("K0: $K0", "K0: 1.5"),
        ("method: gauss-newton, ", ""),
        ("stages: [first], ", ""),
    ):  # fmt: skip
        text = text.replace(old, new)
    path.write_text(text)
    return path


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
    return in_processes(partial(OnOtherModels, 2), model_of, (case,), asked.beside)


def test_they_have_the_bits_of_one_process(case, points, alone, begun):
    asked = model_of(case)
    assert asked.beside > 1
    with elsewhere(case, asked) as compute:
        assert bits(compute(points)) == alone
    assert begun == [2]
    list(asked.answers(points[::-1]))  # whatever the model was asked before
    assert bits(here(asked)(points)) == alone

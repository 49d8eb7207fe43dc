"""Parts of a search that are told before they are asked for."""

from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from geoident.errors import ModelError
from geoident.identify.direct.scan import scan
from geoident.identify.problem.ahead import (
    ReadingsAt,
    prefetched_readings,
    without_model,
)
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.shared_errors import SharedErrors
from geoident.model.methods import HuberOptions, ScanAxis, ScanOptions
from geoident.model.parameter import Parameter
from geoident.model.results.costs import Counts

P = (Parameter("a", 1.0, 0.0, 9.0), Parameter("b", 2.0, 0.0, 9.0))


class Plain:
    """A model that notes what it is asked; it refuses a < 0 and cannot compute a = 5."""

    names = ("a", "b")
    counts = Counts()

    def __init__(self):
        self.asked = []

    def admissible(self, p):
        return "a is negative" if p[0] < 0.0 else None

    def readings(self, p):
        self.asked.append(p.tolist())
        if p[0] == 5.0:
            raise ModelError("collapse")
        return p

    def evaluate(self, p):
        return self.readings(p), np.eye(2)


class Ahead(Plain):
    """One that looks ahead at three parts at a time."""

    at_once = 3

    def __init__(self):
        super().__init__()
        self.tasks, self.turned, self.open = [], [], False

    @contextmanager
    def prefetch(self, tasks):
        self.tasks, self.open = tasks, True
        yield self.turned.append
        self.open = False


class Yielding(Ahead):
    """One whose ground yields, if it says so."""

    def __init__(self, *, yields=True):
        super().__init__()
        self.yields = lambda: yields

    def activity(self, p):
        raise AssertionError


def problem(response, **given):
    return Problem(response, np.array([1.0, 2.0]), np.array([0.1, 0.2]), P, **given)


def test_a_part_asks_for_readings_and_stops_at_no_failure():
    response = Plain()
    ReadingsAt(np.array([[1.0, 2.0], [-1.0, 0.0], [5.0, 1.0], [2.0, 3.0]]))(response)
    assert response.asked == [[1.0, 2.0], [5.0, 1.0], [2.0, 3.0]]


def test_a_problem_apart_from_its_model_is_the_same_with_another():
    shared = SharedErrors(sp.csr_array(np.array([[1.0], [2.0]])))
    whole = problem(Plain(), loss=HuberOptions(2.0), shared=shared)
    other = Plain()
    found = without_model(whole).with_model(other)
    assert found.response is other
    assert replace(found, response=whole.response) == whole


def told(response, count, row=0):
    """Parts, as first and number of points, and at which points a turn was taken."""
    points = np.arange(2.0 * count).reshape(count, 2)
    with prefetched_readings(problem(response), points, *([row] if row else [])) as turn:
        at = []
        for k in range(count):
            before = len(response.turned)
            turn(k)
            at += [(k, number) for number in response.turned[before:]]
    parts = [(int(part.points[0, 0]) // 2, len(part.points)) for part in response.tasks]
    return parts, at


@pytest.mark.parametrize(
    ("row", "expected"),
    [
        (0, [(0, 8), (8, 8), (16, 5)]),
        (10, [(0, 8), (8, 2), (10, 8), (18, 2), (20, 1)]),  # every row begins anew
        (5, [(0, 5), (5, 5), (10, 5), (15, 5), (20, 1)]),
    ],
)
def test_where_the_ground_yields_eight_points_in_a_row_are_a_part(row, expected):
    parts, at = told(Yielding(), 21, row)
    assert parts == expected
    assert at == [(first, number) for number, (first, _) in enumerate(expected)]


def test_the_rows_of_a_scan_lie_along_its_last_axis():
    response = Yielding()
    axes = {"b": ScanAxis(1.0, 4.0, 3), "a": ScanAxis(0.0, 3.0, 10)}
    scan(problem(response), ScanOptions(axes), lambda entry: None)
    assert [len(part.points) for part in response.tasks] == [8, 2] * 3
    assert response.turned == [0, 1, 2, 3, 4, 5]
    assert response.tasks[2].points[:2] == pytest.approx(np.array([[0.0, 2.5], [1.0 / 3.0, 2.5]]))

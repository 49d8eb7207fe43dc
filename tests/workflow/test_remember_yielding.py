"""A search for strengths that is interrupted goes on to the same answer, at no cost twice."""

import numpy as np
import pytest
from support.plastic_bars import Frame, PlasticBars

from geoident.errors import Interrupted
from geoident.identify.problem.problem import Problem
from geoident.identify.yield_limits.implicit import implicit
from geoident.model.methods import ComplementarityOptions
from geoident.model.parameter import Parameter
from geoident.workflow.running.cached_response import CachedResponse

from .test_remember import Notebook


def search(log, *, stop_after=10**9):
    """The outcome, and the model; interrupted before an evaluation that is too many."""
    bars = PlasticBars(
        [
            Frame([1.0, 2.0, 1.0, 0.3], [0, 1, 2, None], [2.0, 5.0, 9.0]),
            Frame([3.0, 1.0, 1.0, 0.2], [0, 2, 1, None], [1.5, 4.0, 9.0]),
        ],
        3,
    )
    measured = bars.readings(np.array([1.0, 2.0, 3.0])) * (1 + 1e-3 * np.array([1, -1, 2, 1, 0, 1]))
    bars.costs.evaluations = 0

    def before():
        if bars.costs.evaluations >= stop_after:
            raise Interrupted("enough")

    parameters = tuple(Parameter(f"k{i}", 5.0, 0.1, 20.0, "log") for i in (1, 2, 3))
    problem = Problem(
        CachedResponse(bars, log, before=before), measured, np.full(6, 1e-3), parameters
    )
    return implicit(problem, ComplementarityOptions(), lambda iteration: None), bars


def test_an_interrupted_search_goes_on_to_the_same_answer():
    whole, model = search(Notebook())
    evaluations = model.costs.evaluations
    log = Notebook()
    with pytest.raises(Interrupted):
        search(log, stop_after=evaluations // 2)
    resumed, again = search(log)
    assert np.array_equal(resumed.values, whole.values)
    assert resumed.objective == whole.objective
    ours, theirs = ([i.counts.evaluations for i in f.iterations] for f in (resumed, whole))
    assert ours == theirs
    assert again.costs.evaluations <= evaluations - evaluations // 2
    assert resumed.certificate.activity.planes == whole.certificate.activity.planes

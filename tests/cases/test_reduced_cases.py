"""The reduced model of shipped cases: no reading is further off than is estimated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geoident.forward.reduced.stress_rows import beyond_reduction
from geoident.workflow.running.answers import readable
from geoident.workflow.running.jobs import build_model, load_inputs
from geoident.workflow.running.reduced_answers import reduced_around
from tests.support.reduced import spread

CASES = Path(__file__).parents[2] / "cases"


@pytest.mark.parametrize(
    ("name", "around", "count", "every"),
    [
        pytest.param("braced-pit", 8, 6, 5, marks=pytest.mark.slow),
        pytest.param("shaft", 20, 10, 1, marks=pytest.mark.slow),
        pytest.param("braced-pit", 20, 20, 1, marks=pytest.mark.slow),
    ],
)
def test_no_reading_of_a_case_is_further_off_than_estimated(name, around, count, every):
    """Motions and forces in all stages, near the start as a sample is around a fit."""
    inputs = load_inputs(str(CASES / name / "case.yaml"), overrides=["readings=[]"])
    case, staged = inputs.case, build_model(inputs)
    all_places = [
        (row, stage)
        for row, stage in readable(staged, case)
        if beyond_reduction(staged.analysis, staged.gauges, np.array([row])) is None
    ]
    places = all_places[::every]
    pairs = [(case.channels[row].name, case.stages[stage].name) for row, stage in places]
    response = staged.response(pairs)
    start = np.array([q.start for q in case.parameters])
    reduced = reduced_around(response, start, spread(staged, around, seed=3, part=0.05), 3)
    values = spread(staged, count, seed=1, part=0.05)
    found, estimated = reduced.estimated(values)
    error = np.abs(np.array([response.readings(p) for p in values]) - found)
    assert np.mean(error > estimated) <= 0.005
    assert np.all(error <= 5.0 * estimated)

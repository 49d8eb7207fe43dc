"""Over how long a model error lasts, where a last stage is the end of all flow."""

import numpy as np
import pytest

from geoident.io.case.file import read_case
from geoident.model.methods import ModelErrorOptions
from geoident.model.moments import with_moments
from geoident.workflow.estimating.model_error_covariance import correlation_time, stage_clock

DAY = 86400.0
CASE = """\
format: geoident-case/1
analysis: plane-strain
mesh: {file: m.msh, order: 2}
parameters:
  k: {start: 1e-9 m/s, bounds: [1e-11 m/s, 1e-7 m/s], scale: log}
materials:
  clay: {E: 8 MPa, nu: 0.3, hydraulic: {permeability: $k}}
groups: {all: clay}
supports: {x0: x, x1: x, y0: fixed}
drained: {y1: {}}
stages:
  - {name: load, loads: {q: {on: y1, pressure: 50 kPa}}, lasts: 30 d}
  - {name: wait, lasts: 60 d}
  - {name: end}
DATES
gauges:
  S: {kind: settlement, point: [0.5 m, 6 m], accuracy: 0.1 mm}
"""


@pytest.mark.parametrize("dates", ["", "dates: {virgin: 2024-03-01}"])
def test_its_time_is_one_of_days_and_the_end_of_all_flow_is_far_away(tmp_path, dates):
    (tmp_path / "m.msh").touch()
    (tmp_path / "case.yaml").write_text(CASE.replace("DATES", dates))
    case = read_case(str(tmp_path / "case.yaml")).case
    case = with_moments(case, {"wait": [20 * DAY]})
    clock = stage_clock(case)
    assert list(case.stage_names[1:]) == ["load", "wait + 20 d", "wait", "end"]
    since = (clock - clock[0]) / DAY
    assert since[:4] == pytest.approx([0.0, 30.0, 50.0, 90.0])
    time = correlation_time(case, ModelErrorOptions(), [("S", "load"), ("S", "wait")])
    assert (time.size, time.unit) == (pytest.approx(30.0 * DAY), "s")
    assert np.isfinite(since).all()
    assert since[-1] >= 90.0
    if dates:
        assert since[-1] == pytest.approx(900.0)

"""Decisions at moments of stages that last."""

from support.in_stages import write_msh
from support.meshes import box

from geoident.api import fit, load_case

CASE = """\
format: geoident-case/1
analysis: plane-strain
mesh: {file: m.msh}
parameters:
  k: {start: 1.1e-9 m/s, bounds: [1e-11 m/s, 1e-7 m/s], scale: log}
materials:
  clay: {E: 8 MPa, nu: 0.3, hydraulic: {permeability: $k}}
groups: {all: clay}
supports: {x0: x, x1: x, y0: fixed}
drained: {y1: {}}
stages:
  - name: load
    loads: {q: {on: y1, pressure: 50 kPa}}
    lasts: 200 d
    moments: [5 d, 30 d, 80 d, 120 d, 160 d]
gauges:
  S: {kind: settlement, point: [0.5 m, 6 m], accuracy: 0.1 mm}
  P: {kind: piezometer, point: [0.5 m, 2 m], accuracy: 1 kPa}
decision: {if: P > 25 kPa at load + 160 d, then: wait}
readings:
  - {gauge: P, stage: load, time: 20 d, value: 47 kPa}
  - {gauge: P, stage: load, time: 60 d, value: 38 kPa}
fit: {until: load + 60 d, backtest: false, mesh_error: false, model_error: 1 %}
"""


def test_no_reading_of_a_moment_that_is_past_would_tell(tmp_path):
    write_msh(box("quad8", (1, 8), size=(1.0, 6.0)), tmp_path / "m.msh", ["x0", "x1", "y0", "y1"])
    (tmp_path / "case.yaml").write_text(CASE)
    case = load_case(str(tmp_path / "case.yaml"))
    result = fit(case, output=str(tmp_path / "o.h5")).data
    told = list(dict.fromkeys(reading.stage for reading in result.telling))
    assert told == ["load + 80 d", "load + 120 d"]

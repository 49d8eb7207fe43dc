"""Excess pore pressure as a field: in the result, for ParaView, and as isochrones."""

import numpy as np
import pytest
from support.in_stages import write_msh
from support.meshes import box

from geoident.api import fit, load_case
from geoident.io.result.file import read_result
from geoident.io.result.vtu import write_vtu
from geoident.report.drawing.album import album
from geoident.report.drawing.gauges.axis import stage_axis
from geoident.report.drawing.style import image

DAY, M = 86400.0, 8e6 * 0.7 / (1.3 * 0.4)
C = 1e-9 / 9810.0 * M
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
water: {table: 6 m}
drained: {y1: {}}
stages:
  - {name: load, loads: {q: {on: y1, pressure: 50 kPa}}, lasts: 200 d}
  - {name: end}
dates: {virgin: 2024-03-01}
gauges:
  S: {kind: settlement, point: [0.5 m, 6 m], accuracy: 0.1 mm}
  P: {kind: piezometer, point: [0.5 m, 2 m], accuracy: 1 kPa}
readings:
  - {gauge: P, stage: load, time: 20 d, value: READ_1}
  - {gauge: P, stage: load, time: 60 d, value: READ_2}
fit: {until: load + 60 d, backtest: false, mesh_error: false, model_error: 1 %}
"""


def excess(y, days):
    """Terzaghi's pressure at a height in the column, Pa."""
    n = 2.0 * np.arange(400) + 1.0
    parts = (-1.0) ** np.arange(400) / n * np.exp(-(n**2) * np.pi**2 * C * days * DAY / 144.0)
    return 4.0 * 50e3 / np.pi * np.cos(np.outer(y, n) * np.pi / 12.0) @ parts


def fitted(folder, text):
    """The result of a column that was read twice."""
    write_msh(box("quad8", (1, 20), size=(1.0, 6.0)), folder / "m.msh", ["x0", "x1", "y0", "y1"])
    for word, days in (("READ_1", 20), ("READ_2", 60)):
        read = 4.0 * 9.81e3 + excess(np.array([2.0]), days)[0]
        text = text.replace(word, f"{read:.1f} Pa")
    (folder / "case.yaml").write_text(text)
    fit(load_case(str(folder / "case.yaml")), output=str(folder / "o.h5"))
    return read_result(folder / "o.h5")


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """Of the column under one load."""
    return fitted(tmp_path_factory.mktemp("column"), CASE)


def test_the_result_keeps_the_pressure_of_every_state(result):
    fields, names = result.fields, ["virgin", *result.gauges.stages]
    y = fields.mesh.points[:, 1]
    for stage, days in (("load + 20 d", 20), ("load + 60 d", 60), ("load", 200)):
        found = fields.excess[names.index(stage)]
        np.testing.assert_allclose(found, excess(y, days), atol=1e-2 * 50e3)
    assert not fields.excess[0].any()
    assert not fields.excess[-1].any()


def test_isochrones_are_terzaghis_with_what_was_read(result):
    (picture,) = (p for p in album(result).all if p.name == "isochrones")
    assert image(picture, "png")
    (axes,) = picture.draw().axes
    assert axes.get_title() == "x = 0.5 m"
    curves = [line for line in axes.lines if len(line.get_xdata()) > 2]
    dots = [line for line in axes.lines if len(line.get_xdata()) == 1]
    assert len(curves) == 2
    for curve, dot, days in zip(curves, dots, (20, 60), strict=True):
        there = np.isfinite(curve.get_xdata())
        y = curve.get_ydata()[there]
        np.testing.assert_allclose(curve.get_xdata()[there], excess(y, days) / 1e3, atol=0.7)
        assert dot.get_xdata()[0] == pytest.approx(excess(np.array([2.0]), days)[0] / 1e3, rel=1e-3)


def test_gauges_are_drawn_over_dates_though_the_end_of_all_flow_has_none(tmp_path):
    two = CASE.replace("lasts: 200 d}", "lasts: 20 d}\n  - {name: wait, lasts: 180 d}")
    two = two.replace("stage: load, time: 60 d", "stage: wait, time: 40 d")
    result = fitted(tmp_path, two.replace("until: load + 60 d", "until: wait + 40 d"))
    axis = stage_axis(result)
    assert axis.dated
    assert axis.stages[-1] == "end"
    assert np.isnan(axis.at[-1])
    assert np.isfinite(axis.at[:-1]).all()
    assert list(axis.marks) == [1, 2]
    (picture,) = (p for p in album(result).all if p.name == "readings-1")
    assert image(picture, "png")


def test_paraview_gets_the_pressure_at_each_time(tmp_path, result):
    vtk = pytest.importorskip("vtkmodules.vtkIOXML")
    path = tmp_path / "load.vtu"
    state = 1 + result.gauges.stages.index("load + 20 d")
    write_vtu(result.fields, state, path)
    reader = vtk.vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput()
    array = data.GetPointData().GetArray("excess_pore_pressure")
    found = np.array([array.GetValue(k) for k in range(data.GetNumberOfPoints())])
    np.testing.assert_array_equal(found, result.fields.excess[state])
    days = result.gauges.series_times
    assert days[[state, -2, -1]] == pytest.approx([20.0, 200.0, 220.0])

"""The picture of a model: all that is in it, with names that can be read, colours for materials."""

from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.text import Text

from geoident.io.case.file import read_case
from geoident.io.mesh.file import read_mesh
from geoident.model.actions import Pressure, Water, WaterPressure
from geoident.model.case import Stage, Support
from geoident.model.parameter import Scalar
from geoident.report.drawing.album import album
from geoident.report.drawing.model.construction import (
    construction_of,
    marked_places,
    material_colours,
    material_label,
)
from geoident.report.drawing.model.drawn import DrawnModel
from geoident.report.drawing.model.figure import model_figure
from geoident.report.drawing.scene import case_of
from geoident.report.drawing.style import GAUGE
from tests.report.test_labels import overlapping
from tests.support.cases import make_case, material
from tests.support.meshes import box, regroup
from tests.support.pictures import laid_out

CASES = Path(__file__).parents[2] / "cases"
SHOWN = [p.parent.name for p in sorted(CASES.glob("*/case.yaml")) if "\nmesh:" in p.read_text()
         and p.parent.name not in ("cavern-field", "cavern-plastic")]  # fmt: skip


QUICK = ("braced-pit", "cavern", "shaft")
"""The picture has structures, many gauges, an axis; of the other shipped cases it is slow."""


def drawn(case, mesh, found=None):
    return laid_out(partial(model_figure, case, mesh, found))


@cache
def shipped(name):
    """The case of a shipped case and its picture."""
    loaded = read_case(str(CASES / name / "case.yaml"))
    mesh = read_mesh(str(CASES / name / loaded.mesh_path), dim=loaded.case.analysis.dim)
    return loaded.case, drawn(loaded.case, mesh)


def placed(axes):
    """Labels that were given a place, of all that wanted one."""
    return [t for t in axes.findobj(Text) if not t.get_in_layout() and t.axes is axes]


def words(figure):
    return {t.get_text() for t in figure.findobj(Text) if t.get_visible()}


@pytest.mark.parametrize(
    "name",
    [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in SHOWN],
)
def test_every_gauge_has_its_name_and_no_label_is_cut_or_on_another(name):
    case, figure = shipped(name)
    said = words(figure)
    assert {channel.gauge for channel in case.channels} <= said
    assert set(case.structures) <= said
    for n, stage in enumerate(case.stages, start=1):
        assert f"{n}  {stage.name}" in said
    inside = figure.bbox.padded(1.0)
    for axes in figure.axes:
        for label in (axes.xaxis.label, axes.yaxis.label, axes.title):
            if label.get_text() and axes.axison and axes.name != "3d":
                low, high = label.get_window_extent().get_points()
                assert inside.contains(*low), label.get_text()
                assert inside.contains(*high), label.get_text()
        labels = placed(axes)
        assert all(label.get_visible() for label in labels)
        if labels:
            boxes = np.array([label.get_window_extent().extents for label in labels])
            frame = axes.get_window_extent().extents
            assert (boxes[:, :2] > frame[:2]).all()
            assert (boxes[:, 2:] < frame[2:]).all()
            assert overlapping(boxes) == 0


def test_colours_tell_materials_apart_also_in_grey():
    many = {f"soil {k}": material(f"soil {k}", 1e9, 0.2) for k in range(12)}
    case = make_case(box("quad4", (2, 2)), materials=many, groups={"rock": "soil 0"})
    colours = np.array(list(material_colours(case).values()))
    grey = colours @ [0.299, 0.587, 0.114]
    assert len(np.unique(colours, axis=0)) == 12
    assert np.diff(np.sort(grey[:6])).min() > 0.06


@pytest.fixture
def lifts():
    """Ground with a pit that is dug in two steps and filled again in the third, under loads."""
    mesh = regroup(
        box("quad4", (8, 6), size=(8.0, 6.0)),
        one=lambda x: (x[:, 0] < 2) & (x[:, 1] > 4),
        two=lambda x: (x[:, 0] < 2) & (x[:, 1] > 2) & (x[:, 1] < 4),
    )
    return make_case(
        mesh,
        materials={"soil": material("soil", 5e7, 0.3), "fill": material("fill", 2e7, 0.3)},
        groups={"rock": "soil", "one": "soil", "two": "soil"},
        supports=(Support("x0", (0,)), Support("y0", (0, 1))),
        loads={"building": Pressure("x1", Scalar(1.5e5))},
        water=Water(Scalar(3.0), Scalar(9810.0)),
        stages=(
            Stage("first", excavate=("one",)),
            Stage("second", excavate=("two",)),
            Stage("filled", install={"two": "fill"},
                  loads={"lake": WaterPressure("x1", Scalar(5.0), Scalar(9810.0))}),
        ),
    ), mesh  # fmt: skip


def test_what_is_dug_and_what_is_placed_is_known_element_by_element(lifts):
    case, mesh = lifts
    made = construction_of(case, mesh)
    one, two = mesh.groups["one"], mesh.groups["two"]
    assert set(made.dug[one]) == {1}
    assert set(made.dug[two]) == {0}
    assert set(made.placed[two]) == {3}
    assert set(made.material[two]) == {list(case.materials).index("fill")}
    assert [int(n) for n in made.present.sum(axis=1)] == [48, 44, 40, 44]
    assert [n for n, _ in marked_places(mesh, made)] == ["1", "+3"]


def test_loads_water_supports_and_materials_are_drawn_and_named(lifts):
    case, mesh = lifts
    said = words(drawn(case, mesh))
    assert {"building: 150 kPa (from the beginning)", "lake: water to 5 m (stage 3)"} <= said
    assert {"water table 3 m", "held along x", "held in all directions"} <= said
    assert {"soil: E = 50 MPa", "fill: E = 20 MPa"} <= said
    lake = next(load for load in DrawnModel(case, mesh).loads if load.water)
    np.testing.assert_allclose(lake.arrows[:, 1], 0.0, atol=1e-12)
    assert (lake.arrows[:, 0] < 0).all()
    np.testing.assert_allclose(
        -lake.arrows[:, 0] / (5.0 - lake.tips[:, 1]), 1 / (5.0 - lake.tips[:, 1].min())
    )


def test_the_first_figure_of_a_report_is_the_model_with_what_was_found(plane):
    assert not album(plane).model  # its case cannot be read
    text = read_case(str(CASES / "cavern" / "case.yaml")).resolved.replace("cavern.msh", "gone.msh")
    found = replace(plane, case_resolved=text)
    assert album(found).all[0].name == "model"
    rock = case_of(found).materials["rock"]
    value = f"{plane.parameters.values[0] / 1e9:.3g} GPa"
    told = material_label(rock, case_of(found).parameters, plane.parameters)
    assert told == f"rock: E = {value}"
    assert material_label(rock, case_of(found).parameters, None) == "rock: E = E_rock"


def test_gauges_are_dark():
    assert max(to_rgb(GAUGE)) < 0.2


@pytest.mark.parametrize("name", ["braced-pit", "cavern"])
def test_no_mark_of_a_support_stands_outside_of_its_panel(name):
    marks = 0
    for axes in shipped(name)[1].axes:
        low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
        for line in axes.lines:
            if not line.get_clip_on() and len(line.get_xydata()):
                points = line.get_xydata()
                marks += len(points)
                assert ((points >= low - 1e-9) & (points <= high + 1e-9)).all()
    assert marks


def test_names_of_gauges_across_a_shaft_stand_in_the_room_beyond_the_axis():
    _, figure = shipped("shaft")
    (closer,) = [axes for axes in figure.axes if axes.get_title(loc="left") == "the dotted part"]
    to_data = closer.transData.inverted()
    at = {t.get_text(): to_data.transform(t.get_window_extent().extents.reshape(2, 2)).T
          for t in placed(closer)}  # fmt: skip
    assert all(at[f"CV-{k}"][0].max() < 0.0 for k in (2, 3, 4, 5))
    assert all(at[f"IN-{k}"][1].mean() > -60.0 for k in range(1, 6))  # not at their common foot


def test_a_figure_of_a_high_closer_view_fits_a_printed_page_as_large_as_it_is_drawn():
    for name in ("shaft", "cavern"):
        width, height = shipped(name)[1].get_size_inches()
        assert width <= 7.4, name
        assert height <= 9.4, name

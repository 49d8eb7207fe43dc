"""Figures as files: layouts as matplotlib's own, few bytes, exact colours."""

import base64
import io
from contextlib import nullcontext
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

pytest.importorskip("matplotlib", reason='reports need matplotlib: pip install "geoident[report]"')

from dataclasses import replace

from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from geoident.report.drawing import lines
from geoident.report.drawing.album import album
from geoident.report.drawing.fields import panels
from geoident.report.drawing.raster import Raster
from geoident.report.drawing.signs import sign_pictures
from geoident.report.drawing.style import Picture, drawing_style, image
from geoident.report.saving.figure_file import lay_out
from geoident.report.saving.lean_axes import lean_axes
from geoident.report.saving.svg_writer import SvgCanvas

CASES = Path(__file__).parents[2] / "cases"
SVG, LINK = "{http://www.w3.org/2000/svg}", "{http://www.w3.org/1999/xlink}href"


def places(picture, *, lean):
    """Where panels, their names and their titles stand after the layout, points."""
    with drawing_style(), lean_axes() if lean else nullcontext():
        figure = picture.draw()
        SvgCanvas(figure, 150)
        figure.dpi = 72
        if lean:
            lay_out(figure)
        elif figure.get_layout_engine() is not None:
            figure.get_layout_engine().execute(figure)
            figure.set_layout_engine("none")
        figure.draw_without_rendering()
        found = []
        for axes in figure.axes:
            found += axes.bbox.bounds
            if axes.name != "3d":
                for text in (axes.xaxis.label, axes.yaxis.label, axes.title):
                    found += text.get_window_extent().bounds
                spine = axes.spines.left
                found += spine.get_transform().transform(spine.get_path().vertices).ravel().tolist()
        return np.array(found)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("overview", marks=pytest.mark.slow),
        "parameters",
        "pairs",
        pytest.param("readings-1", marks=pytest.mark.slow),
        pytest.param("displacement", marks=pytest.mark.slow),  # also panels with a shared scale
        pytest.param("displacement-parts", marks=pytest.mark.slow),
        "yielded",
        "residuals",
        pytest.param("history", marks=pytest.mark.slow),
    ],
)
def test_lean_axes_are_laid_out_as_those_of_matplotlib(plane, name):
    (picture,) = [p for p in album(plane).all if p.name == name]
    assert places(picture, lean=True) == pytest.approx(places(picture, lean=False), abs=1e-4)


def drawn(draw):
    def made():
        figure = Figure(figsize=(3, 2))
        draw(figure.subplots())
        return figure

    return ElementTree.fromstring(image(Picture("x", "", "", made), "svg"))


def test_lines_of_one_look_are_one_element():
    many = drawn(lambda axes: axes.vlines(np.linspace(0.1, 0.9, 50), 0, 1, colors="red"))
    red = [path for path in many.iter(f"{SVG}path") if path.get("stroke") == "#ff0000"]
    assert len(red) == 1
    assert red[0].get("d").count("M") == 50


def test_no_styles_and_no_names_twice(plane):
    for picture in album(plane).overview:
        root = ElementTree.fromstring(image(picture, "svg"))
        assert not any(element.get("style") for element in root.iter())
        names = [element.get("id") for element in root.iter() if element.get("id")]
        assert len(names) == len(set(names))
        referred = {
            value.strip("#)").removeprefix("url(#")
            for element in root.iter()
            for key, value in element.attrib.items()
            if value.startswith("url(#") or (key == LINK and value.startswith("#"))
        }
        assert referred == set(names)


@pytest.mark.parametrize("many", [False, True])
def test_images_keep_their_colours(many):
    steps = (
        np.arange(40 * 50).reshape(40, 50) if many else np.arange(50)[None] // 5 + np.zeros((40, 1))
    )
    rgba = np.full((40, 50, 4), 255, dtype=np.uint8)
    rgba[..., 0], rgba[..., 1] = steps % 251, (7 * steps) % 241
    rgba[:10, :, 3] = 0 if not many else 255
    root = drawn(lambda axes: axes.imshow(rgba, origin="lower", interpolation="none"))
    (element,) = root.iter(f"{SVG}image")
    data = base64.b64decode(element.get(LINK).partition(",")[2])
    found = np.asarray(Image.open(io.BytesIO(data)).convert("RGBA"))[::-1].astype(int)
    assert np.abs(found - rgba).max() <= (40 if many else 0)


def test_bands_have_the_colours_of_norm_and_map():
    values = np.linspace(-3.0, 9.0, 400).reshape(20, 20)
    for low, high in ((-3.0, 9.0), (-1.0, 9.0), (-3.0, 4.0), (-1.0, 4.0)):
        shown = np.stack([np.clip(values.ravel(), low, high), np.ones(400)])
        scale = panels.bands(
            np.hstack([shown, [[values.min(), values.max()], [1e-9, 1e-9]]]), "YlGnBu"
        )
        expected = ScalarMappable(scale["norm"], scale["cmap"]).to_rgba(values, bytes=True)
        image_of = values.copy()
        image_of[0, 0] = np.nan
        found = panels._coloured(image_of, scale)
        assert (found[0, 0] == 0).all()
        assert np.array_equal(found.reshape(-1, 4)[1:], expected.reshape(-1, 4)[1:])


@pytest.mark.parametrize("look", [{"linestyle": "dashed"}, {"linestyle": (0, (0.6, 2.2))}])
def test_lines_of_values_are_the_contours_of_matplotlib(look):
    rows, columns = 41, 60
    x, y = np.meshgrid(np.linspace(0.0, 6.0, columns), np.linspace(0.0, 4.0, rows))
    values = np.sin(x) * np.cos(y) + 0.1 * x
    values[10:14, 20:25] = np.nan
    levels = [-0.5, 0.0, 0.3, 7.0]
    low, high = np.array([0.0, 0.0]), np.array([6.0, 4.0])
    none = np.empty((0, 3))
    raster = Raster(low, high, (rows, columns), none, *(np.empty(0),) * 3, none, none)
    half, every = np.array([6.0 / columns, 4.0 / rows]) / 2, panels._EVERY

    def ours(axes):
        added = {"edgecolors": "black", "lw": 0.6, "ls": look["linestyle"]}
        panels.add_levels(axes, raster, values, levels, **added)
        axes.set(xlim=(0.0, 6.0), ylim=(0.0, 4.0))

    def theirs(axes):
        at = [half[k] * (1 + 2 * np.arange(0, (columns, rows)[k], every)) for k in (0, 1)]
        some = np.ma.masked_invalid(values[::every, ::every])
        for level in levels[:3]:
            axes.contour(*at, some, levels=[level], colors="black", linewidths=0.6,
                         linestyles=[look["linestyle"]])  # fmt: skip
        axes.set(xlim=(0.0, 6.0), ylim=(0.0, 4.0))

    found, expected = (
        [(p.get("d"), p.get("stroke-dasharray"), p.get("stroke-width")) for p in drawn(each).iter()]
        for each in (ours, theirs)
    )
    assert found == expected
    assert sum(dashes is not None for _, dashes, _ in found) > 0


def test_chained_lines_are_the_same_lines():
    rng = np.random.default_rng(3)
    nodes = rng.integers(0, 6, size=(60, 2, 2)).astype(float)
    ends = nodes[(nodes[:, 0] != nodes[:, 1]).any(axis=1)]
    chain = lines._chained(ends)
    pairs = np.stack([chain[:-1], chain[1:]], axis=1)
    pairs = pairs[np.isfinite(pairs).all(axis=(1, 2))]

    def key(each):
        return sorted(tuple(sorted(map(tuple, pair))) for pair in each.tolist())

    assert key(pairs) == key(ends)
    assert np.isnan(chain).any(axis=1).sum() < len(ends) / 2


def test_signs_are_those_of_the_structures_that_are_measured(plane):
    text = (CASES / "braced-pit" / "case.yaml").read_text(encoding="utf-8")
    table = replace(plane.gauges, gauges=("LC1",) * len(plane.gauges.gauges))
    (picture,) = sign_pictures(replace(plane, case_resolved=text, case_text=text, gauges=table))
    with drawing_style():
        said = {axes.get_title("left") for axes in picture.draw().axes}
    assert said == {"strut: compression"}


def test_an_axis_without_numbers_keeps_its_line_at_its_side():
    """matplotlib puts it there when it makes a tick, of which there is none."""
    with drawing_style(), lean_axes():
        figure = Figure(figsize=(3.0, 2.0))
        axes = figure.subplots()
        axes.plot([3.0, 4.0], [1.0, 2.0])
        axes.set_yticks([])
        canvas = SvgCanvas(figure, 150)
        canvas.written("", "")
        line = axes.spines.left.get_window_extent()
        box = axes.get_window_extent()
    assert line.x0 == pytest.approx(box.x0, abs=1e-6)
    assert len(axes.yaxis.majorTicks) <= 1


def test_numbers_at_many_places_are_one_tick():
    with drawing_style(), lean_axes():
        axes = Figure().subplots()
        axes.set_xticks(range(12), [f"stage {k}" for k in range(12)])
    assert len(axes.xaxis.majorTicks) == 1


def test_an_axis_that_grows_has_more_numbers():
    found = []
    for lean in (True, False):
        with drawing_style(), lean_axes() if lean else nullcontext():
            axes = Figure(figsize=(8, 3)).add_axes((0.1, 0.2, 0.1, 0.7))
            axes.plot([0, 1000], [0, 1])
            for width in (0.1, 0.8):
                axes.set_position((0.1, 0.2, width, 0.7))
                measures = SvgCanvas(axes.figure, 150).get_renderer()
                ticks = axes.xaxis._update_ticks()
                rooms = axes.xaxis._get_ticklabel_bboxes(ticks, measures)[0]
                assert not lean or len(rooms) == 1  # that of all together
                found.append(len(axes.xaxis._ticks[0][1] if lean else rooms))
    assert found[:2] == found[2:]
    assert found[0] < found[1]


def test_limits_are_asked_once_while_nothing_is_added(monkeypatch):
    """matplotlib asks at each place, and sorts the panels that share an axis each time."""
    asked, plain = [], Axes._unstale_viewLim

    def counted(axes):
        asked.append(axes)
        plain(axes)

    monkeypatch.setattr(Axes, "_unstale_viewLim", counted)
    with drawing_style(), lean_axes():
        figure = Figure(figsize=(6, 3))
        panels = figure.subplots(1, 3, sharey=True)
        for axes in panels:
            axes.plot([0, 1], [0, 1])
        canvas = SvgCanvas(figure, 150)
        figure.dpi = 72
        asked.clear()
        lay_out(figure)
        canvas.written("", "")
        assert len(asked) < 20 * len(panels)
        before = panels[0].get_xlim()
        panels[0].plot([5.0, 9.0], [0, 1])
        canvas.written("", "")
        assert panels[0].get_xlim()[1] > 9.0 > before[1]


def test_a_tick_is_not_asked_to_look_like_itself(monkeypatch):
    copied = []
    monkeypatch.setattr(Line2D, "update_from", lambda line, other: copied.append(other))
    with drawing_style(), lean_axes():
        figure = Figure()
        figure.subplots().plot([0, 1])
        SvgCanvas(figure, 150).written("", "")
    assert not copied

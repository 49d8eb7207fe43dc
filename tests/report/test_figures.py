"""Figures as an engineer wants them: nothing cut, nothing on top of another, equal scales."""

import io
import itertools
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.text import Text

from geoident.report.drawing.album import album, figure_files
from geoident.report.drawing.fields.panels import bands
from geoident.report.drawing.lines import add_segments
from geoident.report.drawing.overview import overview_figure, overview_pictures
from geoident.report.drawing.scene import Scene, scene_of
from geoident.report.drawing.signs import sign_pictures
from geoident.report.drawing.style import drawing_style, image
from geoident.report.text.case import gauge_quantity
from tests.support.pictures import laid_out
from tests.support.results import STAGES, changed_gauges, example_result, small_result

SLACK = 1.0  # pixels of 1/100 inch
NAMES = [
    ("plane", name)
    for name in ("overview", "parameters", "pairs", "readings-1", "extensometers-1",
                 "displacement",
                 "displacement-parts", "stress-minimum", "stress-maximum", "stress-crosses",
                 "yielded", "deformed", "vectors",
                 "one-to-one", "residuals", "history", "correlation")
] + [
    ("solid", name)
    for name in ("overview", "section-1-displacement", "section-2-deformed",
                 "section-2-vectors", "surface", "cut-away", "cut-away-deformed")
]  # fmt: skip


def visible_texts(figure):
    """Texts that are drawn: tick labels only inside the limits of their axis."""
    hidden = set()
    for axes in figure.axes:
        for axis in filter(None, (axes.xaxis, axes.yaxis, getattr(axes, "zaxis", None))):
            low, high = sorted(axis.get_view_interval())
            for tick in [*axis.get_major_ticks(), *axis.get_minor_ticks()]:
                if not low - 1e-9 <= tick.get_loc() <= high + 1e-9:
                    hidden |= {tick.label1, tick.label2}
                if not tick.label1.get_visible():
                    hidden.add(tick.label1)
                if not tick.label2.get_visible():
                    hidden.add(tick.label2)
    return [
        text
        for text in figure.findobj(Text)
        if text.get_text().strip() and text.get_visible() and text not in hidden
    ]


@cache
def boxes(figure):
    """Texts and where they stand; of the figures of a page, which several tests look at, once."""
    figure.set_layout_engine("none")
    figure.draw_without_rendering()
    return [(text, text.get_window_extent()) for text in visible_texts(figure)]


@pytest.mark.parametrize(("kind", "name"), NAMES)
def test_no_text_is_cut(kind, name, figures):
    figure = figures[kind][name]
    inside = figure.bbox.padded(SLACK)
    for text, box in boxes(figure):
        assert inside.contains(box.x0, box.y0), text.get_text()
        assert inside.contains(box.x1, box.y1), text.get_text()


@pytest.mark.parametrize(("kind", "name"), NAMES)
def test_no_text_lies_on_another(kind, name, figures):
    figure = figures[kind][name]
    found = [(text, box) for text, box in boxes(figure) if text.get_rotation() in (0, 90)]
    for (one, a), (other, b) in itertools.combinations(found, 2):
        width = min(a.x1, b.x1) - max(a.x0, b.x0)
        height = min(a.y1, b.y1) - max(a.y0, b.y0)
        apart = width < SLACK or height < SLACK
        assert apart, f"{one.get_text()!r} on {other.get_text()!r}"


@pytest.mark.parametrize(("kind", "name"), NAMES)
def test_slanted_names_of_stages_have_room(kind, name, figures):
    figure = figures[kind][name]
    for axes in figure.axes:
        labels = [label for label in axes.get_xticklabels() if label.get_rotation() not in (0, 90)]
        if len(labels) > 1 and name != "correlation":
            places = axes.transData.transform([(x, 0) for x in axes.get_xticks()])[:, 0]
            apart = np.diff(places).min() * np.sin(np.radians(labels[0].get_rotation()))
            assert apart > labels[0].get_fontsize() * figure.dpi / 72


@pytest.mark.parametrize(("kind", "name"), NAMES)
def test_axes_say_what_they_show_in_which_unit(kind, name, figures):
    figure = figures[kind][name]
    labels = " ".join(t.get_text() for t in visible_texts(figure))
    if name in ("correlation", "parameters", "pairs", "history", "residuals"):
        wanted = {"correlation": "correlation", "parameters": "E_rock (GPa)",
                  "pairs": "E_rock (GPa)", "history": "misfit",
                  "residuals": "standard deviation"}[name]  # fmt: skip
        assert wanted in labels
    else:
        assert "mm" in labels or "MPa, tension positive" in labels or "(m)" in labels


FIELDS = [pair for pair in NAMES if any(
    word in pair[1] for word in ("displacement", "stress", "yielded", "deformed", "vectors"))
    and "cut" not in pair[1]]  # fmt: skip


@pytest.mark.parametrize(("kind", "name"), FIELDS)
def test_fields_have_equal_scales(kind, name, figures):
    figure = figures[kind][name]
    panels = [axes for axes in figure.axes if axes.get_title(loc="left")]
    assert len(panels) >= 2
    for axes in panels:
        (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
        box = axes.get_window_extent()
        assert box.width / (x1 - x0) == pytest.approx(box.height / (y1 - y0), rel=1e-6)


def test_every_stage_has_its_panel_and_predictions_are_named(figures):
    panels = [axes.get_title(loc="left") for axes in figures["plane"]["displacement"].axes]
    assert panels[:3] == ["drift", "bench 1", "bench 2 (predicted)"]


def test_gauges_say_what_they_measure_in_which_direction(plane):
    gauges = "{CV-1: {kind: convergence}, ST-1: {kind: settlement}, EX-1: {kind: extensometer}}"
    named = replace(plane, case_resolved=f"gauges: {gauges}")
    (picture,) = [p for p in album(named).readings if p.name == "readings-1"]
    figure = laid_out(picture.draw)
    labels = {axes.get_title(loc="left"): axes.get_ylabel() for axes in figure.axes}
    assert labels == {
        "EX-1": "extension (mm)",
        "CV-1": "change of length (mm)",
        "ST-1": "settlement (mm, downwards)",
    }
    test_no_text_is_cut("named", "readings-1", {"named": {"readings-1": figure}})


def test_a_gauge_of_a_displacement_names_its_component(plane):
    along = replace(plane, case_resolved="gauges: {P: {kind: displacement, component: x}, Q: []}")
    assert gauge_quantity(along, "P") == "displacement x (mm)"
    assert gauge_quantity(along, "Q") == gauge_quantity(plane, "R") == "displacement (mm)"


def test_the_magnification_is_stated_and_true(plane):
    scene = Scene(plane, plane.fields)
    (picture,) = [p for p in album(plane).fields if p.name == "deformed"]
    factor = scene.magnification(scene.views[0].window.size)
    assert f"{factor:g} times magnified" in picture.title
    xy = picture.draw().axes[1].lines[-1].get_xydata()
    drawn = xy[np.isfinite(xy).all(axis=1)]
    points, moved = plane.fields.mesh.points, plane.fields.displacement[-1]
    expected = points + factor * moved
    gone = np.setdiff1d(np.arange(len(points)), np.unique(
        plane.fields.mesh.blocks[0].nodes[plane.fields.present[-1]]))  # fmt: skip
    distance = np.linalg.norm(drawn[:, None] - expected[None], axis=2)
    assert distance.min(axis=1).max() < 1e-9
    assert not set(distance.argmin(axis=1)) & set(gone.tolist())
    assert len(gone)


def test_colours_do_not_follow_single_extremes():
    values = np.stack([np.r_[np.linspace(0, 10, 999), 1e6], np.ones(1000)])
    values[1, -1] = 0.1
    scale = bands(values, "YlGnBu")
    assert scale["levels"][-1] <= 10
    assert scale["extend"] == "max"


def test_dark_is_far_from_zero():
    def darkness(scale, value):
        return 1 - np.mean(scale["cmap"](scale["norm"](value))[:3])

    compression = bands(np.array([[-20.0, -1.0], [1.0, 1.0]]), "YlOrBr")
    assert darkness(compression, -19.0) > darkness(compression, -2.0)
    length = bands(np.array([[0.0, 20.0], [1.0, 1.0]]), "YlGnBu")
    assert darkness(length, 19.0) > darkness(length, 1.0)
    both = bands(np.array([[-5.0, 4.0], [1.0, 1.0]]), "YlOrBr")
    assert darkness(both, -4.0) > darkness(both, 0.0)
    assert darkness(both, 4.0) > darkness(both, 0.0)


@pytest.mark.parametrize(
    ("suffix", "name"), [("svg", "deformed"), ("png", "residuals"), ("pdf", "one-to-one")]
)
def test_the_same_result_gives_the_same_file(name, suffix, plane):
    (picture,) = [p for p in album(plane).all if p.name == name]
    first, second = image(picture, suffix), image(picture, suffix)
    assert first == second
    assert len(first) > 5000


def test_a_matplotlibrc_of_the_user_changes_nothing(plane):
    (picture,) = [p for p in album(plane).all if p.name == "history"]
    plain = image(picture, "svg")
    with rc_context({"font.size": 20, "axes.grid": True, "svg.fonttype": "none"}):
        assert image(picture, "svg") == plain


def test_pictures_are_not_blank(plane):
    (picture,) = [p for p in album(plane).all if p.name == "deformed"]
    pixels = imread(io.BytesIO(image(picture, "png")))[..., :3]
    assert (pixels < 0.95).any(axis=2).mean() > 0.2


@pytest.mark.usefixtures("plain_pictures")
def test_files_are_named_by_figure_and_result():
    scan = small_result()
    one = figure_files([("a", scan)], ["png"])
    assert "scan.png" in one
    assert all(content.startswith(b"\x89PNG") for content in one.values())
    names = set(figure_files([("a", scan), ("b", scan)], ["svg"]))
    assert {"1-scan.svg", "2-scan.svg", "compared-parameters.svg"} <= names


def test_long_names_and_many_stages_stay_readable():
    base = example_result(2)
    long = tuple(f"a stage of construction with the number {k}" for k in range(18))
    table = base.gauges

    def wide(array):
        return np.repeat(array, 6, axis=1)

    many = changed_gauges(
        table, stages=long, measured=wide(table.measured), computed=wide(table.computed),
        sd=wide(table.sd), used=wide(table.used), bad=wide(table.bad),
        channels=tuple(name.replace("EX-1", "a-gauge-with-a-long-name") for name in table.channels),
    )  # fmt: skip
    result = replace(base, gauges=many, fields=None, prediction=None, history=())
    for picture in album(result).all:
        if picture.name.startswith(("readings", "residuals")):
            figure = laid_out(picture.draw)
            test_no_text_is_cut("many", picture.name, {"many": {picture.name: figure}})
            test_slanted_names_of_stages_have_room(
                "many", picture.name, {"many": {picture.name: figure}}
            )


def test_stages_are_those_of_the_result(plane):
    assert plane.gauges.stages == STAGES


def test_signs_are_drawn_for_the_gauges_of_forces_that_there_are(plane):
    assert sign_pictures(plane) == ()
    text = f"gauges: {{{plane.gauges.gauges[0]}: {{kind: load-cell, structure: nails}}}}"
    (picture,) = sign_pictures(replace(plane, case_resolved=text))
    titles = [axes.get_title() for axes in picture.draw().axes if axes.get_title()]
    assert titles == ["bolt, anchor: tension", "strut: compression", "beam: N, M, Q"]


def test_the_overview_says_which_gauges_it_shows_and_is_wider_than_high(plane):
    table = plane.gauges
    count = len(set(table.gauges))
    (picture,) = overview_pictures(plane, None)
    assert "gauges the" not in picture.caption  # all are there
    more = tuple(f"{k}{name}" for k in range(4) for name in table.channels)
    arrays = ("measured", "computed", "sd", "used", "first", "second", "bad")
    many = changed_gauges(
        table, channels=more, **{k: np.concatenate([getattr(table, k)] * 4) for k in arrays}
    )
    (picture,) = overview_pictures(replace(plane, gauges=many), None)
    assert f"Of {4 * count} gauges the 6 with the largest computed readings" in picture.caption
    with drawing_style():
        width, height = overview_figure(plane, scene_of(plane)).get_size_inches()
    assert height < width


def test_lines_that_meet_are_drawn_as_one_and_are_the_same_lines():
    rng = np.random.default_rng(3)
    nodes = rng.integers(0, 6, size=(60, 2, 2)).astype(float)
    ends = nodes[(nodes[:, 0] != nodes[:, 1]).any(axis=1)]
    axes = Figure().subplots()
    add_segments(axes, ends, (np.zeros(2), np.full(2, 6.0)))
    (line,) = axes.lines
    chain = line.get_xydata()
    pairs = np.stack([chain[:-1], chain[1:]], axis=1)
    pairs = pairs[np.isfinite(pairs).all(axis=(1, 2))]

    def key(each):
        return sorted(tuple(sorted(map(tuple, pair))) for pair in each.tolist())

    assert key(pairs) == key(ends)
    assert np.isnan(chain).any(axis=1).sum() < len(ends) / 2

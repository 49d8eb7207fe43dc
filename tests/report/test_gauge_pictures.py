"""Readings by instrument: which channels lie on one line, and how each kind is drawn."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.text import Text

from geoident.model.gauges import ReadingTable
from geoident.model.results.bands import NORMAL_95, Prediction
from geoident.report.drawing.gauges.axis import computed_of, stage_axis
from geoident.report.drawing.gauges.course import face_pictures, reading_pictures, readings_figure
from geoident.report.drawing.gauges.curves import curve_pictures
from geoident.report.drawing.gauges.profiles import profile_pictures, profiles_figure
from geoident.report.drawing.quality import residual_figure
from geoident.report.drawing.style import drawing_style
from geoident.report.text.instruments import PLUMB, TROUGH, instruments, lines
from tests.report import test_figures
from tests.support.pictures import laid_out
from tests.support.results import example_result, wide_gauges

STAGES = ("dig", "line", "later")
DATES = "dates: {dig: 2024-01-10, line: 2024-02-01, later: 2024-03-20}\n"
DAY = 86400.0


def result_of(points, gauges, *, first=None, values=None, dates="", dim=2):
    """A result with one channel a point: read and used at two stages, predicted at the third.

    Args:
        points: name of the channel to its place.
        gauges: what the case says of the gauges, YAML.
        first: reference point of all of them.
        values: (n, 3) computed, m.
        dates: lines of the case.
        dim: of the points.
    """
    n = len(points)
    if values is None:
        values = 1e-3 * np.arange(1, 3 * n + 1, dtype=float).reshape(n, 3)
    measured = values + 1e-4
    used = np.tile([True, True, False], (n, 1))
    sd = np.full(values.shape, 2e-4)
    base = np.full((n, dim), np.nan) if first is None else np.tile(first, (n, 1)).astype(float)
    table = wide_gauges(
        tuple(points), STAGES, measured, values, sd=sd, used=used, first=base,
        second=np.array(list(points.values()), dtype=float),
    )  # fmt: skip
    mean = np.where(used, np.nan, values)
    prediction = Prediction(mean, 0.0 * mean + 1e-3, mean - 4e-3, mean + 2e-3)
    case = f"{dates}gauges: {gauges}"
    return replace(
        example_result(2), gauges=table, prediction=prediction, case_resolved=case, fields=None,
        members=None, diagnostics=None,
    )  # fmt: skip


SETTLEMENTS = "{A: {kind: settlement}, B: {kind: settlement}, C: {kind: settlement}}"
SURFACE = {"B": (5.0, 0.0), "A": (-10.0, 0.0), "C": (20.0, 0.0)}


def inside(axes, artist_values, which):
    low, high = sorted(axes.get_xlim() if which == "x" else axes.get_ylim())
    return low <= np.min(artist_values) and np.max(artist_values) <= high


@pytest.fixture(scope="module")
def trough():
    return result_of(SURFACE, SETTLEMENTS)


def test_gauges_of_a_load_test_are_drawn_over_the_load():
    """The case names the load of each stage; one without has no place. Others stay over stages."""
    curves = "{read: settlement of the head, over: load, gauges: {pile 3: B}, downwards: true, "
    curves += "stages: {dig: 500 kN, later: 2 MN}}"
    given = result_of(SURFACE, f"{SETTLEMENTS}\nreport: {{curves: [{curves}]}}")
    (picture,) = curve_pictures(given)
    (axes,) = laid_out(picture.draw).axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("load (kN)", "settlement of the head (mm)")
    assert axes.yaxis_inverted()
    drawn = [line.get_xydata() for line in axes.get_lines() if line.get_marker() == "None"]
    every = np.vstack([xy for xy in drawn if len(xy) > 1 and np.abs(xy[:, 1]).any()])
    here = every[np.isfinite(every).all(axis=1)]
    np.testing.assert_allclose(here, [[500.0, 1.0], [2000.0, 3.0]])  # none for 'line'
    (over_stages,) = reading_pictures(given)
    assert "pile 3" not in [text.get_text() for text in laid_out(over_stages.draw).findobj(Text)]


def test_settlements_at_one_level_are_a_trough_along_the_surface_with_settlement_down(trough):
    (one,) = [each for each in lines(trough) if each.line == TROUGH]
    assert (one.labels, one.places, one.along) == (("A", "B", "C"), (-10.0, 5.0, 20.0), "x (m)")
    (picture,) = profile_pictures(trough)
    assert picture.name == "troughs-1"
    (axes,) = laid_out(picture.draw).axes
    assert axes.yaxis_inverted()
    assert not axes.xaxis_inverted()
    computed = [line for line in axes.get_lines() if line.get_linestyle() in ("-", "--")]
    stages = [line for line in computed if len(line.get_xdata()) == 3]
    assert len(stages) == 3  # one line a stage
    np.testing.assert_allclose(stages[0].get_ydata(), [4.0, 1.0, 7.0])  # A, B, C after dig
    assert [line.get_linestyle() for line in stages] == ["-", "-", "--"]


def test_gauges_on_no_line_have_no_profile():
    apart = {"A": (0.0, 0.0), "B": (5.0, 1.0), "C": (9.0, 2.0)}
    assert lines(result_of(apart, SETTLEMENTS)) == ()


def test_displacements_against_one_point_below_them_are_a_plumb_line():
    points = {"A": (3.0, 69.0), "B": (3.0, 45.0), "C": (3.0, 20.0)}
    kinds = SETTLEMENTS.replace("settlement", "displacement, component: x")
    given = result_of(points, kinds, first=(3.0, 2.0))
    (one,) = [each for each in lines(given) if each.line == PLUMB]
    assert (one.labels, one.fixed) == (("C", "B", "A"), 2.0)
    (axes,) = laid_out(lambda: profiles_figure(given, [one])).axes
    first = next(line for line in axes.get_lines() if len(line.get_xdata()) == 4)
    np.testing.assert_allclose(first.get_ydata(), [2.0, 20.0, 45.0, 69.0])
    np.testing.assert_allclose(first.get_xdata(), [0.0, 7.0, 4.0, 1.0])
    assert not axes.yaxis_inverted()


def test_the_depth_of_an_inclinometer_goes_down():
    points = {f"I.A{depth}": (0.0, -float(depth)) for depth in (0, 5, 10)}
    given = result_of(points, "{I: {kind: inclinometer}}")
    (picture,) = profile_pictures(given)
    assert picture.name == "inclinometers-1"
    (axes,) = laid_out(picture.draw).axes
    assert axes.yaxis_inverted()
    assert axes.get_ylabel() == "depth along the casing (m)"
    for each in (picture, *reading_pictures(given)):
        shown = {"plane": {each.name: laid_out(each.draw)}}
        test_figures.test_no_text_is_cut("plane", each.name, shown)
        test_figures.test_no_text_lies_on_another("plane", each.name, shown)


def test_instruments_of_one_quantity_share_their_scale_and_nothing_is_cut(trough):
    many = {f"{name}{k}": (k, 3.0 * k) for k in range(4) for name in ("A",)}
    kinds = "{" + ", ".join(f"{name}: {{kind: convergence}}" for name in many) + "}"
    values = 1e-3 * np.array([[1, 2, 3], [10, 20, 30], [-5, -6, -7], [0, 0, 1]], dtype=float)
    given = result_of(many, kinds, values=values)
    figure = laid_out(lambda: readings_figure(given, instruments(given)))
    panels = [axes for axes in figure.axes if axes.get_title(loc="left")]
    assert len({axes.get_ylim() for axes in panels}) == 1
    table, prediction = given.gauges, given.prediction
    for row, axes in enumerate(panels):
        assert inside(axes, 1e3 * np.array(values[row]), "y")
        bars = 1e3 * (table.measured[row] + NORMAL_95 * np.outer([-1, 1], table.sd[row]))
        assert inside(axes, bars, "y")
        ends = [prediction.lower95[row], prediction.upper95[row]]
        assert inside(axes, 1e3 * np.array(ends)[:, 2], "y")
    assert max(panels[0].get_ylim()) < 40.0


def reach_of_bars(axes):
    """Half lengths of all bars of errors, in the unit of the picture."""
    bars = [each.lines[2][0] for each in axes.containers]
    return np.concatenate([
        0.5 * np.ptp(np.array(bar.get_segments()), axis=1).max(axis=1) for bar in bars
    ])  # fmt: skip


def test_bars_at_readings_are_half_their_95_percent_interval(trough):
    """1.96 standard deviations of 0.2 mm, over stages, at dates and along a line."""
    dated = replace(trough, case_resolved=DATES + trough.case_resolved)
    for result in (trough, dated):
        (axes, *_) = laid_out(reading_pictures(result)[0].draw).axes
        found = reach_of_bars(axes)
        assert len(found)
        np.testing.assert_allclose(found, 1.96 * 0.2, rtol=1e-4)
    (picture,) = profile_pictures(trough)
    found = np.concatenate([reach_of_bars(axes) for axes in laid_out(picture.draw).axes])
    assert len(found)
    np.testing.assert_allclose(found, 1.96 * 0.2, rtol=1e-4)


def test_dated_readings_stand_at_their_dates_and_stages_where_they_are_complete(trough):
    given = replace(trough, case_resolved=DATES + trough.case_resolved)
    axis = stage_axis(given)
    assert axis.dated
    np.testing.assert_allclose(np.diff(axis.at), [22.0, 48.0])
    table = given.gauges.readings
    late = replace(given.gauges, readings=_dated(table, 3.0 * DAY + DAY * axis.at[0]))
    given = replace(given, gauges=late)
    with drawing_style():  # labels of all ticks, which axes of pages have in one
        figure = reading_pictures(given)[0].draw()
        figure.draw_without_rendering()
    (axes,) = [each for each in figure.axes if each.get_title(loc="left")]
    dots = [line for line in axes.get_lines() if line.get_marker() == "o"]
    assert dots[0].get_xdata()[0] == pytest.approx(axis.at[0] + 3.0)
    assert inside(axes, axis.at, "x")
    assert axes.yaxis_inverted()  # settlements go down over time, too
    labels = [label.get_text() for label in axes.get_xticklabels()]
    assert labels == ["2024-02-01", "2024-03-01"]
    assert not stage_axis(trough).dated


def _dated(table: ReadingTable, time: float) -> ReadingTable:
    """All readings of the first stage at one time."""
    times = np.array([time if stage == STAGES[0] else np.nan for stage in table.stage])
    return replace(table, time=times)


def test_a_legend_names_only_what_is_drawn(trough):
    def words(result):
        figure = laid_out(lambda: readings_figure(result, instruments(result)))
        return {text.get_text() for text in figure.legends[0].get_texts()}

    every = {"measured", "measured, not used", "computed", "predicted", "95 % band"}
    assert words(trough) == every
    assert words(replace(trough, prediction=None)) == every - {"95 % band"}
    used = np.ones_like(trough.gauges.used)
    table = trough.gauges
    all_used = wide_gauges(
        table.channels, STAGES, table.measured, table.computed, sd=table.sd, used=used,
        first=table.first, second=table.second,
    )  # fmt: skip
    assert words(replace(trough, prediction=None, gauges=all_used)) == {"measured", "computed"}


def test_a_prediction_is_drawn_at_the_middle_that_its_band_is_given_around(trough):
    shifted = replace(trough.prediction, mean=trough.prediction.mean + 5e-4)
    given = replace(trough, prediction=shifted)
    np.testing.assert_allclose(computed_of(given)[:, 2], trough.gauges.computed[:, 2] + 5e-4)
    np.testing.assert_array_equal(computed_of(given)[:, :2], trough.gauges.computed[:, :2])


def test_convergences_of_a_tunnel_stand_over_the_way_of_its_face():
    """Three rounds of 4 m along y; the section at y = 6 m is passed by -2, 2 and 6 m."""
    solid = example_result(3)
    mesh, fields = solid.fields.mesh, solid.fields
    centre = mesh.points[mesh.blocks[0].nodes].mean(axis=1)
    hole = (np.abs(centre[:, 0] - 10.0) < 2.0) & (np.abs(centre[:, 2] - 10.0) < 2.0)
    present = np.ones_like(fields.present)
    for stage in (1, 2, 3):
        present[stage:, hole & (centre[:, 1] < 4.0 * stage)] = False
    given = result_of({"CV": (8.0, 6.0, 10.0)}, "{CV: {kind: convergence}}", dim=3)
    driven = replace(given, fields=replace(fields, present=present))
    (picture,) = face_pictures(driven)
    (axes,) = laid_out(picture.draw).axes
    dots = np.concatenate([x.get_xdata() for x in axes.get_lines() if x.get_marker() == "o"])
    np.testing.assert_allclose(np.sort(dots), [-2.0, 2.0, 6.0])
    assert axes.get_xlabel() == "face past the section (m)"
    assert face_pictures(given) == ()
    backwards = replace(fields, present=present[::-1])
    assert face_pictures(replace(given, fields=backwards)) == ()


def test_the_stage_of_an_outlier_is_named_at_its_own_dot(trough):
    """B is off by 6 sd at dig and by -5 at later, which was written at the dot of dig."""
    gauges = trough.gauges
    measured = gauges.computed + 2e-4 * np.array([[6, 0, -5], [0, 1, 0], [0, -4, 0]], dtype=float)
    table = wide_gauges(
        gauges.channels, STAGES, measured, gauges.computed, sd=gauges.sd, used=gauges.used,
        first=gauges.first, second=gauges.second,
    )  # fmt: skip
    given = replace(trough, gauges=table, prediction=None)
    figure = laid_out(lambda: residual_figure(given))
    (axes,) = figure.axes
    rows = {name: k for k, name in enumerate(gauges.channels)}
    for channel, stage, x in (("B", "dig", 6.0), ("B", "later", -5.0), ("C", "line", -4.0)):
        dot = axes.transData.transform((x, rows[channel]))
        distance = [
            np.hypot(*(np.array(_middle(text.get_window_extent())) - dot) * [0.3, 1.0])
            for text in axes.texts + [a for a in axes.artists if isinstance(a, Text)]
            if text.get_text() == stage
        ]
        assert min(distance) < 12.0, (channel, stage, distance)


def _middle(box):
    return 0.5 * (box.x0 + box.x1), 0.5 * (box.y0 + box.y1)

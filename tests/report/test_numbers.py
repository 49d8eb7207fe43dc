"""Numbers read back from the figures of a page are those of the result, in the units shown."""

import numpy as np
import pytest
from matplotlib.quiver import Quiver

from geoident.report.drawing.album import album, comparison
from geoident.report.drawing.scene import Scene
from tests.support.pictures import laid_out
from tests.support.results import example_result

MM = 1e3


@pytest.fixture(scope="module")
def result():
    return example_result(2)


@pytest.fixture(scope="module")
def panels(result):
    """Axes of a figure by its name and their titles."""

    def of(name):
        (picture,) = [picture for picture in album(result).all if picture.name == name]
        return {
            axes.get_title(loc="left") or axes.get_ylabel(): axes
            for axes in laid_out(picture.draw).axes
        }

    return of


def dots(axes, marker):
    """Points (k, 2) of the lines with a marker."""
    lines = [line for line in axes.get_lines() if line.get_marker() == marker]
    return np.concatenate([line.get_xydata() for line in lines])


def curve(axes):
    """Points (k, 2) of the solid and dashed lines without markers, without repeated ones."""
    lines = [
        line for line in axes.get_lines()
        if line.get_marker() in ("", "None") and line.get_linestyle() in ("-", "--")
        and line.get_lw() == 1.2
    ]  # fmt: skip
    points = np.concatenate([line.get_xydata() for line in lines])
    return np.unique(points[np.isfinite(points).all(axis=1)], axis=0)


@pytest.mark.parametrize("name", ["overview", "readings-1"])
def test_gauges_over_the_stages_are_measured_and_computed_in_millimetres(name, result, panels):
    table = result.gauges
    shown = panels(name)
    for channel in ("CV-1", "ST-1"):
        row, axes = table.channels.index(channel), shown[channel]
        seen, stages = dots(axes, "o"), np.flatnonzero(np.isfinite(table.measured[row]))
        np.testing.assert_array_equal(np.sort(seen[:, 0]), stages)
        np.testing.assert_allclose(
            seen[np.argsort(seen[:, 0]), 1], MM * table.measured[row, stages], rtol=1e-12
        )
        known = np.isfinite(table.computed[row])
        if np.isinf(result.prediction.sd[row, 2]):
            known[2] = False  # predicted without being determined
        expected = np.column_stack([np.flatnonzero(known), MM * table.computed[row, known]])
        np.testing.assert_allclose(curve(axes), expected, rtol=1e-12)


def test_computed_stands_over_measured_and_hollow_dots_are_not_used(result, panels):
    table, (axes,) = result.gauges, panels("one-to-one").values()
    for line in axes.get_lines()[:2]:
        used = line.get_markerfacecolor() != "white"
        chosen = np.isfinite(table.measured) & (table.used == used)
        chosen &= ~np.isinf(result.prediction.sd)
        expected = MM * np.column_stack([table.measured[chosen], table.computed[chosen]])
        np.testing.assert_allclose(line.get_xydata(), expected, rtol=1e-12)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("measured (mm)", "computed (mm)")


def test_residuals_are_measured_less_computed_in_standard_deviations(result, panels):
    table, (axes,) = result.gauges, panels("residuals").values()
    predicted = result.prediction.sd  # of a reading that is predicted, its own error included
    sd = np.where(np.isnan(predicted), table.sd, predicted)
    residual = np.where(np.isinf(sd), np.nan, (table.measured - table.computed) / sd)
    marked = [line for line in axes.get_lines() if line.get_marker() == "o"]
    for y, label in enumerate(axes.get_yticklabels()):
        row = table.channels.index(label.get_text())
        for used in (True, False):
            face = [line for line in marked if (line.get_markerfacecolor() != "white") == used]
            seen = np.concatenate([line.get_xydata() for line in face])
            expected = residual[row, (table.used[row] == used) & np.isfinite(residual[row])]
            np.testing.assert_allclose(np.sort(seen[seen[:, 1] == y, 0]), np.sort(expected))


def test_the_search_is_drawn_trial_by_trial(result, panels):
    misfit, traces = panels("history").values()
    accepted, rejected = misfit.get_lines()
    np.testing.assert_allclose(accepted.get_xydata(), [[0, 900.0], [2, 40.0], [3, 12.5]])
    np.testing.assert_allclose(rejected.get_xydata(), [[1, 950.0]])
    rock = next(line for line in traces.get_lines() if line.get_label() == "E_rock")
    np.testing.assert_allclose(rock.get_ydata(), np.array([2e10, 1.3e10, 1.234e10]) / 1.234e10)


def test_correlations_are_those_of_the_table_and_a_dash_is_not_determined(result, panels):
    axes = next(iter(panels("correlation").values()))
    shown = np.array([text.get_text() for text in axes.texts]).reshape(3, 3)
    assert shown.tolist() == [["1.00", "-", "-0.80"], ["-", "-", "-"], ["-0.80", "-", "1.00"]]
    known = np.isfinite(result.parameters.correlation)
    np.testing.assert_array_equal(
        np.ma.filled(axes.images[0].get_array(), np.nan)[known],
        result.parameters.correlation[known],
    )


def test_estimates_stand_at_their_values_between_the_ends_of_their_intervals(result, panels):
    for name, axes in zip(result.parameters.names, panels("parameters").values(), strict=True):
        row = result.parameters.names.index(name)
        table, size = result.parameters, {"E_rock": 1e9, "sigma_v": 1e6, "K0": 1.0}[name]
        estimate = [line for line in axes.get_lines() if line.get_marker() == "o"]
        assert bool(estimate) == table.determined[row]
        if estimate:
            assert estimate[0].get_xdata() == pytest.approx([table.values[row] / size])
            (bar,) = [line for line in axes.get_lines() if line.get_lw() == 1.8]
            ends = np.array([table.lower95[row], table.upper95[row]]) / size
            assert bar.get_xdata() == pytest.approx(ends)


def test_arrows_at_the_gauges_are_their_motion_on_one_scale(result, panels):
    nodes, displacement = result.fields.mesh.points, result.fields.displacement
    lengths = []
    for title, axes in panels("vectors").items():
        state = 1 + result.gauges.stages.index(title.replace(" (predicted)", ""))
        (arrows,) = [each for each in axes.collections if isinstance(each, Quiver)]
        drawn = np.column_stack([arrows.U, arrows.V])
        distance = np.linalg.norm(nodes[None] - arrows.get_offsets()[:, None], axis=2)
        at_node = distance.min(axis=1) < 1e-9
        moved = displacement[state] - displacement[0]
        expected = MM * moved[distance.argmin(axis=1)[at_node]]
        scale = np.linalg.norm(drawn[at_node]) / np.linalg.norm(expected)
        np.testing.assert_allclose(drawn[at_node], scale * expected, atol=1e-9 * scale)
        lengths.append(scale)
        (words,) = [text for text in axes.texts if text.get_text().endswith("mm ")]
        part = 1.0 - words.xy[0]  # the arrow of the scale, of the width of the panel
        size = float(words.get_text().split()[0])
        assert part * np.ptp(axes.get_xlim()) == pytest.approx(scale * size, rel=1e-6)
    assert lengths == pytest.approx([lengths[0]] * len(lengths))


def test_the_size_of_the_displacement_is_that_of_the_nodes_in_millimetres(result):
    (view,) = Scene(result, result.fields).views
    moved = result.fields.displacement[3] - result.fields.displacement[1]
    expected = MM * np.linalg.norm(moved, axis=1)
    at = np.linalg.norm(view.sheet.xy[:, None] - result.fields.mesh.points[None], axis=2)
    drawn = view.displacement_size(3, since=1)
    nodes = at.min(axis=1) < 1e-9
    np.testing.assert_allclose(drawn[nodes], expected[at.argmin(axis=1)[nodes]], atol=1e-12)


def test_results_side_by_side_have_their_own_lines_and_the_dots_of_the_first(result):
    pictures = comparison([("first", result), ("second", example_result(2))])
    (gauges,) = [picture for picture in pictures if picture.name.startswith("compared-gauges")]
    shown = {axes.get_title(loc="left"): axes for axes in laid_out(gauges.draw).axes}
    row = result.gauges.channels.index("CV-1")
    lines = [line for line in shown["CV-1"].get_lines() if line.get_lw() == 1.2]
    assert len(lines) == 2
    for line in lines:
        np.testing.assert_allclose(line.get_ydata(), MM * result.gauges.computed[row])
    read = np.isfinite(result.gauges.measured[row])
    np.testing.assert_allclose(
        np.sort(dots(shown["CV-1"], "o")[:, 1]), np.sort(MM * result.gauges.measured[row, read])
    )

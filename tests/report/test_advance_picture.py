"""The picture of a tunnel face that goes on."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.text import Text

from geoident.report.drawing.album import album
from geoident.report.drawing.opening import advance_pictures
from geoident.report.drawing.style import drawing_style, image
from tests.io.result.conftest import make_advance
from tests.support.results import small_result


@pytest.fixture(scope="module")
def picture():
    result = replace(small_result(), advance=make_advance())
    (found,) = advance_pictures(result)
    assert found.name in [one.name for one in album(result).readings]
    return found


def test_the_stages_stand_on_the_profile_with_what_they_release(picture):
    with drawing_style():
        figure = picture.draw()
        figure.draw_without_rendering()
    (axes,) = figure.axes
    curve, dots, squares, _, zero = axes.get_lines()[:5]
    np.testing.assert_allclose(curve.get_xydata(), [[0.0, 25.0], [2.0, 82.5], [8.0, 97.73]])
    np.testing.assert_allclose(dots.get_xydata(), [[2.0, 82.5], [8.0, 97.73]])
    np.testing.assert_allclose(squares.get_xydata(), [[2.0, 90.0], [8.0, 99.0]])
    assert list(zero.get_xdata()) == [2.0, 2.0]
    (lost,) = axes.patches
    assert lost.get_extents().transformed(axes.transData.inverted()).y1 == pytest.approx(82.5)
    assert {"first reading", "far on"} <= {text.get_text() for text in axes.findobj(Text)}
    assert axes.get_xlabel() == "section behind the face (m)"


def test_what_was_lost_is_said(picture):
    assert "82.5 % of the motion before the first gauges read zero" in picture.caption
    assert b"<svg" in image(picture, "svg")[:600]
    never = replace(make_advance(), stage_zero=np.array([False, False]))
    (other,) = advance_pictures(replace(small_result(), advance=never))
    assert "read zero" not in other.caption


def test_other_results_have_no_face():
    assert advance_pictures(small_result()) == ()

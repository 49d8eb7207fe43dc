"""The pictures of an opening in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.patches import Circle
from matplotlib.text import Text

from geoident.report.drawing.album import album
from geoident.report.drawing.opening import opening_pictures
from tests.io.result.conftest import make_reaction
from tests.support.pictures import laid_out
from tests.support.results import small_result


@pytest.fixture(scope="module")
def drawn():
    result = replace(small_result(), reaction=make_reaction())
    pictures = {picture.name: picture for picture in opening_pictures(result)}
    assert [p.name for p in album(result).fields][:2] == list(pictures)
    return {name: laid_out(picture.draw) for name, picture in pictures.items()}


def test_the_sketch_has_the_opening_what_yields_and_the_stress(drawn):
    (axes,) = drawn["opening"].axes
    circles = sorted(p.radius for p in axes.patches if isinstance(p, Circle))
    assert circles == [2.5, 4.5]
    said = {text.get_text() for text in axes.findobj(Text)}
    assert {"xx 10 MPa", "yy 12 MPa", "a = 2.5 m", "R = 4.5 m"} <= said


def test_the_reaction_has_the_stages_on_its_curve(drawn):
    left, middle, right = drawn["ground-reaction"].axes
    curve, dots = left.get_lines()[:2]
    np.testing.assert_allclose(curve.get_xydata(), [[0.0, 11.0], [2.0, 4.0], [9.0, 0.0]])
    np.testing.assert_allclose(dots.get_xydata(), [[1.0, 6.0], [9.0, 0.0]])
    assert {"face", "far on"} <= {text.get_text() for text in left.findobj(Text)}
    np.testing.assert_allclose(middle.get_lines()[1].get_xydata(), [[4.5, 0.0]])
    assert right.get_ylabel() == "stress (MPa, compression)"
    assert left.get_xlabel() == "wall inwards (mm)"


def test_other_results_have_no_opening():
    assert opening_pictures(small_result()) == ()

"""The pictures of an opening in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.patches import Circle
from matplotlib.text import Annotation, Text

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


def test_stresses_press_on_the_ground_and_are_in_kilopascal_where_it_is_soft(drawn):
    def arrows(axes):
        """How far from the centre, and how much nearer it the head is than the tail."""
        found = [note for note in axes.texts if isinstance(note, Annotation)
                 and note.arrowprops and not note.get_text()]  # fmt: skip
        ends = np.array([[note.xyann, note.xy] for note in found]) - [1.0, -2.0]
        return np.diff(np.abs(ends).max(axis=2), axis=1).ravel()

    inwards = arrows(drawn["opening"].axes[0])
    assert len(inwards) == 12
    assert (inwards < 0.0).all()
    pulled = replace(make_reaction(), in_situ=np.array([-1e5, -2e5, 0.0, 0.0]))
    (sketch, reaction) = (
        laid_out(one.draw) for one in opening_pictures(replace(small_result(), reaction=pulled))
    )
    (axes,) = sketch.axes
    assert (arrows(axes) > 0.0).all()
    said = {text.get_text() for text in axes.findobj(Text)}
    assert {"xx -100 kPa", "yy -200 kPa"} <= said
    curve = reaction.axes[0].get_lines()[0]
    np.testing.assert_allclose(curve.get_ydata(), [11000.0, 4000.0, 0.0])
    assert reaction.axes[0].get_ylabel() == "pressure inside (kPa)"


def test_the_reaction_has_the_stages_on_its_curve(drawn):
    left, middle, right = drawn["ground-reaction"].axes
    curve, dots = left.get_lines()[:2]
    np.testing.assert_allclose(curve.get_xydata(), [[0.0, 11.0], [2.0, 4.0], [9.0, 0.0]])
    np.testing.assert_allclose(dots.get_xydata(), [[1.0, 6.0], [9.0, 0.0]])
    assert {"face", "far on"} <= {text.get_text() for text in left.findobj(Text)}
    np.testing.assert_allclose(middle.get_lines()[1].get_xydata(), [[4.5, 0.0]])
    assert right.get_ylabel() == "stress (MPa, compression)"
    around, radial, *_, mean = right.get_lines()
    np.testing.assert_allclose(around.get_xydata(), [[2.5, 16.0], [5.0, 13.0], [10.0, 11.0]])
    np.testing.assert_allclose(radial.get_ydata(), [6.0, 8.0, 10.0])
    assert radial.get_linestyle() == "--"
    np.testing.assert_allclose(mean.get_ydata(), 11.0)  # half of xx and yy, far from the opening
    assert left.get_xlabel() == "wall inwards (mm)"


def test_other_results_have_no_opening():
    assert opening_pictures(small_result()) == ()

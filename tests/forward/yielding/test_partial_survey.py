"""What is known where a stage collapses: all that does not build on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import displacement, material, model
from support.meshes import box

from geoident.errors import CollapseError
from geoident.model.actions import Traction
from geoident.model.case import Stage, Support
from geoident.model.parameter import Scalar
from geoident.model.yielding import MohrCoulomb

COHESION = 1e6


def _press(name, pressure, **more):
    load = Traction("y1", (Scalar(0.0), Scalar(-pressure)))
    return Stage(name, loads={"press": load}, **more)


def _column(*stages):
    """A block of Tresca ground in plane strain, pressed from above: it carries 2 c."""
    mesh = box("quad8", (2, 2))
    rock = replace(
        material("rock", 1e9, 0.25), yields=(MohrCoulomb(Scalar(COHESION), Scalar(0.0)),)
    )
    return model(
        mesh,
        materials={"rock": rock},
        groups={"all": "rock"},
        supports=(Support("y0", (1,)), Support("x0", (0,))),
        stages=stages,
        channels=(displacement("top", (0.5, 1.0), (0.0, 1.0)),),
    )


def test_what_builds_on_a_collapse_is_unknown_and_the_rest_is_there():
    staged = _column(
        _press("low", 1e6),
        _press("too much", 2.5e6, independent=True),
        _press("on top of it", 0.5e6, base="too much", independent=True),
        _press("high", 1.9e6),
    )
    survey = staged.survey(np.empty(0), fields=True, partial=True)
    (readings,) = survey.computed
    assert np.isnan(readings).tolist() == [False, True, True, False]
    whole = _column(_press("low", 1e6), _press("high", 1.9e6)).survey(np.empty(0), fields=False)
    assert readings[[0, 3]] == pytest.approx(whole.computed[0], rel=1e-9)
    (sentence,) = survey.collapses
    assert "'too much'" in sentence
    assert "66.7 %" in sentence  # of the change from 1 to 2.5 MPa


def test_the_last_equilibrium_is_kept_to_be_shown():
    """2 c above, nothing beside, and more settlement than without yielding."""
    staged = _column(_press("low", 1e6), _press("too much", 2.5e6), _press("on top of it", 0.5e6))
    fields = staged.survey(np.empty(0), fields=True, partial=True).fields
    assert np.isnan(fields.displacement[2:]).any(axis=(1, 2)).all()
    assert not fields.yielded[2:].any()
    assert fields.last.states.tolist() == [2, 3]
    np.testing.assert_allclose(fields.last.stress[..., 1], -2.0 * COHESION, rtol=1e-3)
    np.testing.assert_allclose(fields.last.stress[..., [0, 3]], 0.0, atol=1e-3 * COHESION)
    top = fields.mesh.points[:, 1] == 1.0
    settled = -fields.last.displacement[0, top, 1]
    assert settled.min() > 2.0 * COHESION * (1.0 - 0.25**2) / 1e9
    assert fields.last.yielded[0].all()
    for name in ("displacement", "stress", "yielded"):
        found = getattr(fields.last, name)
        np.testing.assert_array_equal(found[1], found[0])
        shown = getattr(fields.shown, name)
        np.testing.assert_array_equal(shown[2:], found)
        np.testing.assert_array_equal(shown[:2], getattr(fields, name)[:2])


def test_without_partial_a_collapse_is_an_error_with_stage_and_fraction():
    staged = _column(_press("low", 1e6), _press("too much", 2.5e6))
    with pytest.raises(CollapseError) as caught:
        staged.survey(np.empty(0), fields=False)
    assert caught.value.stage == "too much"
    # 1 MPa stands already: of the change by 1.5 MPa two thirds are carried.
    assert caught.value.fraction == pytest.approx(2 / 3, rel=1e-3)


def test_where_nothing_is_left_partial_raises_too():
    with pytest.raises(CollapseError):
        _column(_press("too much", 3e6)).survey(np.empty(0), fields=False, partial=True)

"""Pictures of interfaces in space: on their faces, which are laid flat."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from geoident.model.actions import Traction
from geoident.model.case import Stage, Support
from geoident.model.interfaces import Interface
from geoident.model.parameter import Scalar
from geoident.report.drawing.interfaces import interface_pictures
from geoident.report.drawing.style import drawing_style
from tests.forward.structures.test_interfaces import NOTHING, ZERO
from tests.support.cases import material, model
from tests.support.inner_faces import with_inner_faces
from tests.support.meshes import box


@pytest.mark.parametrize(("kind", "faces"), [("tet4", 32), ("hex20", 16)])
def test_joints_that_cross_are_drawn_in_their_planes(kind, faces):
    """Each whole joint is one map, whose means are the stress that goes through."""
    mesh = with_inner_faces(
        box(kind, (4, 4, 4)),
        level=lambda x: abs(x[..., 2] - 0.5) < 1e-9,
        upright=lambda x: abs(x[..., 0] - 0.5) < 1e-9,
    )
    press = Traction("z1", (ZERO, ZERO, Scalar(-2e5)))
    staged = model(
        mesh,
        materials={"rock": material("rock", 1e9, 0.0)},
        groups={"all": "rock"},
        supports=(Support("z0", (0, 1, 2)),),
        interfaces={n: Interface(n, Scalar(1e9), Scalar(1e9)) for n in ("level", "upright")},
        stages=(Stage("press", loads={"p": press}), Stage("wait")),
    )
    states = staged.survey(NOTHING, fields=False).interfaces
    pictures = interface_pictures(SimpleNamespace(interfaces=states))
    assert [one.title for one in pictures] == ["On the interface level", "On the interface upright"]
    assert all("in its plane" in one.caption and "2 of 2 stages" in one.caption for one in pictures)
    with drawing_style():
        figure = pictures[0].draw()
    maps = [axes for axes in figure.axes if axes.collections and axes.get_xlabel() is not None]
    drawn = [c for axes in maps for c in axes.collections if len(c.get_paths()) == faces]
    assert len(drawn) == 8  # four quantities, two stages
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert {"t_n (kPa)", "t_s (kPa)", "opening (mm)", "slip (mm)"} <= set(labels)
    corners = np.concatenate([path.vertices for path in drawn[0].get_paths()])
    np.testing.assert_allclose(np.ptp(corners, axis=0), 1.0, atol=1e-6)

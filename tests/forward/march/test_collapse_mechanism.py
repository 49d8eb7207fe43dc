"""The mechanism of a collapse as it is handed to who draws it, for velocities known by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from support.cases import model, rollers
from support.meshes import box, regroup
from support.yielding import constant, rock

from geoident.forward.march.collapse import _shear, mechanism_on_mesh
from geoident.model.case import Stage


@pytest.mark.parametrize(
    ("strain", "size"),
    [
        # plane: xx, yy, zz, and the whole angle xy; the norm of the deviator
        ([0.0, 0.0, 0.0, 2.0], np.sqrt(2.0)),
        ([1.0, -1.0, 0.0, 0.0], np.sqrt(2.0)),  # the same in axes turned by 45 degrees
        ([3.0, 3.0, 3.0, 0.0], 0.0),
        ([4.0, 1.0, 1.0, 0.0], 3.0 * np.sqrt(2.0 / 3.0)),
        ([1.0, 1.0, 1.0, 2.0, 0.0, 0.0], np.sqrt(2.0)),
        ([0.0, 0.0, 0.0, 0.0, 1.2, 1.6], np.sqrt(2.0)),  # one angle of 2 about another axis
    ],
)
def test_size_of_shear_is_that_of_the_change_of_shape(strain, size):
    assert _shear(np.array(strain)[:, None]) == pytest.approx(size, abs=1e-14)


def test_shear_of_an_element_is_the_largest_at_its_points():
    """Velocities u = y^2 along x: the rate of shear is 2 y; a quarter is gone."""
    mesh = regroup(box("quad8", (2, 2)), gone=lambda c: (c[:, 0] > 0.5) & (c[:, 1] < 0.5))
    staged = model(
        mesh,
        materials={"rock": rock(1e7, 0.3)},
        groups={"gone": "rock", "rock": "rock"},
        supports=rollers(2),
        in_situ=constant(-1e4, -1e4, -1e4),
        stages=(Stage("wait"), Stage("dig", excavate=("gone",))),
    )
    u = np.column_stack([mesh.points[:, 1] ** 2, np.zeros(mesh.n_nodes)])
    state = SimpleNamespace(name="dig")
    task = SimpleNamespace(number=2, state=state, system=staged.march.systems[2])
    found = mechanism_on_mesh(staged.on_mesh, task, u.ravel(), 0.25)
    assert (found.stage, found.state, found.fraction) == ("dig", 2, 0.25)
    np.testing.assert_array_equal(found.velocity, u)
    points = staged.discretization.points
    top = [points.position[points.element == e, 1].max() for e in range(4)]
    gone = mesh.groups["gone"][0]
    np.testing.assert_array_equal(found.present, np.arange(4) != gone)
    expected = np.where(np.arange(4) == gone, 0.0, top) / max(top)
    np.testing.assert_allclose(found.shear, expected, rtol=1e-12)
    assert expected.min() == 0.0
    still = mechanism_on_mesh(staged.on_mesh, task, 0.0 * u.ravel(), 0.0)
    assert still.shear.tolist() == [0.0] * 4

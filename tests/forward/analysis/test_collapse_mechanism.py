"""The mechanism of a collapse as it is handed to who draws it, for velocities known by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from support.cases import model, rollers
from support.meshes import box, regroup
from support.yielding import constant, rock

from geoident.errors import CollapseError
from geoident.forward.analysis.bands import ShearBand
from geoident.forward.analysis.collapse import (
    _shear,
    collapse_error,
    describe_mechanism,
    mechanism_on_mesh,
)
from geoident.forward.analysis.stage import LastEquilibrium
from geoident.forward.analysis.stage_equations import Balance
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


def dug():
    """Four elements, of which the lower right one is gone in state 2; its task there."""
    mesh = regroup(box("quad8", (2, 2)), gone=lambda c: (c[:, 0] > 0.5) & (c[:, 1] < 0.5))
    staged = model(
        mesh,
        materials={"rock": rock(1e7, 0.3)},
        groups={"gone": "rock", "rock": "rock"},
        supports=rollers(2),
        in_situ=constant(-1e4, -1e4, -1e4),
        stages=(Stage("wait"), Stage("dig", excavate=("gone",))),
    )
    state = SimpleNamespace(name="dig")
    return staged, SimpleNamespace(number=2, state=state, system=staged.analysis.systems[2])


def test_shear_of_an_element_is_the_largest_at_its_points():
    """Velocities u = y^2 along x: the rate of shear is 2 y; a quarter is gone."""
    staged, task = dug()
    mesh = staged.mesh
    u = np.column_stack([mesh.points[:, 1] ** 2, np.zeros(mesh.n_nodes)])
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


def test_where_a_mechanism_shears_is_said_by_its_points():
    """The rate of shear 2 y: the most near the top, strongly from half of that on."""
    staged, task = dug()
    mesh = staged.mesh
    u = np.column_stack([mesh.points[:, 1] ** 2, np.zeros(mesh.n_nodes)]).ravel()
    points = staged.discretization.points.position.round(3)
    there = staged.analysis.systems[2].volume > 0.0
    y = staged.discretization.points.position[:, 1]
    first = points[there & (y > y[there].max() - 1e-9)]
    strong = points[there & (y > 0.5 * y[there].max())]
    said = describe_mechanism(staged.on_mesh, task.system, u)
    low, high = (tuple(map(float, f(axis=0))) for f in (strong.min, strong.max))
    places = [f"near ({x:g}, {z:g}) m" for x, z in first]
    before, _, rest = said.partition(", and strongly between ")
    assert before in [f"; it shears most in group 'rock' {place}" for place in places]
    assert rest == f"({low[0]:g}, {low[1]:g}) m and ({high[0]:g}, {high[1]:g}) m"
    # what is gone does not shear: downwards it would be the most
    other = np.column_stack([np.zeros(mesh.n_nodes), mesh.points[:, 0] ** 3]).ravel()
    falling = other * np.where(np.repeat(mesh.points[:, 1], 2) < 0.5, 9.0, 1.0)
    assert "in group 'rock'" in describe_mechanism(staged.on_mesh, task.system, falling)


def test_a_mechanism_without_shear_is_where_it_moves_most():
    """A body that moves as a whole: the first of its nodes; no element changes its shape."""
    staged, task = dug()
    mesh = staged.mesh
    u = np.full((mesh.n_nodes, 2), 0.5)
    x, y = mesh.points[0]
    assert (
        describe_mechanism(staged.on_mesh, task.system, 0.0 * u.ravel())
        == f" near ({x:g}, {y:g}) m"
    )
    # a node of what is gone may move most, where nothing that is there shears
    lone = next(k for k in range(mesh.n_nodes) if np.allclose(mesh.points[k], (1.0, 0.0)))
    u[:] = 0.0
    u[lone] = 3.0, 4.0
    assert describe_mechanism(staged.on_mesh, task.system, u.ravel()) == " near (1, 0) m"


BANDS = (
    "at stage 'dig' no equilibrium was found: even flow ends where the ground still keeps 1.2 % of "
    "its overstress, and a band has lost its stability, with half of its strain in 17 of the 230 "
    "strain points that yield"
)
HINT = (
    "With a dilation so far below the friction, shear goes into bands as wide as the elements. See "
    "whether support that acts in this stage, a larger dilation, or larger elements where it "
    "shears carry it: then it does not lack strength."
)


@pytest.mark.parametrize("proven", [False, True])
def test_a_band_is_the_mechanism_that_is_told_where_nothing_is_proven(proven):
    staged, task = dug()
    mesh = staged.mesh
    sheared = np.column_stack([-4.0 * mesh.points[:, 1] ** 2, np.zeros(mesh.n_nodes)]).ravel()
    other = np.column_stack([np.zeros(mesh.n_nodes), 2.0 * mesh.points[:, 0]]).ravel()
    reached = LastEquilibrium(np.zeros(2), np.zeros((4, 1)), np.zeros(1, dtype=bool))
    told = collapse_error(
        staged.on_mesh, task, 0.25, other, proven=proven,
        ended=Balance(None, None, None, viscosity=0.01234),
        band=ShearBand(sheared, 17, 230, -0.1), reached=reached,
    )  # fmt: skip
    mode = other if proven else sheared
    where = describe_mechanism(staged.on_mesh, task.system, mode)
    assert isinstance(told, CollapseError)
    if proven:
        assert told.message.startswith("at stage 'dig' the ground cannot carry the loads: plastic ")
        assert told.message.endswith(f"25 % of the change of load of this stage is carried{where}")
    else:
        part = "; 25 % of the change of load of this stage was brought to equilibrium"
        assert told.message == f"{BANDS}{part}{where}"
        assert told.hint == HINT
    np.testing.assert_allclose(told.mechanism, mode / np.abs(mode).max(), rtol=1e-14)
    np.testing.assert_allclose(told.motion.velocity.ravel(), told.mechanism)
    assert (told.motion.fraction, told.fraction, told.stage) == (0.25, 0.25, "dig")
    assert told.reached is reached


def test_a_mechanism_that_is_none_is_not_divided_by():
    staged, task = dug()
    told = collapse_error(staged.on_mesh, task, np.nan, np.zeros(2 * staged.mesh.n_nodes))
    assert not told.mechanism.any()
    assert "change of load" not in told.message
    plain = collapse_error(staged.on_mesh, task, np.nan, None, proven=False,
                           band=ShearBand(np.ones(4), 1, 2, -1.0))  # fmt: skip
    assert plain.message.endswith("or the ground collapses")
    assert plain.motion is None

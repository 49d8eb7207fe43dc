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
from geoident.forward.analysis.collapse import CarriedPart
from geoident.forward.analysis.collapse_message import collapse_error, describe_mechanism
from geoident.forward.analysis.stage_equations import Iterate, NoEquilibrium
from geoident.model.case import Stage


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
    system = staged.analysis.systems[2]
    return staged, SimpleNamespace(number=2, moment="stage 'dig'", state=state, system=system)


def test_shear_of_an_element_is_the_largest_at_its_points():
    """Velocities u = y^2 along x: the rate of shear is 2 y; a quarter is gone."""
    staged, task = dug()
    mesh = staged.mesh
    u = np.column_stack([mesh.points[:, 1] ** 2, np.zeros(mesh.n_nodes)])

    def drawn(u):
        failure = NoEquilibrium(u.ravel(), proven=True)
        carried = CarriedPart(0.25, None, failure)
        return collapse_error(staged.on_mesh, task, failure, associated=True, carried=carried)

    told = drawn(u)
    found = told.motion
    assert (found.stage, found.state, found.fraction) == ("dig", 2, 0.25)
    np.testing.assert_array_equal(found.velocity, u / u.max())
    points = staged.discretization.points
    top = [points.position[points.element == e, 1].max() for e in range(4)]
    gone = mesh.groups["gone"][0]
    np.testing.assert_array_equal(found.present, np.arange(4) != gone)
    expected = np.where(np.arange(4) == gone, 0.0, top) / max(top)
    np.testing.assert_allclose(found.shear, expected, rtol=1e-12)
    assert expected.min() == 0.0
    near = float(told.message.split("' near ")[1].split(")")[0].split(", ")[1])
    assert near == pytest.approx(max(top), abs=6e-4)
    still = drawn(0.0 * u).motion
    assert still.shear.tolist() == [0.0] * 4


BANDS = (
    "at stage 'dig' not converged: no equilibrium was found, residual 1.2 % of the change of load, "
    "carried by stress beyond the yield surface, and a band has lost its stability, with half of "
    "its strain in 17 of the 230 strain points that yield"
)
HINT = (
    "It may mean that the stage is beyond its limit load, or that shear goes into bands as wide as "
    "the elements, as with a dilation far below the friction. See whether support that acts in "
    "this stage, a larger dilation, or larger elements where it shears carry it; if not, the "
    "ground lacks strength."
)


@pytest.mark.parametrize("proven", [False, True])
def test_a_band_is_the_mechanism_that_is_told_where_nothing_is_proven(proven):
    staged, task = dug()
    mesh = staged.mesh
    sheared = np.column_stack([-4.0 * mesh.points[:, 1] ** 2, np.zeros(mesh.n_nodes)]).ravel()
    other = np.column_stack([np.zeros(mesh.n_nodes), 2.0 * mesh.points[:, 0]]).ravel()
    reached = Iterate(np.zeros(2), np.zeros((4, 1)), (), np.zeros(0), 1.0)
    failure = NoEquilibrium(other, proven=proven)
    told = collapse_error(
        staged.on_mesh, task, failure, associated=False,
        carried=CarriedPart(0.25, reached, failure),
        residual=0.01234, band=ShearBand(sheared, 17, 230),
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
    np.testing.assert_array_equal(told.reached.stress, reached.stress)

"""Instruments on a mesh: what they read of known fields, and their derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import as_scalar, displacement, material, model, rollers
from support.derivatives import assert_exact
from support.meshes import box, regroup

from geoident.errors import InputError
from geoident.model.case import Analysis, Stage
from geoident.model.gauges import Channel
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Parameter, Scalar

LEAN = ((0.0, 0.5), (-0.5, 0.0))


def tilt(name: str, point: tuple[float, ...], turns: tuple[tuple[float, ...], ...]) -> Channel:
    """Rotation of the ground at a point."""
    base = displacement(name, point, (1.0,) + (0.0,) * (len(point) - 1))
    return replace(base, kind="tilt", turns=turns, dimension="angle", unit="mrad")


def readings(mesh, field, *channels, **changes):
    """What channels read of a displacement field at the nodes."""
    staged = model(
        mesh,
        materials={"rock": material("rock", 1e9, 0.2)},
        groups=dict.fromkeys(mesh.groups, "rock"),
        supports=rollers(mesh.dim),
        stages=(Stage("nothing"),),
        channels=channels,
        **changes,
    )
    u = np.array([field(x) for x in mesh.points]).ravel()
    return staged.gauges.operator(np.arange(len(channels))) @ u


@pytest.mark.parametrize("kind", ["tri3", "quad4", "tri6", "quad8"])
def test_the_tilt_of_ground_is_its_rotation_without_its_strain(kind):
    gradient = np.array([[1.0, 2.0], [-5.0, 3.0]])
    mesh = box(kind, (3, 2), size=(3.0, 2.0), distortion=0.2)
    (found,) = readings(mesh, lambda x: gradient @ x, tilt("t", (1.3, 0.9), LEAN))
    assert found == pytest.approx(0.5 * (2.0 + 5.0), rel=1e-12)


def test_the_tilt_of_ground_follows_a_quadratic_field_in_space():
    """u = (y z, -x z, x^2): leaning towards y at (1, 2, 3) is (du_y/dz - du_z/dy)/2 = -1/2."""
    mesh = box("hex20", (3, 3, 3), size=(3.0, 3.0, 4.0))
    lean = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.5), (0.0, -0.5, 0.0))
    (found,) = readings(
        mesh, lambda x: np.array([x[1] * x[2], -x[0] * x[2], x[0] ** 2]),
        tilt("t", (1.0, 2.0, 3.0), lean),
    )  # fmt: skip
    assert found == pytest.approx(-0.5, rel=1e-9)


def test_across_the_axis_a_tilt_has_the_other_sign():
    """Of a field of revolution, the point at -r leans as much the other way."""
    mesh = box("quad8", (3, 3), size=(3.0, 3.0))
    here, there = readings(
        mesh, lambda x: np.array([x[0] * x[1], x[0] ** 2]),
        tilt("a", (1.2, 1.5), LEAN), tilt("b", (-1.2, 1.5), LEAN),
        analysis=Analysis.AXISYMMETRIC,
    )  # fmt: skip
    assert here == pytest.approx(0.5 * (1.2 - 2.4), rel=1e-9)
    assert there == pytest.approx(-here, rel=1e-9)


def test_motions_add_up_over_more_than_two_points():
    terms = (((0.5, 0.5), (-1.0, 0.0)), ((1.5, 0.5), (1.0, -2.0)), ((2.5, 1.5), (0.0, 2.0)))
    channel = replace(displacement("i", (2.5, 1.5), (0.0, 1.0)), kind="inclinometer", terms=terms)
    mesh = box("quad4", (3, 2), size=(3.0, 2.0), distortion=0.2)
    (found,) = readings(mesh, lambda x: np.array([3 * x[0], 5 * x[1]]), channel)
    assert found == pytest.approx(3.0 * (1.5 - 0.5) + 2 * 5.0 * (1.5 - 0.5))


def test_derivatives_are_exact_and_condensation_takes_tilts():
    values = {"E": 2e9, "p": -2e6}
    mesh = regroup(
        box("quad8", (4, 4), size=(4.0, 4.0)),
        core=lambda x: (x[:, 0] < 1.0) & (x[:, 1] > 1.0) & (x[:, 1] < 2.0),
    )
    p = Scalar(1.0, "p")
    staged = model(
        mesh,
        parameters=tuple(Parameter(n, v, *sorted((v / 9, v * 9))) for n, v in values.items()),
        materials={"rock": material("rock", Scalar(1.0, "E"), 0.25)},
        groups=dict.fromkeys(("rock", "core"), "rock"),
        supports=rollers(2),
        in_situ=ConstantStress((p, Scalar(0.6, "p"), p, *(as_scalar(0.0),) * 3)),
        stages=(Stage("open", excavate=("core",)),),
        channels=(tilt("t", (1.6, 2.4), LEAN), displacement("d", (1.0, 1.5), (1.0, 0.0))),
    )
    response = staged.response([("t", "open"), ("d", "open")])
    assert_exact(response, np.array(list(values.values())), tuple(values))
    assert response.obstacle() is None


def test_the_end_of_a_casing_outside_the_mesh_is_said_once():
    """All depths refer to it; what is wrong of another gauge is said all the same."""
    mesh, end = box("quad4", (4, 4)), (0.5, -3.0)
    first, other, single = (
        replace(displacement(name, (0.5, y), (1.0, 0.0)), first=end)
        for name, y in (("I.A0", 1.0), ("I.A1", 0.5), ("D", 0.7))
    )
    channels = (replace(first, gauge="I"), replace(other, gauge="I"), single)
    with pytest.raises(InputError) as error:
        readings(mesh, lambda x: x, *channels)
    assert [fault.message for fault in error.value.faults] == [
        "point (0.5, -3) m of gauge 'I.A0' lies outside the mesh",
        "point (0.5, -3) m of gauge 'D' lies outside the mesh",
    ]

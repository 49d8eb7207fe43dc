"""Shells that meet: joints, changes of thickness, and what the ground on a side does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geoident.model.actions import PointForce, Traction
from geoident.model.case import Material, Stage, Support
from geoident.model.gauges import Reads
from geoident.model.ground import Axes, Orthotropic
from geoident.model.parameter import Scalar
from geoident.model.structures import Shell
from tests.support.cases import displacement, material, model
from tests.support.force_gauges import gauge
from tests.support.inner_faces import with_inner_faces
from tests.support.meshes import box

NOTHING, ZERO, E, FORCE, WIDTH = np.empty(0), Scalar(0.0), 30e9, 1e3, 0.5
STRIP = {"mirrored_on": ("y0", "y1")}
AIR = {"materials": {"air": material("air", 1.0, 0.0)}, "groups": {"all": "air"}}


def _shell(group, t, *, axis=(1.0, 0.0, 0.0), nu=0.0, **more):
    return Shell(group, Scalar(E), Scalar(t), Scalar(nu), axis, **more)


def _rigidity(t):
    return E * t**3 / 12


def _line_force(place, direction):
    """FORCE a metre along y, on a strip of first order."""
    half = [Scalar(0.5 * FORCE * WIDTH * part) for part in direction]
    ends = [(place[0], y, place[1]) for y in (0.0, WIDTH)]
    return {f"f{k}": PointForce(end, tuple(half)) for k, end in enumerate(ends)}


def _tilt(name, shell, place):
    """Of a shell at a place, towards x."""
    return gauge("tilt", name, place, structure=shell, direction=(1.0, 0.0, 0.0),
                 dimension="angle", reads=Reads.CHANGE, zero="build")  # fmt: skip


def _found(mesh, shells, supports, loads, channels):
    """What gauges read, and per shell the places and moments m_11 of its faces."""
    staged = model(
        mesh, **AIR, supports=supports, structures=shells,
        stages=(Stage("build", build=tuple(shells)), Stage("load", loads=loads)),
        channels=tuple(channels),
    )  # fmt: skip
    found = staged.survey(NOTHING, fields=False)
    names = np.array(found.shells.structures)
    each = ((found.shells.centres[own], found.shells.moment[own, 0, 1], found.shells.axes[own, 2])
            for own in (names == name for name in shells))  # fmt: skip
    return found.computed[:, 1], *each


def test_moments_at_a_joint_of_wall_and_slab_are_in_equilibrium():
    """A wall on the middle of a slab that is pushed at its top: 2 F at its foot, F in each half."""
    mesh = box("hex8", (12, 1, 6), size=(4.0, WIDTH, 2.0))
    mesh = with_inner_faces(mesh, wall=lambda x: abs(x[..., 0] - 2.0) < 1e-9)
    low, x = mesh.points[:, 2] == 0.0, mesh.points[:, 0]
    ends = {"left": low & (x == 0.0), "right": low & (x == 4.0)}
    mesh = replace(mesh, node_groups={k: np.flatnonzero(v) for k, v in ends.items()})
    shells = {"slab": _shell("z0", 0.02, **STRIP),
              "wall": _shell("wall", 0.03, axis=(0.0, 0.0, 1.0), **STRIP)}  # fmt: skip
    supports = (Support("y0", (1,)), Support("y1", (1,)), Support("left", (0, 2)),
                Support("right", (2,)))  # fmt: skip
    loads = _line_force((2.0, 2.0), (1.0, 0.0, 0.0))
    z = np.array([0.0, 0.5, 1.1, 2.0])
    gauges = [_tilt(f"t{k}", "wall", (2.0, 0.2, height)) for k, height in enumerate(z)]
    gauges += [_tilt("end", "slab", (4.0, 0.1, 0.0)),
               displacement("u", (2.0, 0.2, 2.0), (1.0, 0.0, 0.0))]  # fmt: skip
    read, slab, wall = _found(mesh, shells, supports, loads, gauges)
    across = slab[0][:, 0] - 2.0
    np.testing.assert_allclose(
        slab[1], np.sign(across) * (1.0 - np.abs(across) / 2) * FORCE, rtol=1e-3
    )
    to_right = wall[2][0, 0]  # moments are positive with tension there
    np.testing.assert_allclose(wall[1], -to_right * (2.0 - wall[0][:, 2]) * FORCE, rtol=1e-3)
    foot = 2.0 * FORCE * 4.0 / 12 / _rigidity(0.02)
    leans = foot + FORCE * (2.0 * z - z**2 / 2) / _rigidity(0.03)
    exact = [*leans, -foot / 2, 2.0 * foot + FORCE * 2.0**3 / 3 / _rigidity(0.03)]
    np.testing.assert_allclose(read, exact, rtol=0.01)


def test_shells_of_other_thickness_go_on_in_each_other():
    """A cantilever of two lengths of 1 m, 30 and 20 mm thick, with free edges and a free end."""
    mesh = box("hex8", (6, 1, 1), size=(2.0, WIDTH, 0.5))
    faces = mesh.facet_groups["z1"]
    (block,) = (b for b in mesh.facets if b.kind == "quad4")
    inner = mesh.points[block.nodes[faces]].mean(axis=1)[:, 0] < 1.0
    groups = {**mesh.facet_groups, "thick": faces[inner], "thin": faces[~inner]}
    shells = {"thick": _shell("thick", 0.03, clamped_on=("x0",)), "thin": _shell("thin", 0.02)}
    loads = _line_force((2.0, 0.5), (0.0, 0.0, -1.0))
    end = displacement("w", (2.0, 0.2, 0.5), (0.0, 0.0, -1.0))
    (moved,), thick, thin = _found(
        replace(mesh, facet_groups=groups), shells, (Support("x0", (0, 1, 2)),), loads, [end]
    )  # fmt: skip
    for places, moment, _ in (thick, thin):
        np.testing.assert_allclose(moment, (2.0 - places[:, 0]) * FORCE, rtol=1e-3)
    exact = FORCE * ((1 / 3 + 1 / 2 + 3 / 2) / _rigidity(0.03) + 1 / 3 / _rigidity(0.02))
    assert moved == pytest.approx(exact, rel=5e-3)


@pytest.mark.parametrize(("kind", "n"), [("hex8", 8), ("hex20", 4)])
def test_a_slab_on_springs_bends_as_naviers_series_has_it(kind, n):
    """A square of 4 m on k = 10 MPa/m, held at its edges: ground that bears upwards only."""
    side, t, nu, k, q = 4.0, 0.1, 0.2, 1e7, 1e3
    stiff, soft, none = Scalar(k * 0.5), Scalar(1e-6 * k), ZERO
    axes = Axes((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    springs = Orthotropic(*(stiff,) * 3, *(none,) * 3, *(soft,) * 3, axes)
    staged = model(
        box(kind, (n, n, 1), size=(side / 2, side / 2, 0.5)),
        materials={"springs": Material("springs", springs)},
        groups={"all": "springs"},
        supports=(Support("x0", (0,)), Support("y0", (1,)), Support("z0", (0, 1, 2)),
                  Support("x1", (2,)), Support("y1", (2,))),
        structures={"slab": _shell("z1", t, nu=nu, mirrored_on=("x0", "y0"))},
        stages=(Stage("load", build=("slab",),
                      loads={"q": Traction("z1", (ZERO, ZERO, Scalar(-q)))}),),
        channels=(displacement("w", (0.0, 0.0, 0.5), (0.0, 0.0, -1.0)),),
    )  # fmt: skip
    found = staged.survey(NOTHING, fields=False)
    middle = np.linalg.norm(found.shells.centres[:, :2], axis=1).argmin()
    a = (np.arange(1, 80, 2) * np.pi / side)[:, None]
    b, D = a.T, _rigidity(t) / (1 - nu**2)
    terms = 16 * q / (side**2 * a * b) / (D * (a**2 + b**2) ** 2 + k)
    assert found.computed[0, 0] == pytest.approx(
        (terms * np.sin(a * side / 2) * np.sin(b * side / 2)).sum(), rel=6e-3
    )
    x, y = found.shells.centres[middle, :2] + side / 2
    bent = (terms * D * (a**2 + nu * b**2) * np.sin(a * x) * np.sin(b * y)).sum()
    assert found.shells.moment[middle, 0, 0] == pytest.approx(-bent, rel=0.01)

"""The staged model against closed forms of the literature."""

from __future__ import annotations

import numpy as np
import pytest
from support.cases import material, model, rollers
from support.closed_forms import kirsch, lift_settlement, spherical_cavity
from support.meshes import KINDS, KINDS_3D, box, opening, regroup

from geoident.model.case import Stage, Support
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Scalar

RADIUS, E, NU = 2.0, 10e9, 0.22


def _constant(xx: float, yy: float, zz: float) -> ConstantStress:
    zero = Scalar(0.0)
    return ConstantStress((Scalar(xx), Scalar(yy), Scalar(zz), zero, zero, zero))


def _excavated(mesh, stress):
    """Displacements (n_nodes, dim) after excavating the core of a stressed quarter or octant."""
    staged = model(
        mesh,
        materials={"rock": material("rock", E, NU)},
        groups={"core": "rock", "rock": "rock"},
        supports=rollers(mesh.dim),
        in_situ=_constant(*stress),
        stages=(Stage("open", excavate=("core",)),),
    )
    return staged.survey(np.empty(0), fields=True).fields


def _wall(mesh):
    r = np.linalg.norm(mesh.points, axis=1)
    used = np.unique(mesh.blocks[0].nodes)
    return used[np.abs(r[used] - RADIUS) < 1e-9]


def _kirsch_wall(kind: str, n: int, layers: int, reach: float):
    """Places on the wall, displacements there, and those of the closed form."""
    mesh = opening(kind, 2, n=n, layers=layers, radius=RADIUS, reach=reach)
    u = _excavated(mesh, (-13e6, -8e6, -9e6)).displacement[-1]
    wall = _wall(mesh)
    exact = kirsch(mesh.points[wall], radius=RADIUS, E=E, nu=NU, horizontal=13e6, vertical=8e6)
    return mesh.points[wall], u[wall], exact


def _error(u, exact) -> float:
    """Largest error of a displacement relative to the largest displacement."""
    return np.linalg.norm(u - exact, axis=1).max() / np.linalg.norm(exact, axis=1).max()


def _kirsch_error(*mesh) -> float:
    _, u, exact = _kirsch_wall(*mesh)
    return _error(u, exact)


def _size(vectors):
    return np.linalg.norm(vectors, axis=1)


@pytest.mark.parametrize("kind", ["tri6", "quad8"])
def test_kirsch_wall_displacement_within_half_a_percent(kind, verification):
    at, u, exact = _kirsch_wall(kind, n=8, layers=24, reach=40 * RADIUS)
    assert _error(u, exact) < 0.005
    angle = np.degrees(np.arctan2(at[:, 1], at[:, 0]))
    verification("kirsch", kind, angle, exact=_size(exact), found=_size(u))


def test_kirsch_error_falls_with_the_mesh_and_the_domain():
    errors = [
        _kirsch_error("quad8", n, 5 * n, reach * RADIUS) for n, reach in ((2, 10), (4, 20), (8, 40))
    ]
    # The outer edge disturbs by (radius / reach)^2: doubling the reach divides the error by four.
    assert errors[0] / errors[1] > 3.5
    assert errors[1] / errors[2] > 3.5


def test_kirsch_stress_concentration_at_the_crown():
    mesh = opening("quad8", 2, n=10, layers=40, radius=RADIUS, reach=40 * RADIUS)
    fields = _excavated(mesh, (-13e6, -8e6, -9e6))
    centres = mesh.points[mesh.blocks[0].nodes[:, :4]].mean(axis=1)
    near = np.linalg.norm(centres - [0, 1.05 * RADIUS], axis=1).argmin()
    hoop = -(3 * 13e6 - 8e6)
    r, t = np.hypot(*centres[near]), np.arctan2(centres[near, 1], centres[near, 0])
    s = (RADIUS / r) ** 2
    expected = -(21e6 / 2 * (1 + s) - 5e6 / 2 * (1 + 3 * s**2) * np.cos(2 * t))
    assert fields.stress[-1, near, 0] == pytest.approx(expected, rel=0.02)
    assert abs(expected) < abs(hoop)
    # Out of plane: sigma_zz = its virgin value + nu (change of sigma_xx + sigma_yy).
    change = fields.stress[-1, near] - fields.stress[0, near]
    assert change[2] == pytest.approx(NU * (change[0] + change[1]), rel=1e-9)


@pytest.mark.parametrize("kind", ["hex20", pytest.param("tet10", marks=pytest.mark.slow)])
def test_spherical_cavity_wall_within_half_a_percent(kind, verification):
    mesh = opening(
        kind, 3, n=3 if kind == "hex20" else 2, layers=9, radius=RADIUS, reach=14 * RADIUS
    )
    stress = (-6e6, -9e6, -12e6)
    u = _excavated(mesh, stress).displacement[-1]
    wall = _wall(mesh)
    exact = spherical_cavity(mesh.points[wall], radius=RADIUS, E=E, nu=NU, stress=stress)
    assert _error(u[wall], exact) < 0.005
    section = np.abs(mesh.points[wall][:, 1]) < 1e-9
    x, _, z = mesh.points[wall][section].T
    sizes = {"exact": _size(exact[section]), "found": _size(u[wall][section])}
    verification("sphere", kind, np.degrees(np.arctan2(z, x)), **sizes)


def test_spherical_cavity_error_falls_with_the_mesh():
    stress = (-6e6, -9e6, -12e6)
    errors = []
    for n, layers in ((1, 3), (2, 6), (4, 12)):
        mesh = opening("hex8", 3, n=n, layers=layers, radius=RADIUS, reach=20 * RADIUS)
        u = _excavated(mesh, stress).displacement[-1]
        wall = _wall(mesh)
        exact = spherical_cavity(mesh.points[wall], radius=RADIUS, E=E, nu=NU, stress=stress)
        errors.append(np.linalg.norm(u[wall] - exact) / np.linalg.norm(exact))
    assert errors[0] > 2 * errors[1] > 5 * errors[2]


@pytest.mark.parametrize("kind", KINDS)
def test_column_of_lifts_settles_in_a_parabola(kind, verification):
    dim = 3 if kind in KINDS_3D else 2
    n_lifts, height, density, g = 5, 2.0, 2100.0, 9.81
    mesh = box(kind, (1,) * (dim - 1) + (n_lifts,), size=(1.5,) * (dim - 1) + (n_lifts * height,))

    def lift(k):
        return lambda c: c[:, -1] < (k + 1) * height

    mesh = regroup(mesh, **{f"lift-{k}": lift(k) for k in range(n_lifts)})
    down = (0.0,) * (dim - 1) + (-1.0,)
    modulus = E * (1 - NU) / ((1 + NU) * (1 - 2 * NU))
    sides = rollers(dim) + tuple(Support(f"{'xyz'[a]}1", (a,)) for a in range(dim - 1))
    staged = model(
        mesh,
        materials={"fill": material("fill", E, NU, density)},
        groups={"lift-0": "fill"},
        supports=sides,
        gravity=tuple(g * d for d in down),
        stages=(
            Stage("s0"),
            *(Stage(f"s{k}", install={f"lift-{k}": "fill"}) for k in range(1, n_lifts)),
        ),
    )
    fields = staged.survey(np.empty(0), fields=True).fields
    exact = lift_settlement(n_lifts, height, density * g, modulus)
    # The first lift stands in the virgin state: its own weight's settlement is not counted.
    exact[0] -= density * g * height**2 / modulus * 0.5
    # Cut into triangles or tetrahedra unevenly, a linear mesh can't carry the weight straight down;
    # every other element has the closed form at the interfaces to rounding.
    tolerance = 0.03 if kind in ("tri3", "tet4") else 1e-10
    mean = []
    for k in range(n_lifts):
        at = np.isclose(mesh.points[:, -1], (k + 1) * height)
        settled = -fields.displacement[-1][at][:, -1]
        np.testing.assert_allclose(settled, exact[k], rtol=tolerance)
        mean.append(settled.mean())
    tops = height * np.arange(1, n_lifts + 1)
    verification("lifts", kind, tops, exact=exact[:n_lifts], found=mean)

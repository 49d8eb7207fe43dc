"""Shells and rings of bars about an axis, in ground: closed forms, weight, exact derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geoident.forward.actions.supports import fixed_dofs
from geoident.model.actions import PointForce, Pressure, Traction
from geoident.model.case import Stage, Support
from geoident.model.parameter import Parameter, Scalar
from geoident.model.structures import Anchors, Beam, Bolts, Struts
from tests.support.cases import NOWHERE, displacement, material, model, rollers
from tests.support.derivatives import assert_exact
from tests.support.load_cells import cell
from tests.support.meshes import box, regroup
from tests.support.revolved import constant, revolve
from tests.support.tunnels import with_lines

E, NU, P0, RADIUS = 2e9, 0.3, 5e6, 3.0
NOTHING = np.empty(0)
ZERO = Scalar(0.0)


def _radial(radii, height=1.0, kind="quad8"):
    """One layer of ground from the axis or a radius on; the lines x = radius are in the mesh."""
    mesh = box(kind, (len(radii) - 1, 1), size=(float(len(radii) - 1), height))
    along = np.interp(mesh.points[:, 0], np.arange(len(radii)), radii)
    return replace(mesh, points=np.stack([along, mesh.points[:, 1]], axis=1))


def _wall_at(mesh, radius, name="wall"):
    here = np.flatnonzero(np.abs(mesh.points[:, 0] - radius) < 1e-9)
    order = here[np.argsort(mesh.points[here, 1])]
    lines = order[[0, 2, 1]] if len(order) == 3 else order
    return with_lines(mesh, name, lines[None])


def _shaft(kind="quad4", **changes):
    radii = np.concatenate([np.linspace(0, RADIUS, 4), np.geomspace(RADIUS, 40 * RADIUS, 99)[1:]])
    mesh = regroup(_wall_at(_radial(radii, kind=kind), RADIUS), core=lambda x: x[:, 0] < RADIUS)
    settings = {
        "materials": {"rock": material("rock", E, NU)},
        "groups": {"core": "rock", "rock": "rock"},
        "supports": (Support("y0", (1,)), Support("y1", (1,))),
        "in_situ": constant(-P0, -P0, -P0),
    }
    return revolve(mesh, **{**settings, **changes})


def test_lined_shaft_carries_its_share_of_the_ground(verification):
    """Ground u = (p0 - p) R / (2 G), lining p = D u / R^2: it cannot shorten along its axis."""
    t, nu_c, E_c = 0.2, 0.2, 2e10
    lining = Beam("wall", E=Scalar(E_c), thickness=Scalar(t), nu=Scalar(nu_c),
                  clamped_on=("y0", "y1"))  # fmt: skip
    stages = (Stage("sink", excavate=("core",), build=("lining",)),)
    gauge = cell("e", None, (RADIUS, 0.4), structure="lining")
    gauges = tuple(
        replace(gauge, name=name, kind=kind, quantity=quantity, dimension=dimension)
        for name, kind, quantity, dimension in (
            ("e", "strain", "axis", "strain"),
            ("N", "load-cell", "N", "line load"),
        )
    )
    staged = _shaft(structures={"lining": lining}, stages=stages, channels=gauges)
    found = staged.survey(NOTHING, fields=True)
    D, G = E_c * t / (1 - nu_c**2), E / (2 * (1 + NU))
    pressure = P0 / (1 + 2 * G * RADIUS / D)
    wall = np.flatnonzero(found.fields.mesh.points[:, 0] == RADIUS)
    inwards = -found.fields.displacement[1, wall, 0]
    np.testing.assert_allclose(inwards, pressure * RADIUS**2 / D, rtol=2e-3)
    np.testing.assert_allclose(found.members.hoop, -pressure * RADIUS, rtol=2e-3)
    hoop = found.members.hoop.mean()
    verification("shaft", "", ["hoop force"], exact=-pressure * RADIUS, found=hoop)
    np.testing.assert_allclose(found.members.axial, -nu_c * pressure * RADIUS, rtol=2e-3)
    assert np.abs(found.members.moment).max() < 1e-6 * pressure * RADIUS**2
    strain, force = found.computed[:, 0]
    assert force == pytest.approx(-nu_c * pressure * RADIUS, rel=2e-3)
    assert strain == pytest.approx(0.0, abs=1e-12)


def _ring_of_bars(a, c, b, p, spring):
    """N of all bars of a ring, from r = a to c, when p presses on r = a; u(b) = 0, nu = 0.

    Ground u = A r + C / r, sigma_r = E (A - C / r^2) inside and outside of c; the bars act as line
    loads N / (2 pi r h) on both circles, h = 1.
    """
    x = np.zeros((5, 5))  # A1, C1, A2, C2, N
    x[0] = [E, -E / a**2, 0, 0, 1 / (2 * np.pi * a)]  # sigma_r(a) = -p - N / (2 pi a)
    x[1] = [c, 1 / c, -c, -1 / c, 0]
    x[2] = [-E, E / c**2, E, -E / c**2, -1 / (2 * np.pi * c)]  # the jump holds what pulls inwards
    x[3] = [0, 0, b, 1 / b, 0]
    x[4] = [-spring * (c - a), -spring * (1 / c - 1 / a), 0, 0, 1]
    return np.linalg.solve(x, [-p, 0, 0, 0, 0])[4]


@pytest.mark.parametrize("by", ["number", "spacing"])
def test_ring_of_radial_bolts_in_a_thick_cylinder(by):
    a, c, b, n, EA, p = 2.0, 4.0, 9.0, 24, 4e8, 1e6
    radii = np.concatenate([np.linspace(a, c, 81), np.linspace(c, b, 121)[1:]])
    mesh = _radial(radii, kind="quad4")
    ends = (((a, 0.0), (c, 0.0)), ((a, 1.0), (c, 1.0)))
    # Two rings, at the bottom and at the top of the layer: each is counted half.
    count = {"number": Scalar(n / 2)} if by == "number" else {"spacing": Scalar(4 * np.pi * a / n)}
    staged = revolve(
        mesh,
        materials={"rock": material("rock", E, 0.0)},
        groups={"all": "rock"},
        supports=(Support("y0", (1,)), Support("y1", (1,)), Support("x1", (0,))),
        structures={"bolts": Bolts(ends, EA=Scalar(EA), **count)},
        stages=(Stage("push", build=("bolts",), loads={"p": Pressure("x0", Scalar(p))}),),
    )
    whole = _ring_of_bars(a, c, b, p, n * EA / (c - a))
    assert whole < -1e5  # the pressure brings the two circles closer together
    np.testing.assert_allclose(staged.survey(NOTHING, fields=False).members.axial[:, 0], whole / n,
                               rtol=1e-3)  # fmt: skip


def test_inclined_bolts_in_uniform_strain():
    """u_r = e r, u_y = g y: a bar in the section stretches by (e dr^2 + g dy^2) / L^2."""
    mesh = _radial(np.linspace(1.0, 3.0, 5), height=2.0)
    ends = ((1.3, 0.2), (2.6, 1.7))
    staged = revolve(
        mesh,
        materials={"rock": material("rock", 1e9, 0.0)},
        groups={"all": "rock"},
        supports=(Support("y0", (1,)),),
        structures={"bolts": Bolts((ends,), EA=Scalar(1e-3), number=Scalar(7.0))},
        stages=(
            Stage("pull", build=("bolts",),
                  loads={"x": Pressure("x1", Scalar(-1e6)), "in": Pressure("x0", Scalar(-1e6)),
                         "y": Traction("y1", (ZERO, Scalar(2e6)))}),
        ),
    )  # fmt: skip
    dr, dy = np.subtract(ends[1], ends[0])
    strain = (1e-3 * dr**2 + 2e-3 * dy**2) / (dr**2 + dy**2)
    found = staged.survey(NOTHING, fields=False).members
    assert found.axial[0, 0] == pytest.approx(1e-3 * strain, rel=1e-7)


def test_weight_of_walls_rests_on_the_supports():
    """All that a wall weighs arrives: per metre in the plane, 2 pi r h of it about an axis."""
    heavy = {"density": Scalar(2500.0), "E": Scalar(2e10), "thickness": Scalar(0.4)}
    light = {"weight": Scalar(8e3), "EA": Scalar(1e9), "EI": Scalar(1e7)}
    for more, pressure in ((heavy, 2500.0 * 9.81 * 0.4), (light, 8e3)):
        for make, radius, area in ((revolve, RADIUS, 2 * np.pi * RADIUS * 2), (model, 1.0, 2.0)):
            mesh = _wall_at(_radial(np.linspace(0, 6, 7), 2.0), radius)
            settings = {
                "materials": {"rock": material("rock", E, NU)},
                "groups": {"all": "rock"},
                "supports": rollers(2),
                "gravity": (0.0, -9.81),
                "structures": {"wall": Beam("wall", **more)},
                "stages": (Stage("hang", build=("wall",)), Stage("off", dismantle=("wall",))),
            }
            staged = make(mesh, **settings)
            _, hung, off = [*_reactions(staged)]
            assert hung == pytest.approx(pressure * area, rel=1e-9)
            assert off == pytest.approx(0, abs=1e-6 * pressure)


def _reactions(staged):
    points = staged.discretization.points
    for end in staged.at(NOTHING).states():
        held = points.forces(end.stress[..., 0], points.volume)
        held += staged.structures.nodal_forces(end.members[:, :1])[:, 0]
        held -= staged.actions.forces(end.number, NOWHERE)[:, 0]
        yield held.reshape(-1, 2)[fixed_dofs(staged.on_mesh).reshape(-1, 2)[:, 1], 1].sum()


PARAMETERS = (
    Parameter("E", E, 1e8, 1e11),
    Parameter("E_c", 2e10, 1e9, 1e11),
    Parameter("t", 0.3, 0.05, 1.0),
    Parameter("rho", 2400.0, 1e3, 3e3),
    Parameter("n", 12.0, 1.0, 99.0),
    Parameter("s", 1.5, 0.5, 5.0),
    Parameter("P", 2e5, 0.0, 1e6),
)


def test_derivatives_by_every_number_about_an_axis():
    names = [q.name for q in PARAMETERS]
    number = {name: Scalar(1.0, name) for name in names}
    radii = np.array([0, 1.0, 2.0, 3.0, 3.5, 4.2, 5, 6, 8, 11, 15])
    mesh = box("quad8", (10, 4), size=(10.0, 4.0))
    along = np.interp(mesh.points[:, 0], np.arange(11), radii)
    mesh = replace(mesh, points=np.stack([along, mesh.points[:, 1]], axis=1))
    here = np.flatnonzero(np.abs(along - RADIUS) < 1e-9)
    y = here[np.argsort(mesh.points[here, 1])]
    mesh = with_lines(mesh, "wall", np.stack([y[:-2:2], y[2::2], y[1::2]], axis=1))
    mesh = regroup(mesh, core=lambda x: (x[:, 0] < RADIUS) & (x[:, 1] > 2.0))
    bolt, strut, anchor = (
        ((3.0, 1.2), (5.2, 2.3)), ((3.0, 3.0), (0.0, 3.0)), ((3.0, 3.4), (7.0, 2.5))
    )  # fmt: skip
    structures = {
        "wall": Beam("wall", E=number["E_c"], thickness=number["t"], nu=Scalar(0.2),
                     clamped_on=("y0",), hinges=((3.0, 2.5),), density=number["rho"]),
        "bolts": Bolts((bolt,), EA=Scalar(3e8), number=number["n"], prestress=Scalar(0.5, "P")),
        "struts": Struts((strut,), number["s"], EA=Scalar(5e8), second_end="symmetry"),
        "anchors": Anchors((anchor,), number["s"], EA=Scalar(2e8), grouted=2.0),
    }  # fmt: skip
    stages = (
        Stage("wall", build=("wall", "bolts")),
        Stage("dig", excavate=("core",), build=("struts",)),
        Stage("stress", build=("anchors",), prestress={"anchors": number["P"]}),
        Stage("push", loads={"p": PointForce((6.0, 4.0), (ZERO, Scalar(-2e7)))}),
    )
    staged = revolve(
        mesh,
        materials={"rock": material("rock", number["E"], NU)},
        groups={"core": "rock", "rock": "rock"},
        supports=(Support("y0", (0, 1)), Support("x1", (0,))),
        in_situ=constant(-P0, -P0, -P0),
        gravity=(0.0, -9.81),
        structures=structures,
        stages=stages,
        parameters=PARAMETERS,
        channels=(
            displacement("r", (3.0, 3.5), (1.0, 0.0)),
            displacement("y", (3.6, 3.8), (0.0, 1.0)),
            cell("N", *bolt, structure="bolts"),
            cell("S", *strut, structure="struts"),
            cell("A", *anchor, structure="anchors"),
        ),
    )
    read = [(c, s.name) for c in ("r", "y", "N") for s in stages]
    read += [("S", "push"), ("A", "stress"), ("A", "push")]
    response = staged.response(read)
    p = np.array([q.start for q in PARAMETERS])
    assert_exact(response, p, staged.names)
    assert response.readings(p)[read.index(("A", "stress"))] == pytest.approx(2e5, rel=1e-12)

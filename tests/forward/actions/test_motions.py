"""Motions of supports: patch tests, closed forms, derivatives, reactions, and what cannot be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import displacement, material, model, rollers
from support.derivatives import assert_exact
from support.meshes import box, opening, regroup
from support.yielding import mohr, parameters, rock

from geoident.fem.faces import face_table, patches
from geoident.model.actions import Contraction, MotionField, Pressure
from geoident.model.case import Analysis, Stage, Support
from geoident.model.mesh import ElementBlock
from geoident.model.parameter import Scalar
from geoident.model.structures import Beam

E, NU = 2e8, 0.3


def number(value: float | str, factor: float = 1.0) -> Scalar:
    return Scalar(factor, value) if isinstance(value, str) else Scalar(value)


def moved(group: str, at=None, **along) -> Support:
    """A support that moves; a number or the name of a parameter along x, y, z."""
    motions = tuple(("xyz".index(k), number(v)) for k, v in along.items())
    return Support(group, tuple(c for c, _ in motions), at=at, motions=motions)


def surveyed(mesh, p=(), **changes):
    changes = {
        "materials": {"rock": material("rock", E, NU)},
        "groups": {"all": "rock"},
        **changes,
    }
    return model(mesh, **changes).survey(np.array(p), fields=True)


@pytest.mark.parametrize("kind", ["tri6", "quad8", "tet10", "hex8"])
def test_motions_of_a_side_strain_a_box_evenly(kind):
    dim = 3 if kind in ("tet10", "hex8") else 2
    mesh = box(kind, (2,) * dim, size=(2.0, 1.0, 1.0)[:dim], distortion=0.2)
    last = "xyz"[dim - 1]
    supports = (*rollers(dim), moved("x1", x=2e-3), moved(f"{last}1", **{last: -1e-3}))
    found = surveyed(mesh, supports=supports, stages=(Stage("push"), Stage("rest")))
    strain = np.zeros(3)
    strain[[0, dim - 1]] = 1e-3, -1e-3
    if dim == 3:  # free along y: no stress there
        strain[1] = -NU / (1 - NU) * (strain[0] + strain[2])
    lame, shear = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
    stress = lame * strain.sum() + 2 * shear * strain
    for state in (1, 2):  # and nothing more happens later
        np.testing.assert_allclose(
            found.fields.displacement[state], mesh.points * strain[:dim], atol=1e-15
        )
        normal = found.fields.stress[state, :, :3]
        np.testing.assert_allclose(normal, np.tile(stress, (len(normal), 1)), atol=1e-4)
    assert not found.fields.displacement[0].any()
    across = np.prod(np.ptp(mesh.points, axis=0)[1:])
    held = found.reactions
    assert held.supports == tuple(s.group for s in supports)
    np.testing.assert_allclose(held.force[dim, 1, 0], stress[0] * across, rtol=1e-10)
    np.testing.assert_allclose(held.force[0, 2, 0], -stress[0] * across, rtol=1e-10)
    assert np.isnan(held.force[0, 1, 1])  # not held along y


def test_motions_about_an_axis_of_revolution():
    mesh = box("quad8", (3, 2), size=(2.0, 1.0))
    supports = (Support("y0", (1,)), Support("y1", (1,)), moved("x1", x=-2e-3))
    found = surveyed(
        mesh, analysis=Analysis.AXISYMMETRIC, supports=supports, stages=(Stage("squeeze"),)
    )
    np.testing.assert_allclose(
        found.fields.displacement[1, :, 0], -1e-3 * mesh.points[:, 0], atol=1e-15
    )
    radial = -1e-3 * E / ((1 + NU) * (1 - 2 * NU))
    np.testing.assert_allclose(found.fields.stress[1, :, 0], radial, rtol=1e-9)
    np.testing.assert_allclose(found.reactions.force[2, 1, 0], radial * 2 * np.pi * 2.0, rtol=1e-9)


def _ring(n: int, *, reach: float = 8.0, whole: bool = False):
    """An opening of radius 2 with the groups `wall` and `rim` of lines at both ends."""
    mesh = opening("quad8", 2, n=n, layers=2 * n, radius=2.0, reach=reach, whole=whole)
    table = face_table(mesh)
    lines, groups = list(mesh.facets), dict(mesh.facet_groups)
    core = np.zeros(mesh.n_elements, dtype=bool)
    core[mesh.groups["core"]] = True
    for name, inside, radius in (("wall", core, 2.0), ("rim", core | True, reach)):
        r = np.linalg.norm(mesh.points, axis=1)
        faces = [p.nodes for p in patches(mesh, table, table.free(inside))]
        found = np.vstack([f[np.all(np.abs(r[f] - radius) < 1e-9, axis=1)] for f in faces])
        first = sum(len(b) for b in lines)
        lines.append(ElementBlock("line3", found, np.arange(len(found))))
        groups[name] = first + np.arange(len(found))
    return replace(mesh, facets=tuple(lines), facet_groups=groups)


def lame(r, inner, wall_motion, outer):
    """Radial displacement between a wall r = inner that moves by this and a fixed edge."""
    # u = A r + B / r with u(outer) = 0
    b = wall_motion / (1 / inner - inner / outer**2)
    return b / r - b * r / outer**2


def test_a_wall_that_is_moved_converges_to_the_thick_walled_cylinder():
    errors = []
    for n in (1, 2, 4):
        mesh = _ring(n)
        wall = Support("wall", (0, 1), contraction=Contraction(Scalar(0.01), centre=(0.0, 0.0)))
        found = surveyed(
            mesh,
            groups={"rock": "rock", "core": "rock"},
            supports=(*rollers(2), Support("rim", (0, 1))),
            stages=(Stage("drive", excavate=("core",), supports={"wall": wall}),),
        )
        u, r = found.fields.displacement[1], np.linalg.norm(mesh.points, axis=1)
        ring = r > 2.0 + 1e-9
        exact = lame(r[ring], 2.0, -0.01, 8.0)
        radial = (u[ring] * mesh.points[ring]).sum(axis=1) / r[ring]
        errors.append(np.abs(radial - exact).max() / 0.01)
    assert errors[1] < errors[0] / 3
    assert errors[2] < errors[1] / 3
    assert errors[2] < 1e-3


def test_volume_loss_in_far_ground():
    """Uniform convergence: u_r = -(V/2) a^2 / r in infinite ground."""
    mesh = _ring(2, reach=400.0, whole=True)
    mesh = replace(mesh, points=mesh.points + np.array([3.0, -20.0]))
    wall = Support("wall", (0, 1), contraction=Contraction(number("V")))
    found = surveyed(
        mesh,
        [0.02],
        parameters=parameters(V=0.02),
        groups={"rock": "rock", "core": "rock"},
        supports=(Support("rim", (0, 1)),),
        stages=(Stage("drive", excavate=("core",), supports={"wall": wall}),),
    )
    u, from_centre = found.fields.displacement[1], mesh.points - np.array([3.0, -20.0])
    r = np.linalg.norm(from_centre, axis=1)
    near = (r > 1.99) & (r < 20.0)
    exact = -0.01 * 4.0 * from_centre[near] / r[near, None] ** 2
    np.testing.assert_allclose(u[near], exact, atol=0.01 * 0.02)


def _stages():
    """Two motions of a side and a wall, one that begins later, one that lets go again."""
    field = MotionField(
        ((2.0, 0.0), (2.0, 0.5), (2.0, 1.0)), (0,), ((1e-3,), (2e-3,), (1.5e-3,)), number("f")
    )
    side = Support("x1", (0,), measured=field)
    return (
        Stage("one"),
        Stage("two", supports={"y1": moved("y1", y="w"), "x1": side}),
        Stage("three", supports={"x1": None}, loads={"p": Pressure("x1", number("q"))}),
        Stage("four", independent=True, base="one", supports={"x1": moved("x1", x="v")}),
    )


def _problem(*yields, lining=False, **values):
    mesh = regroup(
        box("quad8", (4, 2), size=(2.0, 1.0)), cut=lambda c: (c[:, 0] > 1) & (c[:, 1] > 0.5)
    )
    values = {"E": E, "nu": 0.3, "v": 2e-3, "w": -1e-3, "f": 1.3, "q": 5e4, **values}
    points = [(1.5, 0.3), (0.7, 0.9), (2.0, 0.2), (1.1, 0.4)]
    channels = [
        displacement(f"g{k}", x, ((1.0, 0.0), (0.0, 1.0))[k % 2]) for k, x in enumerate(points)
    ]
    first, *others = _stages()
    stages = (first, *others, Stage("five", excavate=("cut",), base="two"))
    changes = {}
    if lining:
        changes["structures"] = {"lining": Beam("y1", EA=number("E", 0.5), EI=Scalar(1e6))}
        stages = (replace(first, build=("lining",)), *stages[1:-1])
    staged = model(
        mesh,
        parameters=parameters(**values),
        materials={"rock": rock(number("E"), number("nu"), *yields)},
        groups={"rock": "rock", "cut": "rock"},
        supports=(*rollers(2), moved("x1", x="v")),
        stages=stages,
        channels=tuple(channels),
        **changes,
    )
    pairs = [
        (c.name, s.name) for s in stages for c in channels if (c.name, s.name) != ("g1", "five")
    ]
    return staged.response(pairs), np.array(list(values.values())), tuple(values), staged


def test_derivatives_forwards_and_backwards_are_exact():
    for lining in (False, True):
        response, p, names, _ = _problem(lining=lining)
        assert_exact(response, p, names)


@pytest.mark.parametrize("flow", [None, 0.1])
def test_derivatives_where_ground_yields(flow):
    strength = (number("c"), number("phi"))
    law = mohr(*strength, planes=12) if flow is None else mohr(*strength, psi=Scalar(flow))
    response, p, names, staged = _problem(law, c=1e5, phi=0.5, v=-1e-3, f=-1.3)
    assert_exact(response, p, names, rtol=3e-7)
    assert staged.survey(p, fields=True).fields.yielded[1:].any()

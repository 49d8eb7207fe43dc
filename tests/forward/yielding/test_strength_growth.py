"""Strengths that grow with depth or with the stress in situ, against closed forms."""

from __future__ import annotations

from dataclasses import replace
from math import cos, pi, radians, sin

import numpy as np
import pytest
from support.cases import displacement, model
from support.meshes import box, from_grid
from support.yielding import Cavity, analysed, constant, hoek, mohr, parameters, rock

from geoident.errors import InputError
from geoident.model.actions import Pressure
from geoident.model.case import Stage, Support
from geoident.model.ground import Growth, WithDepth, WithStress
from geoident.model.in_situ import ProfileStress
from geoident.model.parameter import Scalar

E, NU = 40e6, 0.3
DEPTH, LOAD = 8.0, 120e3


def grows(constant, base, law, **more):
    return Growth("soil", constant, base, law, surface=0, **more)


def column(surface, *growths, **changes):
    """A column of ground that cannot move sideways, under a pressure on its top."""
    mesh = box("quad8", (1, 64), size=(0.5, DEPTH))
    soil = replace(rock(E, NU, surface, name="soil"), growths=growths)
    settings = {
        "materials": {"soil": soil},
        "groups": {"all": "soil"},
        "supports": (Support("x0", (0,)), Support("x1", (0,)), Support("y0", (1,))),
        "stages": (Stage("load", loads={"p": Pressure("y1", Scalar(LOAD))}),),
        "channels": (displacement("top", (0.25, DEPTH), (0.0, -1.0)),),
    }
    return model(mesh, **{**settings, **changes})


def settlement(strength, phi, psi):
    """Of the column, and where it yields, from strengths (q,) at depths that are equally spaced.

    Principal stresses: sideways both s, upwards -LOAD.
    """
    S, D, C = sin(phi), sin(psi), cos(phi)
    elastic = -LOAD * NU / (1 - NU)
    s = np.maximum((2 * strength * C - LOAD * (1 - S)) / (1 + S) * np.ones_like(strength), -LOAD)
    s = np.where(elastic > s, s, elastic)
    flow = -(s - NU * (s - LOAD)) / E / (1 + D)
    upwards = (-LOAD - 2 * NU * s) / E - 2 * (1 - D) * flow
    return -DEPTH * upwards.mean(), (s < elastic).mean()


def depths(count=40_000):
    return DEPTH * (np.arange(count) + 0.5) / count


@pytest.mark.parametrize(
    ("phi", "psi", "planes"),
    [
        (0.0, None, None),
        (radians(20), None, None),
        (radians(20), radians(5), None),
        (0.0, None, 32),
    ],
)
def test_column_whose_cohesion_grows_with_depth(phi, psi, planes):
    """The upper part yields, the lower one is strong enough; derivatives by both parameters."""
    at, growth = (20e3, 4e3) if phi == 0.0 else (3e3, 0.8e3)
    staged = column(
        mohr(Scalar(1.0, "at"), phi, psi=psi, planes=planes),
        grows("cohesion", Scalar(1.0, "at"), WithDepth(Scalar(1.0, "growth"), Scalar(DEPTH))),
        parameters=parameters(at=at, growth=growth),
    )
    p = np.array([at, growth])
    values, jacobian = staged.response([("top", "load")]).by_tangents(p)

    def exact(at, growth):
        return settlement(at + growth * depths(), phi, phi if psi is None else psi)

    expected, part = exact(*p)
    assert 0.2 < part < 0.8
    tolerance = 2e-3 if planes is None else 0.02
    assert values[0] == pytest.approx(expected, rel=tolerance)
    steps = 1e-3 * p
    for k in range(2):
        step = np.eye(2)[k] * steps
        slope = (exact(*(p + step))[0] - exact(*(p - step))[0]) / (2 * steps[k])
        assert jacobian[0, k] == pytest.approx(slope, rel=10 * tolerance)


def test_growth_with_stress_is_growth_with_depth_where_stress_grows_with_depth():
    """p' = 12 kPa/m z in a hydrostatic stress; the derivative by the exponent is that of steps."""
    gamma = 12e3
    zero, grow = (Scalar(0.0),) * 6, (*(Scalar(-gamma),) * 3, *(Scalar(0.0),) * 3)
    stress = ProfileStress(zero, grow, Scalar(DEPTH), held=True)
    by_stress = WithStress(Scalar(1.0, "m"), Scalar(100e3), Scalar(1.0))
    staged = column(
        mohr(Scalar(1.0, "ref"), 0.0),
        grows("cohesion", Scalar(1.0, "ref"), by_stress),
        in_situ=stress,
        parameters=parameters(ref=50e3, m=1.0),
    )
    by_depth = WithDepth(Scalar(0.5 * gamma), Scalar(DEPTH))
    other = column(mohr(0.0, 0.0), grows("cohesion", Scalar(0.0), by_depth), in_situ=stress)
    (there, slopes), where = (
        staged.response([("top", "load")]).by_tangents(np.array([50e3, 1.0])),
        [],
    )
    (expected,) = other.response([("top", "load")]).by_tangents(np.empty(0))[0]
    assert there[0] == pytest.approx(expected, rel=1e-9)
    for step in (1e-4, -1e-4):
        where.append(
            staged.response([("top", "load")]).by_tangents(np.array([50e3, 1.0 + step]))[0]
        )
    assert slopes[0, 1] == pytest.approx((where[0] - where[1])[0] / 2e-4, rel=1e-3)


TUNNEL = Cavity(pressure=1e6, E=200e6, nu=0.3)


def opened(surface, *growths, stress=(-0.1e6, -0.6e6, -0.3e6), **changes):
    """Displacements around a tunnel with their derivatives; this stress pulls at its wall."""
    mesh = TUNNEL.mesh("tri6", n=4, layers=6, reach=6.0)
    soil = replace(rock(TUNNEL.E, TUNNEL.nu, surface), growths=growths)
    staged = TUNNEL.staged(mesh, materials={"rock": soil}, in_situ=constant(*stress), **changes)
    end = analysed(staged, np.array([q.start for q in staged.case.parameters]))[-1]
    assert np.abs(end.u).max(axis=0).all(), "every strength counts"
    return end.u


def assert_same(found, expected):
    """Displacements and their derivatives, each against its largest."""
    np.testing.assert_allclose((found - expected) / np.abs(expected).max(axis=0), 0.0, atol=1e-6)


@pytest.mark.parametrize("planes", [None, 16])
def test_cohesion_and_tension_each_grow_their_own_way(planes):
    """With no gradient both are the numbers of uniform ground, with their derivatives."""
    own = {"phi": radians(25), "planes": planes}
    known = parameters(c=300e3, T=60e3)
    c, T = Scalar(1.0, "c"), Scalar(1.0, "T")
    still = WithDepth(Scalar(0.0), Scalar(0.0))
    uniform = opened(mohr(c, tension=T, **own), parameters=known)
    for grown in (["cohesion"], ["tension"], ["cohesion", "tension"]):
        growths = [grows(name, {"cohesion": c, "tension": T}[name], still) for name in grown]
        growths = [replace(growth, material="rock") for growth in growths]
        found = opened(mohr(c, tension=T, **own), *growths, parameters=known)
        assert_same(found, uniform)


def test_strength_of_hoek_brown_grows():
    """Scaled from a typical number it is that of uniform ground, with its derivative."""
    surface = hoek(Scalar(1.0, "sigci"), psi=0.0, mi=10.0, GSI=40.0, D=0.0)
    known = parameters(sigci=3e6)
    still = WithDepth(Scalar(0.0), Scalar(0.0))
    growth = Growth("rock", "sigci", Scalar(1.0, "sigci"), still, surface=0)
    settings = {"parameters": known, "stress": (-1e6,) * 3}
    uniform = opened(surface, **settings)
    found = opened(surface, growth, **settings)
    assert_same(found, uniform)


def bearing_capacity(at, growth, half, *, step=0.03, fan=24):
    """Mean pressure under a rigid smooth strip of some half width on c = at + growth z, at failure.

    By slip lines: E. H. Davis and J. R. Booker (1973), The effect of increasing strength with depth
    on the bearing capacity of clays, Geotechnique 23. With the mean stress p, the angle theta of
    the larger stress with x, outwards from the edge, and z down,

        dp + 2 c dtheta = growth dx  along dz/dx = tan(theta + 45 deg) ,
        dp - 2 c dtheta = -growth dx  along dz/dx = tan(theta - 45 deg) .

    Lines of the second kind come from the free surface (theta = 0, p = c), cross the fan at the
    edge and end under the strip (theta = 90 deg); points are rows x, z, p, theta.
    """

    def crossed(second, first):
        new = 0.5 * (first + second)
        for _ in range(12):
            turns = 0.5 * (first[3] + new[3]) + pi / 4, 0.5 * (second[3] + new[3]) - pi / 4
            d1, d2 = (np.array([cos(t), sin(t)]) for t in turns)
            along = np.linalg.solve(np.column_stack([d1, -d2]), second[:2] - first[:2])
            x, z = first[:2] + along[0] * d1
            c1, c2 = (at + growth * 0.5 * (z + one[1]) for one in (first, second))
            a = first[2] + 2 * c1 * first[3] + growth * (x - first[0])
            b = second[2] - 2 * c2 * second[3] - growth * (x - second[0])
            theta = (a - b) / (2 * (c1 + c2))
            new = np.array([x, z, a - 2 * c1 * theta, theta])
        return new

    def under_strip(point):
        theta, c = pi / 2, at + 0.5 * growth * point[1]
        x = point[0] - point[1] / np.tan(0.5 * (point[3] + theta) - pi / 4)
        return np.array(
            [x, 0.0, point[2] + 2 * c * (theta - point[3]) - growth * (x - point[0]), theta]
        )

    angles = 0.5 * pi * np.arange(fan + 1) / fan
    line = [np.array([0.0, 0.0, at * (1 + 2 * angle), angle]) for angle in angles]
    ends, n = [line[-1]], 0
    while ends[-1][0] > -half:
        n += 1
        new = [np.array([n * step * half, 0.0, at, 0.0])]
        for point in line:
            new.append(crossed(new[-1], point))
        line = [*new, under_strip(new[-1])]
        ends.append(line[-1])
    x, p = np.array(ends)[:, 0], np.array(ends)[:, 2]
    places = np.linspace(-half, 0.0, 400)
    return np.interp(places, x[::-1], p[::-1]).mean() + at


def test_slip_lines_give_what_is_known():
    """Prandtl's factor in uniform clay; Davis and Booker's chart has 1.2 to 1.3 at k B / c = 4."""
    assert bearing_capacity(1.0, 0.0, 1.0) == pytest.approx(2 + pi, rel=1e-3)
    factor = bearing_capacity(1.0, 2.0, 1.0) / (2 + pi + 2.0 * 2.0 / 4)
    assert 1.15 < factor < 1.35


def test_bearing_capacity_of_clay_whose_strength_grows(verification):
    """A strip pressed into the ground by 3 % of its width; elements bear a little too much."""
    at, growth, half, size = 10e3, 10e3, 1.0, (4.0, 2.5)
    x = half * np.concatenate(
        [1 - np.linspace(1, 0, 11) ** 1.8, 1 + 3 * np.linspace(0, 1, 11)[1:] ** 1.7]
    )
    y = size[1] * (1 - np.linspace(1, 0, 17) ** 1.7)
    mesh = from_grid(
        "tri6", np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2), (20, 16)
    )
    (faces,) = (mesh.points[block.nodes] for block in mesh.facets)
    strip = np.all((faces[..., 1] > size[1] - 1e-9) & (faces[..., 0] < half + 1e-9), axis=1)
    groups = {**mesh.facet_groups, "strip": np.flatnonzero(strip)}
    mesh = replace(mesh, facet_groups=groups)
    clay = replace(
        rock(3e6, 0.49, mohr(at, 0.0), name="soil"),
        growths=(grows("cohesion", Scalar(at), WithDepth(Scalar(growth), Scalar(size[1]))),),
    )
    staged = model(
        mesh,
        materials={"soil": clay},
        groups={"all": "soil"},
        supports=(Support("x0", (0,)), Support("x1", (0,)), Support("y0", (0, 1))),
        stages=tuple(
            Stage(
                f"{mm}",
                supports={"strip": Support("strip", (1,), motions=((1, Scalar(-mm / 1e3)),))},
            )
            for mm in (5, 10, 20, 40, 60)
        ),
    )
    end = analysed(staged)[-1]
    points = staged.discretization.points
    # virtual work of the motion y / height, which is 1 at the strip and 0 at the base
    force = -(end.stress[1, :, 0] * points.volume).sum() / size[1]
    exact = bearing_capacity(at, growth, half)
    assert 1.0 < force / half / exact < 1.03
    verification("growing-footing", "tri6", ["bearing"], exact=exact, found=force / half)


def test_tension_that_its_cohesion_does_not_leave_is_refused_where_it_is():
    """c / tan(phi) is 5.5 kPa at the top, less than the tension there."""
    growth = grows("cohesion", Scalar(2e3), WithDepth(Scalar(1e3), Scalar(DEPTH)))
    with pytest.raises(InputError) as caught:
        column(mohr(2e3, radians(20), tension=10e3), growth)
    assert "the tension of soil, 10 kPa, is not less than c / tan(phi)" in str(caught.value)
    column(mohr(2e3, radians(20), tension=5e3), growth)

"""Factors of safety against limit analysis and published strength reduction."""

from __future__ import annotations

from math import atan, degrees, pi, radians, tan

import numpy as np
import pytest
from support.cases import model, rollers
from support.meshes import from_grid, opening, regroup
from support.tunnels import walled, with_wall
from support.yielding import NOTHING, cylinder, mohr, rock

from geoident.forward.safety.search import Search, safety_factors
from geoident.model.actions import Pressure
from geoident.model.case import Analysis, Stage, Support
from geoident.model.parameter import Scalar
from tests.forward.yielding.test_limit_loads import strip_of

A, B, C = 1.0, 2.0, 10e6
LIMIT = 2 * C * np.log(B / A)


def failure_of(staged, **search):
    """The factor of safety, and how the ground fails."""
    ((found, mechanism),) = safety_factors(staged, NOTHING, [1], Search(**search))
    return found, mechanism


def factor_of(staged, **search):
    return failure_of(staged, **search)[0]


@pytest.mark.parametrize("exact", [1.6, pytest.param(0.75, marks=pytest.mark.slow)])
def test_thick_tresca_cylinder(exact, verification):
    """Its limit pressure by the pressure that acts; also of one that bursts as it is."""
    mesh = walled("quad8", n=3, layers=6, radius=A, reach=B)
    found = factor_of(cylinder(mesh, [LIMIT / exact], mohr(C, 0.0), E=10e9, nu=0.3))
    assert found.value == pytest.approx(exact, rel=0.01)
    assert found.proven or exact < 1.0  # there the ground flows too far first
    variant = f"quad8, 18 elements, pressure {1 / exact:.3g} of the limit"
    verification("safety", variant, ["cylinder"], exact=exact, found=found.value)


def slope(n, c: float, phi: float, *, psi: float | None = None, run: float = 2.0, crest=12.0):
    """A slope of 10 m on a firm base, its soil of 20 kN/m3 placed at once."""
    grid = np.stack(np.meshgrid(np.linspace(0, 1, n[0] + 1), np.linspace(0, 10, n[1] + 1),
                                indexing="ij"), -1).reshape(-1, 2)  # fmt: skip
    grid[:, 0] *= crest + run * (10.0 - grid[:, 1])
    surface = mohr(c, radians(phi), psi=None if psi is None else radians(psi))
    return model(
        from_grid("tri6", grid, n),
        materials={"soil": rock(1e8, 0.3, surface, name="soil", density=20e3 / 9.81)},
        groups={"all": None},
        supports=(Support("x0", (0,)), Support("y0", (0, 1))),
        gravity=(0.0, -9.81),
        stages=(Stage("build", install={"all": "soil"}),),
    )


@pytest.mark.slow  # the uniform blocks and the cylinder
@pytest.mark.parametrize("psi", [None, 0.0])
def test_slope_of_griffiths_and_lane(psi, verification):
    """2:1, phi 20 degrees, c / (gamma H) = 0.05: 1.4, and 1.38 by Bishop and Morgenstern (1960)."""
    found, mechanism = failure_of(slope((16, 10), 10e3, 20.0, psi=psi))
    assert found.value == pytest.approx(1.4, rel=0.015)
    variant = "tri6, 320 elements" + ("" if psi is None else ", dilation 0")
    verification("safety", variant, ["slope 2:1"], exact=1.4, found=found.value)
    assert "near" in found.place
    low, high = mechanism.mesh.points.min(axis=0), mechanism.mesh.points.max(axis=0)
    moving = np.linalg.norm(mechanism.velocity, axis=1) > 0.3
    where = mechanism.mesh.points[moving]
    assert where[:, 0].min() > low[0] + 5.0  # the wedge behind the crest stays
    assert where[:, 0].max() > high[0] - 3.0  # it comes out at the toe


@pytest.mark.slow
def test_vertical_cut_in_tresca_soil(verification):
    """gamma H / c_u is between 3.76 and 3.78 by bounds of limit analysis.

    Meshes carry more, by twice as much with elements of twice the size.
    """
    exact, c = 3.77 / 4, 50e3
    coarse, fine = (
        factor_of(slope((n, n), c, 0.0, run=0.0, crest=12.0)).value / exact for n in (10, 20)
    )
    assert coarse > fine
    assert 1.0 < fine < 1.05
    assert (coarse - 1.0) / (fine - 1.0) == pytest.approx(2.0, abs=0.4)
    found = fine * exact
    verification("safety", "tri6, 800 elements", ["vertical cut"], exact=exact, found=found)


@pytest.mark.slow  # the cylinder
@pytest.mark.parametrize(
    ("beta", "phi", "N", "n"),
    [
        (60, 20, 10.39, 6),
        (45, 20, 16.16, 6),
        (45, 10, 9.31, 8),
        (60, 10, 7.26, 8),
        (90, 10, 4.58, 10),
        (60, 0, 5.25, 10),
    ],
)
def test_stability_numbers_of_slopes(beta, phi, N, n, verification):
    """N = gamma H / c at failure (Taylor 1937, Chen 1975), with 1.5 times the strength.

    Meshes carry more, by half as much with elements of half the size.
    """
    exact, run = 1.5, 1 / tan(radians(beta)) if beta < 90 else 0.0
    c, friction = exact * 20e3 * 10.0 / N, degrees(atan(exact * tan(radians(phi))))
    coarse, fine = (
        factor_of(slope((k, k), c, friction, run=run, crest=10.0 - 0.2 * phi), guess=1.03 * exact,
                  tolerance=0.004).value
        for k in (n, 2 * n)
    )  # fmt: skip
    assert 2.0 * fine - coarse == pytest.approx(exact, rel=0.02)
    assert exact < fine < 1.05 * exact
    place = f"slope {beta} deg, phi {phi} deg"
    variant = f"{place}, tri6, {8 * n * n} elements"
    verification("safety", variant, [place], exact=exact, found=fine)


@pytest.mark.slow
def test_rough_circular_footing(verification):
    """6.05 c of Eason and Shield (1960) by what acts.

    At its edge strains have no bound: that does not end the search before the ground collapses.
    """
    steps, exact = np.linspace(0.0, 1.0, 17), 1.5
    x, y = np.concatenate([steps, 1.0 + 2.0 * steps[1:] ** 1.5]), -2.0 * steps[::-1] ** 1.5
    grid = np.stack(np.meshgrid(x, np.append(y, 0.3), indexing="ij"), -1).reshape(-1, 2)
    mesh = regroup(
        strip_of(from_grid("tri6", grid, (len(x) - 1, len(y))), 1.0, 0.3),
        air=lambda at: (at[:, 1] > 0.0) & (at[:, 0] > 1.0),
        plate=lambda at: at[:, 1] > 0.0,
    )
    clay, load = (
        rock(2e10, 0.3, mohr(C, 0.0), name="clay"),
        Pressure("strip", Scalar(6.05 * C / exact)),
    )
    staged = model(
        mesh,
        analysis=Analysis.AXISYMMETRIC,
        materials={"clay": clay, "steel": rock(1e15, 0.2, name="steel")},
        groups={"air": None, "rock": "clay", "plate": "steel"},
        supports=(Support("x0", (0,)), Support("x1", (0,)), Support("y0", (0, 1))),
        stages=(Stage("press", loads={"p": load}),),
    )
    found = factor_of(staged, guess=exact)
    assert found.proven
    assert exact < found.value < 1.04 * exact
    variant = "tri6, axisymmetric, 1024 elements"
    verification("safety", variant, ["circular footing"], exact=exact, found=found.value)


@pytest.mark.slow
def test_strip_footing():
    """Prandtl's (2 + pi) c by what acts; a mesh of 280 triangles carries 1 to 3 % more."""
    from tests.forward.yielding.test_limit_loads import footing  # noqa: PLC0415

    found = factor_of(footing("tri6", (2 + pi) / 1.5, 0.0, fine=4, coarse=10, rows=10))
    assert found.value == pytest.approx(1.5, rel=0.03)


@pytest.mark.parametrize(
    ("analysis", "mesh"),
    [
        pytest.param(
            Analysis.AXISYMMETRIC, {"kind": "quad8", "n": 3, "layers": 8}, marks=pytest.mark.slow
        ),
        pytest.param(
            Analysis.SOLID, {"kind": "hex20", "n": 1, "layers": 4}, marks=pytest.mark.slow
        ),
        (Analysis.AXISYMMETRIC, {"kind": "quad8", "n": 2, "layers": 4}),
    ],
)
def test_thick_tresca_sphere(analysis, mesh, verification):
    """4 c ln(b / a) by the pressure inside, about an axis and in space.

    The coarsest one locks: there are equilibria with any strength, but metres away.
    """
    exact, dim = 1.6, analysis.dim
    sphere = opening(dim=dim, radius=A, reach=B, **mesh)
    load = Pressure("wall", Scalar(4 * C * np.log(B / A) / exact))
    staged = model(
        with_wall(sphere, A),
        analysis=analysis,
        materials={"rock": rock(10e9, 0.3, mohr(C, 0.0))},
        groups={"core": None, "rock": "rock"},
        supports=rollers(dim),
        stages=(Stage("press", loads={"p": load}),),
    )
    found = factor_of(staged)
    assert found.value == pytest.approx(exact, rel=0.015)
    assert found.proven or mesh["layers"] == 4
    variant = f"{mesh['kind']}, {analysis.value}, {mesh['layers']} layers"
    verification("safety", variant, ["sphere"], exact=exact, found=found.value)


@pytest.mark.slow  # in space
def test_a_slice_in_space_has_the_factor_of_plane_strain():
    """A vertical cut of one layer of hex20 between two smooth planes, on the same grid."""
    n, c = 3, 50e3
    grids = [np.linspace(0, 12, n + 1), np.linspace(0, 10, n + 1), np.array([0.0, 2.0])]

    def cut(kind: str, dim: int):
        points = np.stack(np.meshgrid(*grids[:dim], indexing="ij"), -1).reshape(-1, dim)
        sides = (Support("z0", (2,)), Support("z1", (2,))) if dim == 3 else ()
        return model(
            from_grid(kind, points, (n, n, 1)[:dim]),
            analysis=Analysis.SOLID if dim == 3 else Analysis.PLANE_STRAIN,
            materials={"soil": rock(1e8, 0.3, mohr(c, 0.0), name="soil", density=20e3 / 9.81)},
            groups={"all": None},
            supports=(Support("x0", (0,)), Support("y0", tuple(range(dim))), *sides),
            gravity=(0.0, -9.81, 0.0)[:dim],
            stages=(Stage("build", install={"all": "soil"}),),
        )

    cuts = cut("quad8", 2), cut("hex20", 3)
    plane, space = (factor_of(one, tolerance=0.002) for one in cuts)
    assert space.value == pytest.approx(plane.value, rel=0.004)


@pytest.mark.slow
def test_slope_of_the_acads_review(verification):
    """Example 1(a): c = 3 kPa, phi = 19.6 degrees, 20 kN/m3, 2:1, 10 m above 5 m of soil: 1.00."""
    x = np.concatenate([np.linspace(20, 30, 5), np.linspace(30, 70, 21)[1:]])
    y = np.concatenate([np.linspace(20, 25, 4), np.linspace(25, 35, 11)[1:]])
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)
    rise = np.maximum(grid[:, 1] - 25.0, 0.0)
    beyond = np.where(grid[:, 0] < 30.0, (grid[:, 0] - 20) / 10, (70 - grid[:, 0]) / 40)
    grid[:, 0] += 2.0 * rise * beyond  # the toe line leans with the face

    def air(centre):
        return (centre[:, 1] > 25.0) & (centre[:, 0] < 30.0 + 2.0 * (centre[:, 1] - 25.0))

    soil = rock(1e8, 0.3, mohr(3e3, radians(19.6)), name="soil", density=20e3 / 9.81)
    staged = model(
        regroup(from_grid("tri6", grid, (len(x) - 1, len(y) - 1)), air=air),
        materials={"soil": soil},
        groups={"air": None, "rock": None},
        supports=(Support("x0", (0,)), Support("x1", (0,)), Support("y0", (0, 1))),
        gravity=(0.0, -9.81),
        stages=(Stage("build", install={"rock": "soil"}),),
    )
    found = factor_of(staged)
    assert found.value == pytest.approx(1.0, rel=0.025)
    verification("safety", "tri6, ACADS 1(a)", ["ACADS 1(a)"], exact=1.0, found=found.value)

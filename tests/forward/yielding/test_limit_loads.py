"""Loads at which ground collapses, against limit analysis; what is carried below them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from support.cases import model
from support.closed_forms import lame_cylinder, tresca_cylinder
from support.meshes import from_grid
from support.tunnels import walled
from support.yielding import NOTHING, analysed, cylinder, mohr, rock

from geoident.errors import CollapseError
from geoident.forward.model import StagedModel
from geoident.model.actions import Pressure
from geoident.model.case import Stage, Support
from geoident.model.mesh import Mesh
from geoident.model.parameter import Scalar

A, B, C, E, NU = 1.0, 2.0, 10e6, 10e9, 0.3
LIMIT = 2 * C * np.log(B / A)
SHAPE = {"n": 6, "layers": 12, "radius": A, "reach": B}


def collapse_of(staged) -> CollapseError:
    with pytest.raises(CollapseError) as caught:
        staged.survey(NOTHING, fields=False)
    return caught.value


@pytest.mark.parametrize(
    ("kind", "planes"),
    [
        ("tri6", None),
        *(pytest.param(*given, marks=pytest.mark.slow)
          for given in (("tri6", 32), ("quad8", None), ("quad8", 32))),
    ],
)  # fmt: skip
def test_limit_pressure_of_a_thick_tresca_cylinder(kind, planes, verification):
    """12 elements around a quarter, 12 rings."""
    mesh = walled(kind, **SHAPE)
    found = collapse_of(cylinder(mesh, [1.2 * LIMIT], mohr(C, 0.0, planes=planes), E=E, nu=NU))
    assert 1.2 * found.fraction == pytest.approx(1.0, rel=0.01)
    variant = f"{kind}, {f'{planes} planes' if planes else 'smooth'}"
    limit = 1.2 * found.fraction * LIMIT
    verification("tresca-limit", variant, ["limit pressure"], exact=LIMIT, found=limit)
    below = cylinder(mesh, [0.99 * LIMIT], mohr(C, 0.0, planes=planes), E=E, nu=NU)
    moved = below.survey(NOTHING, fields=True).fields.displacement[-1]
    assert np.abs(moved).max() > 2 * lame_cylinder(A, inner=A, outer=B, pressure=LIMIT, E=E, nu=NU)


@pytest.mark.parametrize("edge", [1.2, 1.5, 1.8])
def test_outer_face_of_a_partly_plastic_cylinder(edge, verification):
    pressure, exact = tresca_cylinder(inner=A, outer=B, edge=edge, c=C, E=E, nu=NU)
    mesh = walled("quad8", **SHAPE)
    staged = cylinder(mesh, [pressure], mohr(C, 0.0), E=E, nu=NU)
    standing = analysed(staged)[-1]
    r = np.linalg.norm(mesh.points, axis=1)
    outer = np.abs(r - B) < 1e-9
    moved = np.linalg.norm(standing.u[:, 0].reshape(-1, 2)[outer], axis=1)
    np.testing.assert_allclose(moved, exact, rtol=0.003)
    variant = f"plastic to {edge:g} m"
    verification("tresca-cylinder", variant, ["outer face"], exact=exact, found=moved.mean())
    flows = np.linalg.norm(staged.discretization.points.position[standing.yielded], axis=1).max()
    assert flows == pytest.approx(edge, abs=0.04)


def strip_of(mesh: Mesh, half: float, top: float) -> Mesh:
    """The mesh with the group ``strip`` of the faces on its top from x = 0 to half."""
    points = mesh.points[np.concatenate([b.nodes[:, :2] for b in mesh.facets])]
    level = np.all(np.abs(points[..., 1] - top) < 1e-9, axis=1)
    inside = np.all(points[..., 0] < half + 1e-9, axis=1)
    return replace(
        mesh, facet_groups={**mesh.facet_groups, "strip": np.flatnonzero(level & inside)}
    )


def graded(first: float, reach: float, *, fine: int, coarse: int) -> np.ndarray:
    """Coordinates from 0 to first, finer to its end, and on to reach in growing steps."""
    inner = first * (1 - np.linspace(1, 0, fine + 1) ** 1.8)
    step = inner[-1] - inner[-2]
    growth = brentq(lambda g: step * (g**coarse - 1) / (g - 1) - (reach - first), 1.001, 3.0)
    steps = step * growth ** np.arange(coarse)
    return np.concatenate([inner, first + np.cumsum(steps)])


def footing(kind: str, load: float, phi: float, **more) -> StagedModel:
    """Half of a smooth flexible strip of half width 1 m on weightless ground with c = 1 Pa."""
    wide, deep = more.get("size", (6.0, 4.0))
    x = graded(1.0, wide, fine=more["fine"], coarse=more["coarse"])
    y = deep * (1 - np.linspace(1, 0, more["rows"] + 1) ** 1.7)
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)
    mesh = strip_of(from_grid(kind, grid, (len(x) - 1, len(y) - 1)), 1.0, deep)
    return model(
        mesh,
        materials={"rock": rock(1e3, 0.3, mohr(1.0, phi))},
        groups={"all": "rock"},
        supports=(Support("x0", (0,)), Support("x1", (0,)), Support("y0", (0, 1))),
        stages=(Stage("load", loads={"p": Pressure("strip", Scalar(load))}),),
    )


def bearing(phi: float) -> float:
    """Prandtl's (1921) factor N_c of a strip on weightless ground: 2 + pi without friction."""
    if phi == 0.0:
        return 2 + np.pi
    return (np.exp(np.pi * np.tan(phi)) * np.tan(np.pi / 4 + phi / 2) ** 2 - 1) / np.tan(phi)


@pytest.mark.slow  # a limit load: the cylinder above
def test_prandtl_footing(verification):
    """280 triangles, four under half of the strip, refined towards its edge; an upper bound."""
    exact = bearing(0.0)
    found = collapse_of(footing("tri6", 1.2 * exact, 0.0, fine=4, coarse=10, rows=10))
    assert 1.2 * found.fraction == pytest.approx(1.0, rel=0.03)
    limit = 1.2 * found.fraction * exact
    verification("footing", "tri6, 280 elements", ["no friction"], exact=exact, found=limit)
    footing("tri6", 0.99 * exact, 0.0, fine=4, coarse=10, rows=10).survey(NOTHING, fields=False)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["tri6", "quad8"])
def test_prandtl_footing_approaches_the_exact_factor(kind, verification):
    """224 quadrilaterals or 448 triangles."""
    found = collapse_of(footing(kind, 1.2 * bearing(0.0), 0.0, fine=6, coarse=10, rows=14))
    assert 1.2 * found.fraction == pytest.approx(1.0, rel=0.015)
    limit = 1.2 * found.fraction * bearing(0.0)
    verification("footing", f"{kind}, finer", ["no friction"], exact=bearing(0.0), found=limit)


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [20.0, 25.0])
def test_footing_with_friction(degrees, verification):
    phi = np.radians(degrees)
    size = {20.0: (8.0, 4.0), 25.0: (12.0, 6.0)}[degrees]
    shape = {"fine": 6, "coarse": 12, "rows": 14, "size": size}
    found = collapse_of(footing("tri6", 1.3 * bearing(phi), phi, **shape))
    assert 1.3 * found.fraction == pytest.approx(1.0, rel=0.05)
    variant, limit = f"tri6, {degrees:g} degrees", 1.3 * found.fraction * bearing(phi)
    verification("footing", variant, ["friction"], exact=bearing(phi), found=limit)

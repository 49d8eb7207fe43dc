"""Axisymmetric analyses against closed forms, plane and solid models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import material, model, rollers
from support.closed_forms import (
    circular_load,
    lame_cylinder,
    lift_settlement,
    rigid_plate,
    spherical_cavity,
)
from support.meshes import KINDS_2D, from_grid, opening, regroup
from support.revolved import constant, fields, section

from geoident.fem.elements import reference_element
from geoident.model.actions import Pressure
from geoident.model.case import Material, Stage, Support
from geoident.model.ground import Axes, TransverselyIsotropic
from geoident.model.in_situ import ConstantStress
from geoident.model.mesh import ElementBlock, Mesh
from geoident.model.parameter import Scalar

E, NU = 10e9, 0.22
ROCK = material("rock", E, NU)
kinds = pytest.mark.parametrize("kind", KINDS_2D)


INNER, OUTER, PUSH = 1.0, 3.0, 5e6


def pressed_section(kind: str, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Radii and radial displacements of a slice of the cylinder in the r-z plane."""
    mesh = section(kind, (n, n // 4), (OUTER - INNER, 0.5), inner=INNER)
    result = fields(
        mesh,
        materials={"rock": ROCK},
        groups={"all": "rock"},
        supports=(Support("y0", (1,)), Support("y1", (1,))),
        stages=(Stage("press", loads={"p": Pressure("x0", Scalar(PUSH))}),),
    )
    return mesh.points[:, 0], result.displacement[-1][:, 0]


def pressed_quarter(kind: str, n: int) -> tuple[np.ndarray, np.ndarray]:
    """The same of a quarter of the cylinder in plan, plane strain."""
    grid = np.stack(np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1), indexing="ij"))
    flat = from_grid(kind, grid.reshape(2, -1).T, (n, n))
    r, angle = INNER + flat.points[:, 0] * (OUTER - INNER), flat.points[:, 1] * np.pi / 2
    mesh = replace(flat, points=np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1))
    result = (
        model(
            mesh,
            materials={"rock": ROCK},
            groups={"all": "rock"},
            supports=(Support("y0", (1,)), Support("y1", (0,))),
            stages=(Stage("press", loads={"p": Pressure("x0", Scalar(PUSH))}),),
        )
        .survey(np.empty(0), fields=True)
        .fields
    )
    return r, np.linalg.norm(result.displacement[-1], axis=1)


def lame_error(found: tuple[np.ndarray, np.ndarray]) -> float:
    exact = lame_cylinder(found[0], inner=INNER, outer=OUTER, pressure=PUSH, E=E, nu=NU)
    return float(np.abs(found[1] - exact).max() / np.abs(exact).max())


LAME_AT_16 = {"tri3": 1e-2, "tri6": 2e-4, "quad4": 3e-3, "quad8": 1e-5}


@kinds
def test_thick_cylinder_agrees_with_lame_and_converges(kind, verification):
    sections = [pressed_section(kind, n) for n in (16, 32)]
    coarse, fine = map(lame_error, sections)
    assert coarse < LAME_AT_16[kind]
    assert np.log2(coarse / fine) > reference_element(kind).cell.order + 1 - 0.5
    r, at = np.unique(sections[0][0], return_index=True)
    exact = lame_cylinder(r, inner=INNER, outer=OUTER, pressure=PUSH, E=E, nu=NU)
    verification("lame", kind, r, exact=exact, found=sections[0][1][at])


@kinds
def test_thick_cylinder_in_plan_is_the_same_cylinder(kind):
    """Plane strain, whose elements cut the circle off, meets the same closed form."""
    assert lame_error(pressed_quarter(kind, 16)) < 3 * LAME_AT_16[kind]


RADIUS = 2.0
CAVITY = {"groups": {"core": "rock", "rock": "rock"}, "stages": (Stage("o", excavate=("core",)),)}


def cavity(
    kind: str, n: int, layers: int, reach: float, stress: tuple[float, float], rock: Material = ROCK
):
    """Nodes of the wall and their displacements: a cavity opened in ground stressed (rr, axial)."""
    mesh = opening(kind, 2, n=n, layers=layers, radius=RADIUS, reach=reach * RADIUS)
    result = fields(
        mesh,
        materials={"rock": rock},
        supports=(Support("y0", (1,)),),
        in_situ=constant(stress[0], stress[1], stress[0]),
        **CAVITY,
    )
    r = np.linalg.norm(mesh.points, axis=1)
    wall = np.flatnonzero(np.abs(r - RADIUS) < 1e-9)
    return mesh.points[wall], result.displacement[-1][wall]


def goodier(points: np.ndarray, stress: tuple[float, float]) -> np.ndarray:
    """Displacements (n, 2) of the closed form in the r-z plane."""
    solid = np.stack([points[:, 0], 0 * points[:, 0], points[:, 1]], axis=1)
    three = (stress[0], stress[0], stress[1])
    return spherical_cavity(solid, radius=RADIUS, E=E, nu=NU, stress=three)[:, [0, 2]]


CAVITY_MESHES = {"tri3": (32, 96), "tri6": (12, 36), "quad4": (16, 48), "quad8": (8, 24)}
CAVITY_ERRORS = {"tri3": 1e-2, "tri6": 1e-3, "quad4": 5e-3, "quad8": 2e-4}


def cavity_error(kind: str, n: int, layers: int, stress: tuple[float, float]) -> float:
    points, u = cavity(kind, n, layers, 30, stress)
    return error_of_wall(u, goodier(points, stress))


def error_of_wall(u: np.ndarray, exact: np.ndarray) -> float:
    return np.linalg.norm(u - exact, axis=1).max() / np.linalg.norm(exact, axis=1).max()


@pytest.mark.parametrize("stress", [(-6e6, -6e6), (-6e6, -12e6)], ids=["hydrostatic", "two"])
@kinds
def test_spherical_cavity_agrees_with_goodier_and_converges(kind, stress, verification):
    n, layers = CAVITY_MESHES[kind]
    points, u = cavity(kind, n, layers, 30, stress)
    exact = goodier(points, stress)
    fine = error_of_wall(u, exact)
    if stress[0] != stress[1]:
        angle = np.degrees(np.arctan2(points[:, 1], points[:, 0]))
        sizes = {"exact": np.linalg.norm(exact, axis=1), "found": np.linalg.norm(u, axis=1)}
        verification("sphere-about-axis", kind, angle, **sizes)
    assert fine < CAVITY_ERRORS[kind]
    assert cavity_error(kind, n // 2, layers // 2, stress) > 3 * fine


def strata(vertical: int):
    """Flat strata with a normal along axis ``vertical``: softer across, and in shear."""
    axes = np.eye(3)[(vertical + 1) % 3], np.eye(3)[(vertical + 2) % 3]
    first, second = (tuple(map(float, axis)) for axis in axes)
    moduli = {"E_p": 10e9, "nu_p": 0.2, "E_n": 4e9, "nu_np": 0.15, "G_np": 2.2e9}
    scalars = {name: Scalar(value) for name, value in moduli.items()}
    return Material("rock", TransverselyIsotropic(**scalars, frame=Axes(first, second)))


@pytest.mark.parametrize("layered", [False, True], ids=["isotropic", "strata"])
def test_spherical_cavity_is_the_same_as_in_three_dimensions(layered):
    stress = (-6e6, -12e6)
    points, u = cavity("quad8", 3, 8, 12, stress, strata(1) if layered else ROCK)
    mesh = opening("hex20", 3, n=3, layers=8, radius=RADIUS, reach=12 * RADIUS)
    zero = Scalar(0.0)
    three = ConstantStress((Scalar(stress[0]), Scalar(stress[0]), Scalar(stress[1]), *[zero] * 3))
    solid = model(
        mesh,
        materials={"rock": strata(2) if layered else ROCK},
        supports=rollers(3),
        in_situ=three,
        **CAVITY,
    ).survey(np.empty(0), fields=True)
    # On the plane y = 0 the octant has the nodes of the section.
    for place, moved in zip(points, u, strict=True):
        node = np.linalg.norm(mesh.points - [place[0], 0.0, place[1]], axis=1).argmin()
        np.testing.assert_allclose(mesh.points[node], [place[0], 0.0, place[1]], atol=1e-9)
        other = solid.fields.displacement[-1][node][[0, 2]]
        np.testing.assert_allclose(moved, other, atol=2e-3 * np.abs(u).max())


def half_space(kind: str, n: int, layers: int) -> Mesh:
    """A half-space y > 0 of 150 plate radii; the loaded face at y = 0 is the group ``plate``."""
    mesh = opening(kind, 2, n=n, layers=layers, radius=1.0, reach=150.0)
    faces = mesh.facets[0].nodes
    on_top = np.all(np.abs(mesh.points[faces][..., 1]) < 1e-9, axis=1)
    under = on_top & (mesh.points[faces][..., 0].max(axis=1) < 1 + 1e-9)
    far = np.linalg.norm(mesh.points[faces], axis=2).min(axis=1) > 150 * (1 - 1e-9)
    named = {"plate": np.flatnonzero(under), "far": np.flatnonzero(far)}
    return replace(mesh, facet_groups={**mesh.facet_groups, **named})


@kinds
def test_flexible_plate_on_a_half_space_within_one_percent(kind, verification):
    """150 radii of ground, whose fixed far edge takes half a percent off; 8 elements underneath.

    12 for the linear triangle.
    """
    mesh = half_space(kind, *((12, 60) if kind == "tri3" else (8, 40)))
    result = fields(
        mesh,
        materials={"rock": ROCK},
        groups={"core": "rock", "rock": "rock"},
        supports=(Support("far", (0, 1)),),
        stages=(Stage("load", loads={"q": Pressure("plate", Scalar(2e6))}),),
    )
    w = result.displacement[-1][:, 1]
    centre, rim = circular_load(radius=1.0, pressure=2e6, E=E, nu=NU)
    at = [np.linalg.norm(mesh.points - p, axis=1).argmin() for p in ([0.0, 0.0], [1.0, 0.0])]
    assert w[at[0]] == pytest.approx(centre, rel=0.01)
    assert w[at[1]] == pytest.approx(rim, rel=0.02)
    verification("flexible-plate", kind, ["centre", "rim"], exact=[centre, rim], found=w[at])


def plated(n: int, layers: int) -> Mesh:
    """The half-space of quad8 with a plate of 0.5 m on it, pressed on its outer face ``top``."""
    ground = half_space("quad8", n, layers)
    under = ground.facets[0].nodes[ground.facet_groups["plate"]]
    ends, every = np.unique(under[:, :2]), np.unique(under)
    first = len(ground.points)
    top, middle = np.zeros(first, int), np.zeros(first, int)
    top[every] = first + np.arange(len(every))
    middle[ends] = first + len(every) + np.arange(len(ends))
    a, b, between = under.T
    plate = np.stack([top[a], top[b], b, a, top[between], middle[b], between, middle[a]], axis=1)
    above = ground.points[every] - [0.0, 0.5], ground.points[ends] - [0.0, 0.25]
    nodes = np.vstack([ground.blocks[0].nodes, plate])
    lines = np.vstack([ground.facets[0].nodes, top[under]])
    return replace(
        ground,
        points=np.vstack([ground.points, *above]),
        blocks=(ElementBlock("quad8", nodes, np.arange(1, len(nodes) + 1)),),
        facets=(ElementBlock("line3", lines, np.arange(1, len(lines) + 1)),),
        groups={
            "rock": np.arange(ground.n_elements),
            "plate": np.arange(ground.n_elements, len(nodes)),
        },
        facet_groups={
            "far": ground.facet_groups["far"],
            "top": np.arange(len(lines) - len(under), len(lines)),
        },
    )


def test_rigid_plate_on_a_half_space_within_one_percent(verification):
    """The stress at the rim is singular, so the error falls as the element size: extrapolated."""
    settled = []
    for n in (8, 16):
        mesh = plated(n, 5 * n)
        result = fields(
            mesh,
            materials={"rock": ROCK, "steel": material("steel", 1e5 * E, 0.0)},
            groups={"rock": "rock", "plate": "steel"},
            supports=(Support("far", (0, 1)),),
            stages=(Stage("load", loads={"q": Pressure("top", Scalar(2e6))}),),
        )
        w = result.displacement[-1][:, 1]
        loaded = np.unique(mesh.facets[0].nodes[mesh.facet_groups["top"]])
        np.testing.assert_allclose(w[loaded], w[loaded[0]], rtol=1e-4)
        settled.append(w[loaded[0]])
    exact = rigid_plate(radius=1.0, force=2e6 * np.pi, E=E, nu=NU)
    assert 2 * settled[1] - settled[0] == pytest.approx(exact, rel=0.01)
    assert settled[1] == pytest.approx(exact, rel=0.02)
    found = [*settled, 2 * settled[1] - settled[0]]
    verification("rigid-plate", "", ["coarse", "fine", "extrapolated"], exact=exact, found=found)


@kinds
@pytest.mark.parametrize("inner", [0.0, 1.0])
def test_column_of_lifts_settles_in_a_parabola(kind, inner):
    n, height, density, g = 4, 2.0, 2100.0, 9.81
    mesh = section(kind, (2, n), (1.5, n * height), inner=inner)

    def lift(k):
        return lambda c: c[:, 1] < (k + 1) * height

    mesh = regroup(mesh, **{f"lift-{k}": lift(k) for k in range(n)})
    result = fields(
        mesh,
        materials={"fill": material("fill", E, NU, density)},
        groups={"lift-0": "fill"},
        supports=(Support("y0", (1,)), Support("x0", (0,)), Support("x1", (0,))),
        gravity=(0.0, -g),
        stages=(Stage("s0"), *(Stage(f"s{k}", install={f"lift-{k}": "fill"}) for k in range(1, n))),
    )
    modulus = E * (1 - NU) / ((1 + NU) * (1 - 2 * NU))
    exact = lift_settlement(n, height, density * g, modulus)
    exact[0] -= density * g * height**2 / modulus * 0.5
    # Linear triangles can't carry the weight straight down.
    tolerance = 0.06 if kind == "tri3" else 1e-10
    for k in range(n):
        top = np.isclose(mesh.points[:, 1], (k + 1) * height)
        np.testing.assert_allclose(-result.displacement[-1][top, 1], exact[k], rtol=tolerance)

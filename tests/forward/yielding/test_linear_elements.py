"""Elements of first order where ground flows: with the mean dilatation, or raised to second order.

Flow that keeps its volume at every point leaves linear elements hardly any motion (Nagtegaal,
Parks, Rice 1974). Quadrilaterals and hexahedra dilate alike at all their points where ground
yields; triangles and tetrahedra have one point each and need nodes on their edges.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.closed_forms import plastic_sphere
from support.meshes import with_outer_faces
from support.opening_grid import OpeningCase
from support.yielding import NOTHING, Cavity, analysed, mohr, mohr_limit

from geoident.fem.refinement.finer import raised
from geoident.forward.analysis.analysis import RunOptions
from geoident.model.case import Analysis, Support
from geoident.model.mesh import ElementBlock, Mesh

CAVITY, C, PHI = Cavity(), 3.45e6, np.pi / 6
SLICE = 0.05  # thickness, radii
flows = pytest.mark.parametrize("psi", [None, 0.0], ids=["associated", "psi = 0"])


def wall_of_circle(case: OpeningCase, *, order: int = 1) -> float:
    """Motion of the wall, in parts of the exact one."""
    mesh = case.mesh() if order == 1 else raised(case.mesh())
    staged = case.staged(mesh)
    end = list(staged.at(NOTHING, RunOptions(derivatives=False, explain=False)).states())[-1]
    return float(case.inwards(staged, end.u[:, 0])[0]) / case.closed_form()


@pytest.mark.parametrize(
    ("size", "friction", "cohesion", "allowed"),
    [
        (0.10, 30, 0.10, 0.03),  # -6.1 % without the mean dilatation
        (0.06, 30, 0.10, 0.01),  # -2.5 %
        (0.04, 20, 0.10, 0.01),  # -3.4 %
        (0.04, 20, 0.05, 0.02),  # -12.2 %: plastic to five radii
    ],
)
def test_quadrilaterals_do_not_lock_without_dilation(size, friction, cohesion, allowed):
    wall = wall_of_circle(OpeningCase("circle", "quad4", size, friction, 0.0, cohesion))
    assert abs(wall - 1.0) < allowed


@pytest.mark.parametrize("dilation", [0.0, 30.0])
def test_triangles_do_not_lock_once_raised_to_second_order(dilation):
    case = OpeningCase("circle", "tri3", 0.10, 30.0, dilation, 0.10)
    assert wall_of_circle(case) < 0.94
    assert abs(wall_of_circle(case, order=2) - 1.0) < (0.03 if dilation == 0.0 else 0.02)


def swept(kind: str, *, n: int, layers: int, reach: float) -> Mesh:
    """A quarter of a round opening along z, one element thick."""
    flat = CAVITY.mesh("quad4" if kind == "hex8" else "tri3", n=n, layers=layers, reach=reach)
    cells, lower = flat.blocks[0].nodes, flat.n_nodes
    if kind == "tet4":  # by ascending nodes, so that neighbours cut their common face alike
        a, b, c = np.sort(cells, axis=1).T
        d, e, f = a + lower, b + lower, c + lower
        nodes = np.stack([(a, b, c, f), (a, b, e, f), (a, d, e, f)]).transpose(2, 0, 1)
        nodes = nodes.reshape(-1, 4)
    else:
        nodes = np.hstack([cells, cells + lower])
    points = np.vstack([np.column_stack([flat.points, np.full(lower, z)]) for z in (0.0, SLICE)])
    block = ElementBlock(kind, nodes, np.arange(1, len(nodes) + 1))
    each = np.arange(len(nodes)).reshape(len(cells), -1)
    groups = {name: each[members].ravel() for name, members in flat.groups.items()}
    mesh = with_outer_faces(Mesh(points, (block,)))
    return replace(mesh, groups={**mesh.groups, **groups})


def wall_of_slice(mesh: Mesh, psi: float | None) -> np.ndarray:
    """Motion of the nodes of the wall, in parts of the exact one."""
    sides = (("x0", 0), ("y0", 1), ("z0", 2), ("z1", 2))
    supports = tuple(Support(side, (axis,)) for side, axis in sides)
    settings = {"analysis": Analysis.SOLID, "supports": supports}
    staged = CAVITY.staged(mesh, mohr(C, PHI, psi=psi), **settings)
    plan = mesh.points[:, :2]
    wall = np.abs(np.linalg.norm(plan, axis=1) - 1.0) < 1e-9
    u = analysed(staged)[-1].u[:, 0].reshape(-1, 3)[wall, :2]
    exact = CAVITY.closed_form(mohr_limit(C, PHI, psi)).displacement(np.array([1.0])).value[0]
    return np.sum(u * plan[wall], axis=1) / exact


@flows
def test_hexahedra_do_not_lock(psi):  # -6.1 and -1.8 % without the mean dilatation
    wall = wall_of_slice(swept("hex8", n=6, layers=40, reach=20.0), psi)
    np.testing.assert_allclose(wall, 1.0, atol=0.01)


@flows
@pytest.mark.parametrize("kind", ["tet4", "wedge6"])
def test_tetrahedra_and_wedges_do_not_lock_once_raised(kind, psi):
    mesh = swept(kind, n=4, layers=24, reach=20.0)
    assert wall_of_slice(mesh, psi).mean() < 0.95
    assert wall_of_slice(raised(mesh), psi).mean() == pytest.approx(1.0, abs=0.02)


@flows
def test_spherical_cavity_about_its_axis(psi):  # -17 and -6.5 % without the mean dilatation
    c, phi = 3e6, 0.4
    mesh = CAVITY.mesh("quad4", n=12, layers=80, reach=20.0)
    staged = CAVITY.staged(mesh, mohr(c, phi, psi=psi), analysis=Analysis.AXISYMMETRIC)
    _, exact = plastic_sphere(
        np.array([1.0]), radius=1.0, pressure=CAVITY.pressure, inner=0.0, E=CAVITY.E,
        nu=CAVITY.nu, c=c, phi=phi, psi=phi if psi is None else psi,
    )  # fmt: skip
    wall = CAVITY.outwards(staged, analysed(staged)[-1])
    assert wall.mean() == pytest.approx(exact[0], rel=0.02)

"""Openings in ground that yields, over kinds of elements, meshes, strengths and stresses.

Unstructured meshes of gmsh: of a quarter of a circle, and of one half of a horseshoe whose floor is
flat and whose corners are sharp.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from geoident.forward.model import StagedModel
from geoident.model.case import Stage, Support
from geoident.model.mesh import ElementBlock, Mesh
from geoident.model.parameter import Scalar
from support.meshes import elevate, with_outer_faces
from support.yielding import Cavity, constant, mohr, mohr_limit

REACH = {"circle": 100.0, "horseshoe": 20.0}
FLOOR = -0.8
GROWTH, LARGEST = 0.14, 0.1  # of elements with the distance; of the reach
CAVITY = Cavity(pressure=10e6, E=3e9, nu=0.25)


@dataclass(frozen=True)
class OpeningCase:
    """One opening.

    Args:
        shape: circle or horseshoe.
        kind: of the elements.
        size: of those at the wall, in radii.
        friction: degrees.
        dilation: degrees.
        cohesion: of the mean in-situ stress.
        K0: horizontal to vertical stress; their mean stays.
        released: parts of the stress, stage by stage.
    """

    shape: str
    kind: str
    size: float
    friction: float
    dilation: float
    cohesion: float
    K0: float = 1.0
    released: tuple[float, ...] = (1.0,)

    def staged(self, mesh: Mesh | None = None, **changes: Any) -> StagedModel:
        """The model, its stages without support, on its own or another mesh."""
        vertical = 2.0 * CAVITY.pressure / (1.0 + self.K0)
        stress = constant(-self.K0 * vertical, -vertical, -CAVITY.pressure)
        phi, psi = np.radians([self.friction, self.dilation])
        surface = mohr(self.cohesion * CAVITY.pressure, phi, psi=None if psi == phi else float(psi))
        stages = tuple(
            Stage(f"{part:.4g}", excavate=() if n else ("core",), release={"core": Scalar(part)})
            for n, part in enumerate(self.released)
        )
        sides = {"x0": 0, "x1": 0, "y0": 1, "y1": 1}
        held = ("x0", "y0") if self.shape == "circle" else tuple(sides)
        supports = tuple(Support(side, (sides[side],)) for side in held)
        settings = {"stages": stages, "supports": supports, "in_situ": stress, **changes}
        return CAVITY.staged(mesh or self.mesh(), surface, **settings)

    def mesh(self) -> Mesh:
        """Its mesh; middles of edges on the wall lie on its arch."""
        corners, cells, n_core = _cells(self.shape, self.kind.startswith("quad"), self.size)
        points = corners
        if self.kind in ("tri6", "quad8"):
            points, raised = elevate(corners, cells, self.kind)
            n = cells.shape[1]
            on_arch = np.abs(np.linalg.norm(corners, axis=1) - 1.0) < 1e-9
            on_arch &= (corners[:, 1] > -1e-9) | (self.shape == "circle")
            for edge in range(n):
                ends = cells[:, [edge, (edge + 1) % n]]
                middle = np.unique(raised[on_arch[ends].all(axis=1), n + edge])
                points[middle] /= np.linalg.norm(points[middle], axis=1)[:, None]
            cells = raised
        block = ElementBlock(self.kind, cells, np.arange(1, len(cells) + 1))
        mesh = with_outer_faces(Mesh(points, (block,)))
        core = np.arange(n_core)
        return replace(
            mesh, groups={**mesh.groups, "core": core, "rock": np.arange(n_core, len(cells))}
        )

    def inwards(self, staged: StagedModel, u: np.ndarray) -> np.ndarray:
        """Motion of the wall: mean of a circle; crown, floor and side of a horseshoe, m."""
        points = staged.mesh.points
        u = u.reshape(points.shape)
        if self.shape == "circle":
            wall = CAVITY.wall(staged)
            return np.array([-np.sum(u[wall] * points[wall], axis=1).mean()])

        def at(x: float, y: float) -> np.ndarray:
            return u[np.linalg.norm(points - (x, y), axis=1).argmin()]

        return np.array([-at(0.0, 1.0)[1], at(0.0, FLOOR)[1], -at(1.0, 0.0)[0]])

    def closed_form(self) -> float:
        """Motion of the wall of a circle inwards, m, with K0 = 1."""
        phi, psi = np.radians([self.friction, self.dilation])
        limit = mohr_limit(self.cohesion * CAVITY.pressure, phi, float(psi))
        state = CAVITY.closed_form(limit, self.released[-1])
        return -float(state.displacement(np.array([1.0])).value[0])


@cache
def _cells(shape: str, quads: bool, size: float) -> tuple[np.ndarray, np.ndarray, int]:
    """Corners, elements that turn left, and how many of these are the core, which come first."""
    try:
        import gmsh  # noqa: PLC0415 - where it is missing, tests are skipped
    except (ImportError, OSError):  # a library of the system that it needs
        pytest.skip("gmsh or an X library that it needs is missing: see README, Start")
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        surfaces = _geometry(gmsh.model.geo, shape, REACH[shape])
        gmsh.model.geo.synchronize()
        mesh = gmsh.model.mesh
        field = mesh.field.add("MathEval")
        largest = LARGEST * REACH[shape]
        grown = f"{size}+{GROWTH}*Max(sqrt(x*x+y*y)-1,0)"
        mesh.field.setString(field, "F", f"Min({grown},{largest})")
        mesh.field.setAsBackgroundMesh(field)
        for option in ("ExtendFromBoundary", "FromPoints", "FromCurvature"):
            gmsh.option.setNumber(f"Mesh.MeshSize{option}", 0)
        gmsh.option.setNumber("Mesh.RandomSeed", 2)
        gmsh.option.setNumber("Mesh.Algorithm", 8 if quads else 6)
        if quads:
            gmsh.option.setNumber("Mesh.RecombineAll", 1)
            gmsh.option.setNumber("Mesh.RecombinationAlgorithm", 3)
        mesh.generate(2)
        tags, xyz, _ = mesh.getNodes()
        places = np.zeros(int(tags.max()) + 1, dtype=np.int64)
        places[tags] = np.arange(len(tags))
        width, kind = (4, 3) if quads else (3, 2)
        parts = [
            places[mesh.getElementsByType(kind, one)[1]].reshape(-1, width) for one in surfaces
        ]
    finally:
        gmsh.finalize()
    used, cells = np.unique(np.concatenate(parts), return_inverse=True)
    points, cells = xyz.reshape(-1, 3)[used, :2], cells.reshape(-1, width)
    x, y = np.moveaxis(points[cells], 2, 0)
    area = (x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1)
    return points, np.where(area[:, None] < 0.0, cells[:, ::-1], cells), len(parts[0])


def _geometry(geo, shape: str, reach: float) -> tuple[int, int]:
    """Core and rock."""
    if shape == "circle":
        centre, right, top = geo.addPoint(0, 0, 0), geo.addPoint(1, 0, 0), geo.addPoint(0, 1, 0)
        wall = [geo.addCircleArc(right, centre, top)]
        inside = [geo.addLine(centre, right), *wall, geo.addLine(top, centre)]
        ends, outer = (right, top), ((reach, 0), (reach, reach), (0, reach))
    else:
        centre, right, top = geo.addPoint(0, 0, 0), geo.addPoint(1, 0, 0), geo.addPoint(0, 1, 0)
        floor, corner = geo.addPoint(0, FLOOR, 0), geo.addPoint(1, FLOOR, 0)
        wall = [
            geo.addLine(floor, corner),
            geo.addLine(corner, right),
            geo.addCircleArc(right, centre, top),
        ]
        inside = [*wall, geo.addLine(top, floor)]
        ends = (floor, top)
        outer = ((0, -reach), (reach, -reach), (reach, reach), (0, reach))
    path = [ends[0], *(geo.addPoint(x, y, 0) for x, y in outer), ends[1]]
    lines = [geo.addLine(a, b) for a, b in pairwise(path)]
    around = [*lines, *(-line for line in reversed(wall))]
    return tuple(geo.addPlaneSurface([geo.addCurveLoop(loop)]) for loop in (inside, around))

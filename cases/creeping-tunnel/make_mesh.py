"""Makes the mesh of the tunnel: a round opening and its lining in rings of quadrilaterals.

Shipped mesh:        python make_mesh.py
Mesh of the truth:   python make_mesh.py --size 0.4 --output fine.msh

The same call makes the same mesh. Needs gmsh (`pip install gmsh`). Lengths in m: x across, y
upwards, origin on the axis. Elements are of second order if not said otherwise.
"""

import sys
from math import ceil, cos, log, pi, sin
from pathlib import Path

import gmsh

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from mesh_script import QUADRILATERALS, mesh_file, read_options  # noqa: E402

RADIUS, SHELL, REACH = 4.0, 0.2, 100.0
AROUND, WALL = 16, 0.7  # elements around the opening, and the thickness of the first ring
GROWTH = 0.5  # of the rings, relative, per ring

geo = gmsh.model.geo


def ring(radius: float, centre: int) -> tuple[list[int], list[int]]:
    """Points every 45 degrees, anticlockwise from the right, and the arcs between them."""
    angles = [k * pi / 4 for k in range(8)]
    points = [geo.addPoint(radius * cos(a), radius * sin(a), 0) for a in angles]
    ends = zip(points, points[1:] + points[:1], strict=True)
    return points, [geo.addCircleArc(a, centre, b) for a, b in ends]


def sectors_between(inner: list[int], wall: list[int], outer: list[int], far: list[int]) -> tuple:
    """Eight sectors between two rings of points and arcs, and the rays between these."""
    rays = [geo.addLine(a, b) for a, b in zip(inner, outer, strict=True)]
    loops = [[rays[k], far[k], -rays[(k + 1) % 8], -wall[k]] for k in range(8)]
    return [geo.addPlaneSurface([geo.addCurveLoop(loop)]) for loop in loops], rays


def build(size: float) -> None:
    """The geometry with its groups."""
    centre = geo.addPoint(0, 0, 0)
    points, arcs = zip(*(ring(r, centre) for r in (RADIUS - SHELL, RADIUS, REACH)), strict=True)
    core = geo.addPlaneSurface([geo.addCurveLoop(arcs[0])])
    shell, across = sectors_between(points[0], arcs[0], points[1], arcs[1])
    rock, rays = sectors_between(points[1], arcs[1], points[2], arcs[2])
    for curve in (arc for circle in arcs for arc in circle):
        geo.mesh.setTransfiniteCurve(curve, ceil(AROUND / 8 / size) + 1)
    rings = log(1 + GROWTH * (REACH - RADIUS) / WALL) / log(1 + GROWTH)
    for ray in rays:
        growth = (1 + GROWTH) ** size
        geo.mesh.setTransfiniteCurve(ray, ceil(rings / size) + 1, "Progression", growth)
    for ray in across:
        geo.mesh.setTransfiniteCurve(ray, 2)
    for sector in shell + rock:
        geo.mesh.setTransfiniteSurface(sector)
        geo.mesh.setRecombine(2, sector)
    geo.synchronize()
    for name, surfaces in {"core": [core], "shell": shell, "rock": rock}.items():
        gmsh.model.addPhysicalGroup(2, surfaces, name=name)
    gmsh.model.addPhysicalGroup(1, arcs[2], name="far")
    gmsh.model.mesh.field.add("MathEval", 1)  # the opening, which leaves at once, coarsely
    gmsh.model.mesh.field.setString(1, "F", str(RADIUS))
    gmsh.model.mesh.field.setAsBackgroundMesh(1)


def main() -> None:
    options = read_options(__doc__, HERE / "tunnel.msh", order=2)
    with mesh_file(options, QUADRILATERALS):
        build(options.size)


if __name__ == "__main__":
    main()

"""Makes the mesh of the shaft: half of its section, six steps of sinking, two layers of rock.

Shipped mesh:        python make_mesh.py
Mesh of the truth:   python make_mesh.py --size 0.333 --output fine.msh

The same call makes the same mesh, mostly of quadrilaterals, with some triangles, all quadratic:
linear elements in a file of this size take half of the accuracy of the gauges. Needs gmsh
(`pip install gmsh`). Lengths in m: x is the radius, y upwards from the surface along the axis.
"""

import sys
from math import ceil
from pathlib import Path

import gmsh

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from mesh_script import QUADRILATERALS, grow, lines, mesh_file, read_options  # noqa: E402

RADIUS, LINING = 4.0, 0.4  # of the excavation; the concrete is inside
STEP, STEPS = 10.0, 6
LAYER = -30.0  # between upper and lower rock
FAR, BOTTOM = 130.0, -160.0
LEVELS = [-STEP * i for i in range(STEPS + 1)]
# element sizes at the wall and at the floors of the steps, and how they grow with the distance
WALL, CORNER, GROWTH = 1.2, 0.375, 0.18

geo = gmsh.model.geo


def surface(*loop: int) -> int:
    """A surface inside curves given in their order, anticlockwise."""
    return int(geo.addPlaneSurface([geo.addCurveLoop(list(loop))]))


def build(size: float) -> None:
    """The geometry with its groups."""
    rows = [[geo.addPoint(x, y, 0) for x in (0.0, RADIUS - LINING, RADIUS)] for y in LEVELS]
    axis, inner, wall = (lines([row[i] for row in rows]) for i in range(3))
    floors = [lines(row) for row in rows]
    groups: dict[str, list[int]] = {}
    for i in range(STEPS):
        top, floor = floors[i], floors[i + 1]
        groups[f"core-{i + 1}"] = [surface(axis[i], floor[0], -inner[i], -top[0])]
        groups[f"lining-{i + 1}"] = [surface(inner[i], floor[1], -wall[i], -top[1])]
        divide(inner[i], wall[i], top[1], floor[1], groups[f"lining-{i + 1}"][0], size)

    seam = [row[2] for row in rows][LEVELS.index(LAYER)]
    far = [geo.addPoint(FAR, y, 0) for y in (0.0, LAYER, BOTTOM)]
    below = geo.addPoint(0, BOTTOM, 0)
    ground, contact = geo.addLine(rows[0][2], far[0]), geo.addLine(seam, far[1])
    sides = lines(far)
    base, axis_below = geo.addLine(below, far[2]), geo.addLine(rows[-1][0], below)
    upper = LEVELS.index(LAYER)
    groups["upper"] = [surface(*wall[:upper], contact, -sides[0], -ground)]
    lower = [*wall[upper:], -floors[-1][1], -floors[-1][0], axis_below, base, -sides[1], -contact]
    groups["lower"] = [surface(*lower)]
    geo.synchronize()
    for name, tags in groups.items():
        gmsh.model.addPhysicalGroup(2, tags, name=name)
    for name, tags in {"side": sides, "bottom": [base]}.items():
        gmsh.model.addPhysicalGroup(1, tags, name=name)
    corners = [point for row in rows for point in row[1:]]
    near_wall = (WALL, GROWTH, "CurvesList", [*wall, *floors[-1]])
    grow(size, [near_wall, (CORNER, GROWTH, "PointsList", corners)])


def divide(inner: int, outer: int, top: int, floor: int, lining: int, size: float) -> None:
    """One (or more) regular layers of elements in the lining."""
    for curve in (inner, outer):
        geo.mesh.setTransfiniteCurve(curve, ceil(STEP / (0.75 * size)) + 1)
    for curve in (top, floor):
        geo.mesh.setTransfiniteCurve(curve, ceil(2 / (3 * size)) + 1)
    geo.mesh.setTransfiniteSurface(lining)


def main() -> None:
    options = read_options(__doc__, HERE / "shaft.msh", order=2)
    with mesh_file(options, QUADRILATERALS):
        build(options.size)


if __name__ == "__main__":
    main()

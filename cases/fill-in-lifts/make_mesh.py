"""Makes the mesh of the fill: its right half in four lifts, on clay with drains, on sand.

Shipped mesh:        python make_mesh.py
Another one:         python make_mesh.py --size 0.5 --output fine.msh

Quadrilaterals of second order. Needs gmsh (`pip install gmsh`). Lengths in m, x from the plane of
symmetry, y upwards from the ground.
"""

import itertools
import sys
from pathlib import Path

import gmsh

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from mesh_script import QUADRILATERALS, lines, mesh_file, read_options  # noqa: E402

LEVELS = (0.0, 1.0, 2.5, 4.0, 5.0)  # of the lifts
TOE, SLOPE = 24.0, 2.0  # of the fill: half of its base, horizontal run per metre of height
CLAY, BOTTOM = 9.0, 13.0  # depths of the lower edges of clay and sand
SIDE = 64.0
COLUMNS, ROWS = (10, 6), (8, 1)  # elements: below and beside the fill, in clay and sand

geo = gmsh.model.geo


def surface(loop: list[int]) -> int:
    """A surface inside curves given in their order."""
    return int(geo.addPlaneSurface([geo.addCurveLoop(loop)]))


def group(dim: int, name: str, *tags: int) -> None:
    """A named group of curves or surfaces."""
    gmsh.model.addPhysicalGroup(dim, list(tags), name=name)


def divide(
    size: float, into: int, curves: list[int], law: str = "Progression", by: float = 1.0
) -> None:
    """Divide curves into elements, evenly or not."""
    for curve in curves:
        gmsh.model.mesh.setTransfiniteCurve(curve, max(1, round(into / size)) + 1, law, by)


def build(size: float) -> None:
    """The geometry with its groups, in rows and columns of elements.

    Rows of the clay are thin at its edges, where water leaves.
    """
    rows = [(geo.addPoint(0, y, 0), geo.addPoint(TOE - SLOPE * y, y, 0)) for y in LEVELS]
    floors = [geo.addLine(*row) for row in rows]
    axis, slopes, fill = [], [], []
    for (below, above), (floor, top) in zip(
        itertools.pairwise(rows), itertools.pairwise(floors), strict=True
    ):
        axis.append(geo.addLine(below[0], above[0]))
        slopes.append(geo.addLine(below[1], above[1]))
        fill.append(surface([floor, slopes[-1], -top, -axis[-1]]))
    middle, toe = rows[0]
    corners = {
        (x, y): geo.addPoint(x, -y, 0) for x in (0.0, TOE, SIDE) for y in (0.0, CLAY, BOTTOM) if y
    }
    edge = geo.addPoint(SIDE, 0, 0)
    outside = geo.addLine(toe, edge)
    left = lines([middle, corners[0.0, CLAY], corners[0.0, BOTTOM]])
    right = lines([edge, corners[SIDE, CLAY], corners[SIDE, BOTTOM]])
    below_toe = geo.addLine(toe, corners[TOE, CLAY])
    below_clay = geo.addLine(corners[TOE, CLAY], corners[TOE, BOTTOM])
    base = lines([corners[x, CLAY] for x in (0.0, TOE, SIDE)])
    bottoms = lines([corners[x, BOTTOM] for x in (0.0, TOE, SIDE)])
    clay = surface([left[0], base[0], -below_toe, -floors[0]])
    beside = surface([below_toe, base[1], -right[0], -outside])
    sands = [surface([left[1], bottoms[0], -below_clay, -base[0]])]
    sands.append(surface([below_clay, bottoms[1], -right[1], -base[1]]))
    geo.synchronize()
    divide(size, COLUMNS[0], [*floors, base[0], bottoms[0]])
    divide(size, COLUMNS[1], [outside, base[1], bottoms[1]], by=1.15)
    divide(size, ROWS[0], [left[0], below_toe, right[0]], "Bump", 0.25)
    divide(size, ROWS[1], [left[1], below_clay, right[1]])
    divide(size, 1, [*axis, *slopes])
    for tag in (*fill, clay, beside, *sands):
        gmsh.model.mesh.setTransfiniteSurface(tag)
    for lift, tag in enumerate(fill, start=1):
        group(2, f"lift-{lift}", tag)
    group(2, "clay", clay)
    group(2, "beside", beside)
    group(2, "sand", *sands)
    group(1, "surface", floors[0], outside)
    group(1, "axis", *axis, *left)
    group(1, "side", *right)
    group(1, "bottom", *bottoms)


def main() -> None:
    options = read_options(__doc__, HERE / "fill.msh", order=2)
    with mesh_file(options, QUADRILATERALS):
        build(options.size)


if __name__ == "__main__":
    main()

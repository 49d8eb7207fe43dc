"""Makes the mesh of the rockfill dam: eight lifts of shell and core on a rock foundation.

Shipped mesh:        python make_mesh.py
Mesh of the truth:   python make_mesh.py --size 0.5 --order 2 --output fine.msh

The same call makes the same mesh, mostly of quadrilaterals, with some triangles. Needs gmsh
(`pip install gmsh`). Lengths in m, x downstream from the axis, y upwards from the foundation.
"""

import itertools
import sys
from pathlib import Path

import gmsh

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from mesh_script import QUADRILATERALS, lines, mesh_file, read_options  # noqa: E402

HEIGHT, LIFTS = 80.0, 8
HALF_CREST, SLOPE = 5.0, 1.8  # of the dam: horizontal run of the faces per metre of height
HALF_CORE_TOP, CORE_SLOPE = 3.0, 0.25
SIDE, DEPTH = 320.0, 120.0  # extent of the foundation
LEVELS = [HEIGHT * i / LIFTS for i in range(LIFTS + 1)]

geo = gmsh.model.geo


def row(y: float) -> tuple[list[int], list[int]]:
    """Points across the dam at a level, from upstream to downstream, and the lines between."""
    face = HALF_CREST + SLOPE * (HEIGHT - y)
    core = HALF_CORE_TOP + CORE_SLOPE * (HEIGHT - y)
    points = [geo.addPoint(x, y, 0) for x in (-face, -core, core, face)]
    return points, lines(points)


def surface(loop: list[int]) -> int:
    """A surface inside curves given in their order."""
    return int(geo.addPlaneSurface([geo.addCurveLoop(loop)]))


def build() -> None:
    """The geometry with its groups."""
    rows = [row(y) for y in LEVELS]
    for lift, ((below, floor), (above, top)) in enumerate(itertools.pairwise(rows), start=1):
        rise = [geo.addLine(a, b) for a, b in zip(below, above, strict=True)]
        zones = [surface([floor[i], rise[i + 1], -top[i], -rise[i]]) for i in range(3)]
        geo.synchronize()
        gmsh.model.addPhysicalGroup(2, [zones[0], zones[2]], name=f"shell-{lift}")
        gmsh.model.addPhysicalGroup(2, [zones[1]], name=f"core-{lift}")
    base, floor = rows[0]
    corners = [(SIDE, 0), (SIDE, -DEPTH), (-SIDE, -DEPTH), (-SIDE, 0)]
    points = [geo.addPoint(x, y, 0) for x, y in corners]
    ground = lines([base[3], *points, base[0]])
    foundation = surface([-line for line in reversed([*ground, *floor])])
    geo.synchronize()
    gmsh.model.addPhysicalGroup(2, [foundation], name="foundation")
    for name, line in zip(["right", "bottom", "left"], ground[1:4], strict=True):
        gmsh.model.addPhysicalGroup(1, [line], name=name)


def grade(size: float) -> None:
    """Element sizes: even in the dam, growing with the depth and towards the sides."""
    half_base = HALF_CREST + SLOPE * HEIGHT
    away = f"sqrt(max(0, -y)^2 + max(0, abs(x) - {half_base})^2)"
    field = gmsh.model.mesh.field
    sizes = field.add("MathEval")
    field.setString(sizes, "F", f"{size} * (2.5 + 0.12 * {away})")
    field.setAsBackgroundMesh(sizes)


def main() -> None:
    options = read_options(__doc__, HERE / "dam.msh")
    with mesh_file(options, QUADRILATERALS):
        build()
        grade(options.size)


if __name__ == "__main__":
    main()

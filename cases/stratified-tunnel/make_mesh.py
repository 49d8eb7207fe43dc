"""Makes the mesh of the twin tunnels: two round tubes, each a heading and a bench with lining.

Shipped mesh:        python make_mesh.py
Mesh of the truth:   python make_mesh.py --size 0.6 --order 2 --output fine.msh

The same call makes the same mesh. Needs gmsh (`pip install gmsh`). Lengths in m: x across, y
upwards, origin half-way between the tubes at the level of their axes.
"""

import sys
from math import cos, pi, sin
from pathlib import Path

import gmsh

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from mesh_script import TRIANGLES, grow, mesh_file, read_options  # noqa: E402

TUBES = {"a": -15.0, "b": 15.0}  # their axes
RADIUS = 4.5
LINING = 0.25  # thickness of the shotcrete, inside the excavated profile
LEFT, RIGHT, BOTTOM, TOP = -90.0, 90.0, -70.0, 75.0
# element sizes at the walls, at the corners of heading and bench, and how they grow with distance
WALL, WALL_GROWTH, CORNER, CORNER_GROWTH = 0.25, 0.1, 0.05, 0.2

geo = gmsh.model.geo
Groups = dict[str, list[int]]


def point(x: float, y: float) -> int:
    """A point of the geometry."""
    return int(geo.addPoint(x, y, 0.0))


def ring(x: float, radius: float, centre: int) -> tuple[list[int], list[int]]:
    """Points every 45 degrees from the right, anticlockwise, and the arcs between them."""
    angles = [k * pi / 4 for k in range(8)]
    points = [point(x + radius * cos(a), radius * sin(a)) for a in angles]
    ends = zip(points, points[1:] + points[:1], strict=True)
    return points, [geo.addCircleArc(a, centre, b) for a, b in ends]


def surface(*loops: list[int]) -> int:
    """A plane surface in an outer loop, with holes."""
    return int(geo.addPlaneSurface([geo.addCurveLoop(loop) for loop in loops]))


def tube(name: str, x: float, groups: Groups) -> tuple[list[int], list[int], list[int]]:
    """Adds the surfaces of one tube; returns its wall, its other curves and its corners."""
    centre = point(x, 0.0)
    rock, wall = ring(x, RADIUS, centre)
    inner, arcs = ring(x, RADIUS - LINING, centre)
    rungs = [geo.addLine(inner[k], rock[k]) for k in (0, 4)]
    floor = [geo.addLine(inner[4], centre), geo.addLine(centre, inner[0])]
    back = [-curve for curve in reversed(arcs)]
    groups[f"{name}-heading"] = [surface([*floor, *arcs[:4]])]
    groups[f"{name}-bench"] = [surface([*arcs[4:], -floor[1], -floor[0]])]
    groups[f"lining-{name}-heading"] = [surface([rungs[0], *wall[:4], -rungs[1], *back[4:]])]
    groups[f"lining-{name}-bench"] = [surface([rungs[1], *wall[4:], -rungs[0], *back[:4]])]
    return wall, [*arcs, *floor], [rock[0], rock[4], inner[0], inner[4]]


def build(size: float) -> None:
    """The geometry with its groups."""
    groups: Groups = {}
    walls, curves, corners = [], [], []
    for name, x in TUBES.items():
        wall, others, ends = tube(name, x, groups)
        walls.append(wall)
        curves += [*wall, *others]
        corners += ends
    places = [(LEFT, BOTTOM), (RIGHT, BOTTOM), (RIGHT, TOP), (LEFT, TOP)]
    box = [point(*place) for place in places]
    sides = [geo.addLine(a, b) for a, b in zip(box, box[1:] + box[:1], strict=True)]
    groups["rock"] = [surface(sides, *walls)]
    geo.synchronize()
    for name, tags in groups.items():
        gmsh.model.addPhysicalGroup(2, tags, name=name)
    for name, side in zip(("bottom", "right", "top", "left"), sides, strict=True):
        gmsh.model.addPhysicalGroup(1, [side], name=name)
    near_walls = (WALL, WALL_GROWTH, "CurvesList", curves)
    grow(size, [near_walls, (CORNER, CORNER_GROWTH, "PointsList", corners)])


def main() -> None:
    options = read_options(__doc__, HERE / "tubes.msh")
    with mesh_file(options, TRIANGLES):
        build(options.size)


if __name__ == "__main__":
    main()

"""Makes the mesh of the deep cavern: arched section 24 m x 44 m, a heading and five benches.

Shipped mesh:        python make_mesh.py
Mesh of the truth:   python make_mesh.py --size 0.6 --order 2 --output fine.msh

The same call makes the same mesh. Needs gmsh (`pip install gmsh`). Lengths in m, y upwards, origin
on the axis at the floor. Elements are of second order if not said otherwise: linear triangles lock
where rock yields.
"""

import itertools
import sys
from math import asin, cos, radians, sin
from pathlib import Path

import gmsh

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from mesh_script import TRIANGLES, grow, lines, mesh_file, read_options  # noqa: E402

HALF_SPAN, SPRINGING, CROWN = 12.0, 36.0, 44.0
FLOORS = {"heading": 33.0, "bench-1": 26.0, "bench-2": 19.0, "bench-3": 12.0, "bench-4": 6.0}
FLOORS["bench-5"] = 0.0
GAUGES = [29.5, 22.5, 15.5, 9.0]  # levels of the instruments in the walls
LEFT, RIGHT, BOTTOM, TOP = -150.0, 150.0, -110.0, 145.0
# element sizes at the walls, at their corners with the floors (where plastic strains concentrate
# and move the walls) and at the floors, and how they grow with distance
WALL, CORNER, FLOOR = 0.7, 0.12, 1.7
GROWTH, CORNER_GROWTH = 0.11, 0.25

RADIUS = (HALF_SPAN**2 + (CROWN - SPRINGING) ** 2) / (2 * (CROWN - SPRINGING))
SPRING_ANGLE = asin(HALF_SPAN / RADIUS)  # from the vertical
GAUGE_ANGLE = radians(40)  # extensometers in the shoulders

geo = gmsh.model.geo


def wall(side: int, crown: int, centre: int) -> tuple[list[int], list[int]]:
    """Levels of the points of a half from the floor to the crown, and the curves between them."""
    levels = sorted([*FLOORS.values(), *GAUGES, SPRINGING])
    points = [geo.addPoint(side * HALF_SPAN, y, 0) for y in levels]
    x, y = RADIUS * sin(GAUGE_ANGLE), CROWN - RADIUS * (1 - cos(GAUGE_ANGLE))
    arch = [points[-1], geo.addPoint(side * x, y, 0), crown]
    arcs = [geo.addCircleArc(a, centre, b) for a, b in itertools.pairwise(arch)]
    return points, lines(points) + arcs


def build(size: float) -> None:
    """The geometry with its groups."""
    crown, centre = geo.addPoint(0, CROWN, 0), geo.addPoint(0, CROWN - RADIUS, 0)
    (left, left_wall), (right, right_wall) = (wall(side, crown, centre) for side in (-1, 1))
    levels = sorted([*FLOORS.values(), *GAUGES, SPRINGING])
    at = {name: levels.index(y) for name, y in FLOORS.items()}
    floors = {name: geo.addLine(left[k], right[k]) for name, k in at.items()}

    surfaces, top = {}, None
    for name, floor in floors.items():
        end = None if top is None else at[top]
        loop = [floor, *right_wall[at[name] : end]]
        loop += [] if top is None else [-floors[top]]
        loop += [-curve for curve in reversed(left_wall[at[name] : end])]
        surfaces[name] = geo.addPlaneSurface([geo.addCurveLoop(loop)])
        top = name
    corners = [geo.addPoint(x, y, 0) for x, y in itertools.product((LEFT, RIGHT), (BOTTOM, TOP))]
    box = lines([corners[k] for k in (0, 2, 3, 1, 0)])
    profile = [floors["bench-5"], *right_wall, *(-curve for curve in reversed(left_wall))]
    loops = [geo.addCurveLoop(loop) for loop in (box, profile)]
    surfaces["rock"] = geo.addPlaneSurface(loops)

    geo.synchronize()
    for name, surface in surfaces.items():
        gmsh.model.addPhysicalGroup(2, [surface], name=name)
    for name, line in zip(["bottom", "right", "top", "left"], box, strict=True):
        gmsh.model.addPhysicalGroup(1, [line], name=name)
    top = None
    for name in floors:
        end = None if top is None else at[top]
        mine = left_wall[at[name] : end] + right_wall[at[name] : end]
        gmsh.model.addPhysicalGroup(1, mine, name=f"wall-{name}")
        top = name
    ends = [side[at[name]] for side in (left, right) for name in at]
    near = [(WALL, "CurvesList", left_wall + right_wall), (FLOOR, "CurvesList", [*floors.values()])]
    sizes = [(fine, GROWTH, kind, tags) for fine, kind, tags in near]
    grow(size, [*sizes, (CORNER, CORNER_GROWTH, "PointsList", ends)])


def main() -> None:
    options = read_options(__doc__, HERE / "cavern.msh", order=2)
    with mesh_file(options, TRIANGLES):
        build(options.size)


if __name__ == "__main__":
    main()

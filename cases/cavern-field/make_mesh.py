"""Makes the mesh of the cavern in heterogeneous rock: arched section 20 m x 30 m, five steps.

Shipped mesh:        python make_mesh.py
Mesh of the truth:   python make_mesh.py --size 0.5 --output fine.msh

The same call makes the same mesh, of quadratic triangles. Needs gmsh (`pip install gmsh`). Lengths
in m, y upwards, origin on the axis at the floor.
"""

import itertools
import sys
from pathlib import Path

import gmsh

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from mesh_script import TRIANGLES, grow, lines, mesh_file, read_options  # noqa: E402

HALF_SPAN, SPRINGING, CROWN = 10.0, 24.0, 30.0
FLOORS = {"heading": 20.0, "bench-1": 15.0, "bench-2": 10.0, "bench-3": 5.0, "bench-4": 0.0}
LEFT, RIGHT, BOTTOM, TOP = -110.0, 110.0, -90.0, 120.0
WALL, GROWTH = 1.4, 0.12  # size of the elements at the wall, and how it grows with the distance

RADIUS = (HALF_SPAN**2 + (CROWN - SPRINGING) ** 2) / (2 * (CROWN - SPRINGING))

geo = gmsh.model.geo


def build(size: float) -> None:
    """The geometry with its groups."""
    levels = sorted([*FLOORS.values(), SPRINGING])
    right, left = ([geo.addPoint(s * HALF_SPAN, y, 0) for y in levels] for s in (1, -1))
    crown, centre = geo.addPoint(0, CROWN, 0), geo.addPoint(0, CROWN - RADIUS, 0)
    walls = {1: lines(right), -1: lines(left)}
    arch = [geo.addCircleArc(right[-1], centre, crown), geo.addCircleArc(crown, centre, left[-1])]
    floors = [geo.addLine(a, b) for a, b in zip(left[:-1], right[:-1], strict=True)]

    surfaces = {}
    names = list(FLOORS)
    top = [floors[-1], walls[1][-1], *arch, -walls[-1][-1]]
    surfaces["heading"] = geo.addPlaneSurface([geo.addCurveLoop(top)])
    for n, (below, above) in enumerate(itertools.pairwise(range(len(floors)))):
        loop = [floors[below], walls[1][n], -floors[above], -walls[-1][n]]
        surfaces[names[-1 - n]] = geo.addPlaneSurface([geo.addCurveLoop(loop)])
    corners = [(LEFT, BOTTOM), (RIGHT, BOTTOM), (RIGHT, TOP), (LEFT, TOP)]
    ends = [geo.addPoint(x, y, 0) for x, y in corners]
    box = lines([*ends, ends[0]])
    profile = [floors[0], *walls[1], *arch, *(-line for line in reversed(walls[-1]))]
    loops = [geo.addCurveLoop(box), geo.addCurveLoop(profile)]
    surfaces["rock"] = geo.addPlaneSurface(loops)

    geo.synchronize()
    for name, surface in surfaces.items():
        gmsh.model.addPhysicalGroup(2, [surface], name=name)
    for name, line in zip(["bottom", "right", "top", "left"], box, strict=True):
        gmsh.model.addPhysicalGroup(1, [line], name=name)
    grow(size, [(WALL, GROWTH, "CurvesList", [*walls[1], *walls[-1], *arch, *floors])])


def main() -> None:
    options = read_options(__doc__, HERE / "cavern.msh", order=2)
    with mesh_file(options, TRIANGLES):
        build(options.size)


if __name__ == "__main__":
    main()

"""Makes the mesh of the cavern: arched section 25 m x 45 m, six steps of excavation, a fault.

Shipped mesh:        python make_mesh.py
Mesh of the truth:   python make_mesh.py --size 0.5 --order 2 --output fine.msh

The same call makes the same mesh. Needs gmsh (`pip install gmsh`). Lengths in m, y upwards, origin
on the axis at the floor.
"""

import itertools
import sys
from math import asin, cos, hypot, log, radians, sin, tan
from pathlib import Path

import gmsh

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from mesh_script import TRIANGLES, grow, mesh_file, read_options  # noqa: E402

HALF_SPAN, SPRINGING, CROWN = 12.5, 37.0, 45.0
LINING = 0.3  # thickness of the shotcrete, inside the excavated profile
HALF_DRIFT = 4.0
FLOORS = {"heading": 36.0, "bench-1": 29.0, "bench-2": 22.0, "bench-3": 15.0, "bench-4": 8.0}
FLOORS["bench-5"] = 0.0
LEFT, RIGHT, BOTTOM, TOP = -150.0, 150.0, -110.0, 145.0
FAULT_X, FAULT_Y, FAULT_DIP, FAULT_WIDTH = 21.5, 30.0, radians(78), 2.0
FAULT_LOW, FAULT_HIGH = -20.0, 80.0
# element sizes at the wall, the floors, the fault and the corners, and how they grow with distance
WALL, FLOOR, FAULT, CORNER = 0.5, 0.8, 1.0, 0.04
GROWTH, CORNER_GROWTH = 0.1, 0.2

RADIUS = (HALF_SPAN**2 + (CROWN - SPRINGING) ** 2) / (2 * (CROWN - SPRINGING))
CENTRE_Y = CROWN - RADIUS
SPRING_ANGLE = asin(HALF_SPAN / RADIUS)  # from the vertical
DRIFT_ANGLE = asin(HALF_DRIFT / (RADIUS - LINING))
GAUGE_ANGLE = radians(40)  # extensometers in the shoulders

geo = gmsh.model.geo


class Outline:
    """The right or left half of the profile: rock wall and inner face of the lining.

    Points run from the floor up to the crown, one where a group ends or a gauge stands.
    """

    def __init__(self, side: int, size: float) -> None:
        self.side, self.size = side, size
        floors = sorted(FLOORS.values())
        middles = [(low + high) / 2 for low, high in itertools.pairwise(floors)]
        levels = sorted(floors + middles)
        angles = [SPRING_ANGLE, GAUGE_ANGLE, DRIFT_ANGLE]
        inner_radius = RADIUS - LINING
        inner_top = asin((HALF_SPAN - LINING) / inner_radius)
        self.centre = point(0, CENTRE_Y)
        self.rock = [point(side * HALF_SPAN, y) for y in levels]
        self.rock += [on_arch(side, RADIUS, angle) for angle in angles]
        self.inner = [point(side * (HALF_SPAN - LINING), y) for y in levels]
        self.inner += [on_arch(side, inner_radius, a) for a in [inner_top, *angles[1:]]]
        self.groups = [lining_of(y) for y in middles for _ in range(2)]
        self.groups += ["lining-heading"] * 3
        self.levels = levels
        drift = len(levels) + len(angles) - 1
        self.corners = {*(levels.index(y) for y in floors), drift}

    def close(self, crown: tuple[int, int], rung: int) -> None:
        """Adds the crown with its rung, which both halves share, and draws the curves."""
        self.rock.append(crown[0])
        self.inner.append(crown[1])
        self.groups.append("lining-drift")
        self.rock_curves = self.curves(self.rock)
        self.inner_curves = self.curves(self.inner)
        pairs = zip(self.rock[:-1], self.inner[:-1], strict=True)
        self.rungs = [*(geo.addLine(a, b) for a, b in pairs), rung]

    def curves(self, points: list[int]) -> list[int]:
        straight = len(self.levels)
        return [
            geo.addLine(a, b) if i < straight else geo.addCircleArc(a, self.centre, b)
            for i, (a, b) in enumerate(itertools.pairwise(points))
        ]

    def lining(self) -> list[tuple[str, int]]:
        """Surfaces of the lining with their groups, one element thick."""
        found = []
        for i, group in enumerate(self.groups):
            loop = [self.rock_curves[i], self.rungs[i + 1], -self.inner_curves[i], -self.rungs[i]]
            if self.side < 0:  # anticlockwise on both sides
                loop = [-curve for curve in reversed(loop)]
            surface = geo.addPlaneSurface([geo.addCurveLoop(loop)])
            for curve in (self.rock_curves[i], self.inner_curves[i]):
                geo.mesh.setTransfiniteCurve(curve, *self.division(i))
            for rung in (self.rungs[i], self.rungs[i + 1]):
                geo.mesh.setTransfiniteCurve(rung, 2)
            geo.mesh.setTransfiniteSurface(surface, "Alternate" if self.side > 0 else "Left")
            found.append((group, surface))
        return found

    def division(self, i: int) -> tuple[int, str, float]:
        """How a segment is divided: number of nodes, and how they crowd towards a corner."""
        length = hypot(
            *(b - a for a, b in zip(*map(PLACES.get, self.rock[i : i + 2]), strict=True))
        )
        finer = [k in self.corners for k in (i, i + 1)]
        if not any(finer):
            return max(2, round(length / (WALL * self.size)) + 1), "Progression", 1.0
        ratio = 1 + CORNER_GROWTH * self.size
        count = log(1 + length * CORNER_GROWTH / CORNER) / log(ratio)
        return max(2, round(count) + 1), "Progression", ratio if finer[0] else 1 / ratio

    def level(self, y: float) -> int:
        """Index of the point at a level of the wall."""
        return self.levels.index(y)


PLACES: dict[int, tuple[float, float]] = {}


def point(x: float, y: float) -> int:
    """A point of the geometry."""
    tag = geo.addPoint(x, y, 0.0)
    PLACES[tag] = (x, y)
    return int(tag)


def on_arch(side: int, radius: float, angle: float) -> int:
    """A point of the arch, angle from the vertical."""
    return point(side * radius * sin(angle), CENTRE_Y + radius * cos(angle))


def lining_of(y: float) -> str:
    """Name of the lining group at a level of the wall."""
    return "lining-" + next(name for name, floor in FLOORS.items() if y > floor)


def polygon(points: list[int]) -> list[int]:
    """Lines through points, closed."""
    return [geo.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]


def fault() -> list[int]:
    """Outline of the fault, a steep band right of the cavern with horizontal ends."""
    half = FAULT_WIDTH / 2 / sin(FAULT_DIP)

    def centre(y: float) -> float:
        return FAULT_X + (y - FAULT_Y) / tan(FAULT_DIP)

    low, high = centre(FAULT_LOW), centre(FAULT_HIGH)
    return polygon(
        [
            point(low - half, FAULT_LOW),
            point(low + half, FAULT_LOW),
            point(high + half, FAULT_HIGH),
            point(high - half, FAULT_HIGH),
        ]
    )


def build(size: float) -> None:
    """The geometry with its groups."""
    right, left = Outline(1, size), Outline(-1, size)
    crown = point(0, CROWN), point(0, CROWN - LINING)
    rung = geo.addLine(*crown)
    for half in (right, left):
        half.close(crown, rung)
    surfaces = right.lining() + left.lining()

    # floors of the steps, and the sides of the drift
    names = list(FLOORS)
    floor_lines = {}
    lower = FLOORS["heading"]
    feet = [point(-HALF_DRIFT, lower), point(HALF_DRIFT, lower)]
    ends = [half.inner[half.level(lower)] for half in (left, right)]
    heading_floor = [
        geo.addLine(a, b) for a, b in zip([ends[0], *feet], [*feet, ends[1]], strict=True)
    ]
    floor_lines["heading"] = heading_floor
    for name in names[1:]:
        index = right.level(FLOORS[name])
        floor_lines[name] = [geo.addLine(left.inner[index], right.inner[index])]
    drift_sides = [geo.addLine(feet[0], left.inner[-2]), geo.addLine(feet[1], right.inner[-2])]

    # cores of the benches, from the heading down
    for above, name in itertools.pairwise(names):
        low, high = right.level(FLOORS[name]), right.level(FLOORS[above])
        loop = [*floor_lines[name], *right.inner_curves[low:high]]
        loop += [-c for c in reversed(floor_lines[above])]
        loop += [-c for c in reversed(left.inner_curves[low:high])]
        surfaces.append((name, geo.addPlaneSurface([geo.addCurveLoop(loop)])))
    start = right.level(lower)
    drift = [heading_floor[1], drift_sides[1], right.inner_curves[-1], -left.inner_curves[-1]]
    surfaces.append(("drift", geo.addPlaneSurface([geo.addCurveLoop([*drift, -drift_sides[0]])])))
    loop = [heading_floor[2], *right.inner_curves[start:-1], -drift_sides[1]]
    surfaces.append(("heading", geo.addPlaneSurface([geo.addCurveLoop(loop)])))
    loop = [heading_floor[0], drift_sides[0], *(-c for c in left.inner_curves[-2 : start - 1 : -1])]
    surfaces.append(("heading", geo.addPlaneSurface([geo.addCurveLoop(loop)])))

    # rock and fault around; the cavern's floor between the feet of the lining
    band = fault()
    surfaces.append(("fault", geo.addPlaneSurface([geo.addCurveLoop(band)])))
    box = polygon([point(LEFT, BOTTOM), point(RIGHT, BOTTOM), point(RIGHT, TOP), point(LEFT, TOP)])
    profile = [left.rungs[0], *floor_lines["bench-5"], -right.rungs[0]]
    profile += right.rock_curves + [-c for c in reversed(left.rock_curves)]
    loops = [geo.addCurveLoop(loop) for loop in (box, profile, band)]
    surfaces.append(("rock", geo.addPlaneSurface(loops)))

    geo.synchronize()
    for name in dict.fromkeys(name for name, _ in surfaces):
        tags = [tag for other, tag in surfaces if other == name]
        gmsh.model.addPhysicalGroup(2, tags, name=name)
    for name, line in zip(["bottom", "right", "top", "left"], box, strict=True):
        gmsh.model.addPhysicalGroup(1, [line], name=name)
    floors = [line for lines in floor_lines.values() for line in lines] + drift_sides
    corners = feet + [half.rock[i] for half in (right, left) for i in half.corners]
    grade(size, {WALL: right.rock_curves + left.rock_curves, FLOOR: floors, FAULT: band}, corners)


def grade(size: float, curves: dict[float, list[int]], corners: list[int]) -> None:
    """Element sizes: as told at the curves and the corners, growing with the distance."""
    near = [(CORNER, CORNER_GROWTH, "PointsList", corners)]
    near += [(fine, GROWTH, "CurvesList", tags) for fine, tags in curves.items()]
    grow(size, near)


def main() -> None:
    options = read_options(__doc__, HERE / "cavern.msh")
    with mesh_file(options, TRIANGLES):
        build(options.size)


if __name__ == "__main__":
    main()

"""Makes the mesh of a metro tunnel: half of a round section, hexahedra in layers along the axis.

Shipped mesh:        python make_mesh.py
Mesh of the truth:   python make_mesh.py --size 0.75 --order 2 --solid --output fine.msh

The same call makes the same mesh. Needs gmsh (`pip install gmsh`). Lengths in m: x across from the
plane of symmetry, y along the drive, z upwards from the axis of the tunnel.
"""

import sys
from itertools import accumulate, pairwise
from math import ceil, cos, log, pi, sin
from pathlib import Path

import gmsh

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from mesh_script import SERENDIPITY, mesh_file, read_options  # noqa: E402

RADIUS, LINING = 3.4, 0.3  # of the excavation; thickness of the lining, inside of it
SIDE, BOTTOM, TOP = 30.0, -18.0, 14.0
BACK, FRONT = -16.0, 32.0  # ends of the model along the axis
ROUND, ROUNDS = 4.0, 4  # the approach ends at y = 0, where the rounds begin

geo = gmsh.model.geo


class Section:
    """The cross-section at y = BACK, in quadrilateral blocks that share their divisions."""

    def __init__(self, size: float, *, solid: bool) -> None:
        self.arch = ceil(4 / size)  # elements over 45 degrees
        self.growth = 1 + 0.35 * size
        first = 0.8 * size
        self.out = ceil(log(1 + (SIDE - RADIUS) * (self.growth - 1) / first) / log(self.growth))
        self.solid = solid
        self.curves: dict[tuple[int, int], int] = {}
        self.blocks: list[tuple[str, int]] = []
        self.wall: list[int] = []

    def point(self, x: float, z: float) -> int:
        return int(geo.addPoint(x, BACK, z))

    def on_circle(self, radius: float, index: int) -> int:
        """Crown, shoulder, springline, lower shoulder or invert."""
        return self.point(radius * sin(index * pi / 4), radius * cos(index * pi / 4))

    def curve(self, a: int, b: int, count: int, growth: float = 1.0, centre: int = 0) -> int:
        """The curve from a to b, made when it is first asked for."""
        if (b, a) in self.curves:
            return -self.curves[b, a]
        if (a, b) not in self.curves:
            tag = geo.addCircleArc(a, centre, b) if centre else geo.addLine(a, b)
            geo.mesh.setTransfiniteCurve(tag, count + 1, "Progression", growth)
            self.curves[a, b] = tag
        return self.curves[a, b]

    def block(self, group: str, corners: list[int], counts: tuple[int, int]) -> None:
        """A block between four points; its sides have counts[0], counts[1], ... elements."""
        ring = zip(corners, corners[1:] + corners[:1], counts * 2, strict=True)
        loop = [self.curve(a, b, count) for a, b, count in ring]
        surface = geo.addPlaneSurface([geo.addCurveLoop(loop)])
        geo.mesh.setTransfiniteSurface(surface)
        geo.mesh.setRecombine(2, surface)
        self.blocks.append((group, surface))

    def build(self) -> list[tuple[str, int]]:
        """Blocks of the section with their groups."""
        n, out = self.arch, self.out
        centre = self.point(0, 0)
        wall = [self.on_circle(RADIUS, k) for k in range(5)]
        inner = [self.on_circle(RADIUS - LINING, k) for k in range(5)] if self.solid else wall
        box = [(0, TOP), (SIDE, TOP), (SIDE, 0), (SIDE, BOTTOM), (0, BOTTOM)]
        far = [self.point(x, z) for x, z in box]
        for points in (inner, wall):
            for a, b in pairwise(points):
                self.wall.append(self.curve(a, b, n, centre=centre))
        for a, b in zip(wall, far, strict=True):
            self.curve(a, b, out, self.growth)
        for k in range(4):
            if self.solid:
                self.block("lining", [wall[k], inner[k], inner[k + 1], wall[k + 1]], (1, n))
            self.block("rock", [far[k], wall[k], wall[k + 1], far[k + 1]], (out, n))
        self.block("core", [centre, inner[2], inner[1], inner[0]], (n, n))
        self.block("core", [inner[4], inner[3], inner[2], centre], (n, n))
        return self.blocks


def graded(length: float, first: float, growth: float) -> list[float]:
    """Heights of layers as fractions of the length, the first one about as thick as told."""
    layers, total = [first], first
    while total < length:
        layers.append(layers[-1] * growth)
        total += layers[-1]
    return [layer / total for layer in layers]


def drive(section: list[tuple[str, int]], size: float) -> dict[str, list[int]]:
    """Extrudes the section along the axis; volumes by group."""
    even, growth = max(1, round(ROUND / (1.4 * size))), 1 + 0.4 * size
    ahead = graded(FRONT - ROUNDS * ROUND, 1.6 * size, growth)
    pieces = [("approach", -BACK, graded(-BACK, 1.6 * size, growth)[::-1])]
    pieces += [(f"round-{k + 1}", ROUND, [1 / even] * even) for k in range(ROUNDS)]
    pieces += [("", FRONT - ROUNDS * ROUND, ahead)]
    names = {"core": "{}", "lining": "lining-{}", "rock": "soil"}
    volumes: dict[str, list[int]] = {}
    faces = section
    for piece, length, layers in pieces:
        heights = list(accumulate(layers))
        tags = [(2, tag) for _, tag in faces]
        made = geo.extrude(tags, 0, length, 0, [1] * len(layers), heights, recombine=True)
        solids = [k for k, (dim, _) in enumerate(made) if dim == 3]
        for (kind, _), k in zip(faces, solids, strict=True):
            name = names[kind].format(piece) if piece else "soil"
            volumes.setdefault(name, []).append(made[k][1])
        faces = [(kind, made[k - 1][1]) for (kind, _), k in zip(faces, solids, strict=True)]
    return volumes


def name_faces(volumes: dict[str, list[int]], *, solid: bool) -> None:
    """Groups of the outer faces by their place, and of the walls on which shells are built."""
    planes = {
        "symmetry": (0, 0.0), "side": (0, SIDE), "back": (1, BACK), "front": (1, FRONT),
        "bottom": (2, BOTTOM),
    }  # fmt: skip
    for name, (axis, place) in planes.items():
        low, high = [-1e3] * 3, [1e3] * 3
        low[axis], high[axis] = place - 1e-3, place + 1e-3
        tags = [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*low, *high, 2)]
        gmsh.model.addPhysicalGroup(2, tags, name=name)
    if solid:
        return
    soil = faces_of(volumes["soil"])
    for name in ("approach", *(f"round-{k + 1}" for k in range(ROUNDS))):
        wall = sorted(soil & faces_of(volumes[name]))
        wall = [tag for tag in wall if not is_across(tag)]
        gmsh.model.addPhysicalGroup(2, wall, name=f"wall-{name}")


def faces_of(volumes: list[int]) -> set[int]:
    """The surfaces of some volumes."""
    around = gmsh.model.getBoundary([(3, tag) for tag in volumes], combined=False, oriented=False)
    return {tag for _, tag in around}


def is_across(tag: int) -> bool:
    """Whether a surface is a cross-section: the face of the tunnel."""
    box = gmsh.model.getBoundingBox(2, tag)
    return box[4] - box[1] < 1e-3


def main() -> None:
    flags = {"solid": "with a lining of elements"}
    options = read_options(__doc__, HERE / "metro.msh", flags=flags)
    with mesh_file(options, SERENDIPITY, dim=3):
        section = Section(options.size, solid=options.solid).build()
        volumes = drive(section, options.size)
        geo.synchronize()
        for name, tags in volumes.items():
            gmsh.model.addPhysicalGroup(3, tags, name=name)
        name_faces(volumes, solid=options.solid)


if __name__ == "__main__":
    main()

"""Makes the mesh of the tunnel: half of a horseshoe section, hexahedra in layers along the axis.

Shipped mesh:        python make_mesh.py
Mesh of the truth:   python make_mesh.py --size 0.9 --far 4 --order 2 --output fine.msh

The same call makes the same mesh. Needs gmsh (`pip install gmsh`). Lengths in m: x across from the
plane of symmetry, y along the drive, z upwards from the springline.
"""

import sys
from itertools import accumulate
from math import ceil, cos, log, pi, sin
from pathlib import Path

import gmsh

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from mesh_script import SERENDIPITY, mesh_file, read_options  # noqa: E402

RADIUS, INVERT = 5.0, -3.0
LINING = 0.25  # thickness of the shotcrete, inside the excavated profile
SIDE, BOTTOM, TOP = 45.0, -40.0, 45.0
BACK, FRONT = -30.0, 60.0  # ends of the model along the axis
ROUND, ROUNDS = 3.0, 8  # the approach ends at y = 0, where the rounds begin

geo = gmsh.model.geo


class Section:
    """The cross-section at y = BACK, in quadrilateral blocks that share their divisions."""

    def __init__(self, size: float, far: float) -> None:
        self.arch = ceil(6 / size)  # elements over 45 degrees of the arch
        self.wall = ceil(5 / size)  # over the wall below the springline
        self.growth = 1 + 0.2 * size * far
        layers = log(1 + (SIDE - RADIUS) * (self.growth - 1) / (0.33 * size)) / log(self.growth)
        self.out = ceil(layers)  # from the wall to the sides of the model
        self.curves: dict[tuple[int, int], int] = {}
        self.blocks: list[tuple[str, int]] = []

    def point(self, x: float, z: float) -> int:
        return int(geo.addPoint(x, BACK, z))

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
        n, m, out = self.arch, self.wall, self.out
        centre, foot = self.point(0, 0), self.point(0, INVERT)
        inner, rock = ([self.on_profile(r, i) for i in range(4)] for r in (RADIUS - LINING, RADIUS))
        box = [(0, TOP), (SIDE, TOP), (SIDE, 0), (SIDE, BOTTOM), (0.93 * SIDE, BOTTOM), (0, BOTTOM)]
        far = [self.point(x, z) for x, z in box]
        ring = [*rock, inner[3], foot]  # around the excavation, from the crown to the invert
        for points in (inner, rock):
            for a, b in ((1, 0), (2, 1)):
                self.curve(points[a], points[b], n, centre=centre)
        for a, b in zip(ring, far, strict=True):
            self.curve(a, b, out, self.growth)

        for i, count in enumerate((n, n, m)):
            self.block("lining", [rock[i], inner[i], inner[i + 1], rock[i + 1]], (1, count))
        self.block("core", [centre, inner[2], inner[1], inner[0]], (n, n))
        self.block("core", [foot, inner[3], inner[2], centre], (n, m))
        for i, count in enumerate((n, n, m, 1, n)):
            self.block("rock", [far[i], ring[i], ring[i + 1], far[i + 1]], (out, count))
        return self.blocks

    def on_profile(self, radius: float, index: int) -> int:
        """Crown, shoulder, springline or foot of the wall."""
        if index == 3:
            return self.point(radius, INVERT)
        angle = index * pi / 4
        return self.point(radius * sin(angle), radius * cos(angle))


def graded(length: float, first: float, growth: float) -> list[float]:
    """Heights of layers as fractions of the length, the first one about as thick as told."""
    layers, total = [first], first
    while total < length:
        layers.append(layers[-1] * growth)
        total += layers[-1]
    return [layer / total for layer in layers]


def drive(section: list[tuple[str, int]], size: float, far: float) -> dict[str, list[int]]:
    """Extrudes the section along the axis; volumes by group."""
    even = max(1, round(ROUND / size))
    growth = 1 + 0.3 * size * far
    ahead = graded(FRONT - ROUNDS * ROUND, 1.1 * size, growth)
    pieces = [("approach", -BACK, graded(-BACK, 1.1 * size, growth)[::-1])]
    pieces += [(f"round-{i + 1}", ROUND, [1 / even] * even) for i in range(ROUNDS)]
    pieces += [("", FRONT - ROUNDS * ROUND, ahead)]
    names = {"core": "{}", "lining": "lining-{}", "rock": "rock"}
    volumes: dict[str, list[int]] = {}
    faces = section
    for piece, length, layers in pieces:
        heights = list(accumulate(layers))
        tags = [(2, tag) for _, tag in faces]
        made = geo.extrude(tags, 0, length, 0, [1] * len(layers), heights, recombine=True)
        solids = [i for i, (dim, _) in enumerate(made) if dim == 3]
        for (kind, _), i in zip(faces, solids, strict=True):
            name = names[kind].format(piece) if piece else "rock"
            volumes.setdefault(name, []).append(made[i][1])
        faces = [(kind, made[i - 1][1]) for (kind, _), i in zip(faces, solids, strict=True)]
    return volumes


def name_boundary() -> None:
    """Groups of the faces of the model, found by their place."""
    planes = {
        "symmetry": (0, 0.0), "side": (0, SIDE), "back": (1, BACK), "front": (1, FRONT),
        "bottom": (2, BOTTOM), "top": (2, TOP),
    }  # fmt: skip
    for name, (axis, place) in planes.items():
        low, high = [-1e3] * 3, [1e3] * 3
        low[axis], high[axis] = place - 1e-3, place + 1e-3
        tags = [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*low, *high, 2)]
        gmsh.model.addPhysicalGroup(2, tags, name=name)


def main() -> None:
    options = read_options(__doc__, HERE / "tunnel.msh", far="factor on how fast they grow")
    with mesh_file(options, SERENDIPITY, dim=3):
        volumes = drive(Section(options.size, options.far).build(), options.size, options.far)
        geo.synchronize()
        for name, tags in volumes.items():
            gmsh.model.addPhysicalGroup(3, tags, name=name)
        name_boundary()


if __name__ == "__main__":
    main()

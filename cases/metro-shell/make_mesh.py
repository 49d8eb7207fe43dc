"""Makes the mesh of a metro tunnel: half of a round section, hexahedra in layers along the axis.

Shipped mesh:        python make_mesh.py
Mesh of the truth:   python make_mesh.py --size 0.75 --order 2 --solid --output fine.msh

The same call makes the same mesh. Needs gmsh (`pip install gmsh`). Lengths in m: x across from the
plane of symmetry, y along the drive, z upwards from the axis of the tunnel.
"""

import sys
from itertools import pairwise
from math import ceil, cos, log, pi, sin
from pathlib import Path

import gmsh

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from driven_tunnel import BlockSection, Drive, name_groups  # noqa: E402
from mesh_script import SERENDIPITY, mesh_file, read_options  # noqa: E402

RADIUS, LINING = 3.4, 0.3  # of the excavation; thickness of the lining, inside of it
SIDE, BOTTOM, TOP = 30.0, -18.0, 14.0
DRIVE = Drive(-16.0, 32.0, length=4.0, rounds=4, ground="soil")
PLANES = {
    "symmetry": (0, 0.0), "side": (0, SIDE), "back": (1, DRIVE.back), "front": (1, DRIVE.front),
    "bottom": (2, BOTTOM),
}  # fmt: skip


class Section(BlockSection):
    """A circle; its lining, where it is solid, lies inside."""

    def __init__(self, size: float, *, solid: bool) -> None:
        super().__init__(DRIVE.back)
        self.arch = ceil(4 / size)  # elements over 45 degrees
        self.growth = 1 + 0.35 * size
        first = 0.8 * size
        self.out = ceil(log(1 + (SIDE - RADIUS) * (self.growth - 1) / first) / log(self.growth))
        self.solid = solid

    def on_circle(self, radius: float, index: int) -> int:
        """Crown, shoulder, springline, lower shoulder or invert."""
        return self.point(radius * sin(index * pi / 4), radius * cos(index * pi / 4))

    def build(self) -> None:
        """Its blocks with their groups."""
        n, out = self.arch, self.out
        centre = self.point(0, 0)
        wall = [self.on_circle(RADIUS, k) for k in range(5)]
        inner = [self.on_circle(RADIUS - LINING, k) for k in range(5)] if self.solid else wall
        box = [(0, TOP), (SIDE, TOP), (SIDE, 0), (SIDE, BOTTOM), (0, BOTTOM)]
        far = [self.point(x, z) for x, z in box]
        for points in (inner, wall):
            for a, b in pairwise(points):
                self.curve(a, b, n, centre=centre)
        for a, b in zip(wall, far, strict=True):
            self.curve(a, b, out, self.growth)
        for k in range(4):
            if self.solid:
                self.block("lining", [wall[k], inner[k], inner[k + 1], wall[k + 1]], (1, n))
            self.block("rock", [far[k], wall[k], wall[k + 1], far[k + 1]], (out, n))
        self.block("core", [centre, inner[2], inner[1], inner[0]], (n, n))
        self.block("core", [inner[4], inner[3], inner[2], centre], (n, n))


def name_walls(volumes: dict[str, list[int]]) -> None:
    """Groups of the walls on which shells are built."""
    soil = faces_of(volumes["soil"])
    for name in ("approach", *(f"round-{k + 1}" for k in range(DRIVE.rounds))):
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
        size = options.size
        section = Section(size, solid=options.solid)
        section.build()
        even = max(1, round(DRIVE.length / (1.4 * size)))
        volumes = DRIVE.volumes(section, even, 1.6 * size, 1 + 0.4 * size)
        name_groups(volumes, PLANES)
        if not options.solid:
            name_walls(volumes)


if __name__ == "__main__":
    main()

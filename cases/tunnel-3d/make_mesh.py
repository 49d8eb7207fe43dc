"""Makes the mesh of the tunnel: half of a horseshoe section, hexahedra in layers along the axis.

Shipped mesh:        python make_mesh.py
Mesh of the truth:   python make_mesh.py --size 0.9 --far 4 --order 2 --output fine.msh

The same call makes the same mesh. Needs gmsh (`pip install gmsh`). Lengths in m: x across from the
plane of symmetry, y along the drive, z upwards from the springline.
"""

import sys
from math import ceil, cos, log, pi, sin
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from driven_tunnel import BlockSection, Drive, name_groups  # noqa: E402
from mesh_script import SERENDIPITY, mesh_file, read_options  # noqa: E402

RADIUS, INVERT = 5.0, -3.0
LINING = 0.25  # thickness of the shotcrete, inside the excavated profile
SIDE, BOTTOM, TOP = 45.0, -40.0, 45.0
DRIVE = Drive(-30.0, 60.0, length=3.0, rounds=8, ground="rock")
PLANES = {
    "symmetry": (0, 0.0), "side": (0, SIDE), "back": (1, DRIVE.back), "front": (1, DRIVE.front),
    "bottom": (2, BOTTOM), "top": (2, TOP),
}  # fmt: skip


class Section(BlockSection):
    """A horseshoe."""

    def __init__(self, size: float, far: float) -> None:
        super().__init__(DRIVE.back)
        self.arch = ceil(6 / size)  # elements over 45 degrees of the arch
        self.wall = ceil(5 / size)  # over the wall below the springline
        self.growth = 1 + 0.2 * size * far
        layers = log(1 + (SIDE - RADIUS) * (self.growth - 1) / (0.33 * size)) / log(self.growth)
        self.out = ceil(layers)  # from the wall to the sides of the model

    def build(self) -> None:
        """Its blocks with their groups."""
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

    def on_profile(self, radius: float, index: int) -> int:
        """Crown, shoulder, springline or foot of the wall."""
        if index == 3:
            return self.point(radius, INVERT)
        angle = index * pi / 4
        return self.point(radius * sin(angle), radius * cos(angle))


def main() -> None:
    options = read_options(__doc__, HERE / "tunnel.msh", far="factor on how fast they grow")
    with mesh_file(options, SERENDIPITY, dim=3):
        size, far = options.size, options.far
        section = Section(size, far)
        section.build()
        even = max(1, round(DRIVE.length / size))
        volumes = DRIVE.volumes(section, even, 1.1 * size, 1 + 0.3 * size * far)
        name_groups(volumes, PLANES)


if __name__ == "__main__":
    main()

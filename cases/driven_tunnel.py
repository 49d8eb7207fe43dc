"""What the make_mesh.py of tunnels that are driven in rounds have in common.

A cross-section in blocks is extruded along y; the approach ends at y = 0, where the rounds begin.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import accumulate

import gmsh

geo = gmsh.model.geo


class BlockSection:
    """A cross-section in quadrilateral blocks that share their divisions.

    Args:
        back: y of the section.
    """

    def __init__(self, back: float) -> None:
        self.back = back
        self.curves: dict[tuple[int, int], int] = {}
        self.blocks: list[tuple[str, int]] = []

    def point(self, x: float, z: float) -> int:
        return int(geo.addPoint(x, self.back, z))

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


@dataclass(frozen=True)
class Drive:
    """The way of a tunnel.

    Args:
        back, front: y of the ends of the model, m.
        length, rounds: of a round, m; how many there are.
        ground: name of what is not excavated.
    """

    back: float
    front: float
    length: float
    rounds: int
    ground: str

    def volumes(
        self, section: BlockSection, even: int, first: float, growth: float
    ) -> dict[str, list[int]]:
        """Extrudes the blocks ``core``, ``lining`` and ``rock``; volumes by group.

        Args:
            section: at the back.
            even: layers of a round.
            first, growth: of the layers before and behind the rounds, the first one in m.
        """
        beyond = self.front - self.rounds * self.length
        pieces = [("approach", -self.back, _graded(-self.back, first, growth)[::-1])]
        pieces += [(f"round-{k + 1}", self.length, [1 / even] * even) for k in range(self.rounds)]
        pieces += [("", beyond, _graded(beyond, first, growth))]
        names = {"core": "{}", "lining": "lining-{}", "rock": self.ground}
        volumes: dict[str, list[int]] = {}
        faces = section.blocks
        for piece, length, layers in pieces:
            heights = list(accumulate(layers))
            tags = [(2, tag) for _, tag in faces]
            made = geo.extrude(tags, 0, length, 0, [1] * len(layers), heights, recombine=True)
            solids = [k for k, (dim, _) in enumerate(made) if dim == 3]
            for (kind, _), k in zip(faces, solids, strict=True):
                name = names[kind].format(piece) if piece else self.ground
                volumes.setdefault(name, []).append(made[k][1])
            faces = [(kind, made[k - 1][1]) for (kind, _), k in zip(faces, solids, strict=True)]
        return volumes


def _graded(length: float, first: float, growth: float) -> list[float]:
    """Heights of layers as fractions of the length, the first one about as thick as told."""
    layers, total = [first], first
    while total < length:
        layers.append(layers[-1] * growth)
        total += layers[-1]
    return [layer / total for layer in layers]


def name_groups(volumes: Mapping[str, list[int]], planes: Mapping[str, tuple[int, float]]) -> None:
    """Groups of the volumes, and of the outer faces by the axis across them and their place."""
    geo.synchronize()
    for name, tags in volumes.items():
        gmsh.model.addPhysicalGroup(3, tags, name=name)
    for name, (axis, place) in planes.items():
        low, high = [-1e3] * 3, [1e3] * 3
        low[axis], high[axis] = place - 1e-3, place + 1e-3
        tags = [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*low, *high, 2)]
        gmsh.model.addPhysicalGroup(2, tags, name=name)

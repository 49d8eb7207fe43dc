"""Makes the mesh of the braced pit: half of its section, three layers, four depths of digging.

Shipped mesh:        python make_mesh.py
Mesh of the truth:   python make_mesh.py --size 0.7 --triangles --slices --output fine.msh

The same call makes the same mesh. Needs gmsh (`pip install gmsh`). Lengths in m: x from the plane
of symmetry, y upwards from the surface.
"""

import itertools
import sys
from pathlib import Path

import gmsh

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from mesh_script import QUADRILATERALS, TRIANGLES, grow, lines, mesh_file, read_options  # noqa: E402

WALL, RIGHT = 10.0, 60.0
STRUTS = (-2.0, -5.5)  # their levels
TOE = -18.0
# levels of the lower face of each slice of ground at the plane of symmetry, at the wall and at the
# right edge, and what it is called inside the wall and behind it
SLICES = [
    ((-3.0, -3.0, -5.0), "dig-1", "fill"),
    ((-6.5, -6.5, -8.5), "dig-2", "clay-1"),
    ((-9.5, -9.5, -12.0), "dig-3", "clay-2"),
    ((-12.0, -12.0, -15.5), "dig-4", "clay-3"),
    ((-14.0, -14.8, -19.0), "clay-4", "clay-4"),
    ((-17.5, TOE, -23.0), "sand-1", "sand-1"),
    ((-26.0, -26.0, -30.0), "sand-2", "sand-2"),
    ((-40.0, -40.0, -40.0), "sand-3", "sand-3"),
]
# element size at the wall, and how it grows with the distance
FINE, GROWTH = 1.1, 0.12

geo = gmsh.model.geo


def column(
    x: float, levels: list[float], more: tuple[float, ...] = ()
) -> tuple[list[int], list[list[int]]]:
    """Points between slices from the surface down, and the lines along each slice.

    Args:
        x: where the column stands.
        levels: lower faces of the slices.
        more: further levels that have points.
    """
    every = sorted({0.0, *levels, *more}, reverse=True)
    points = {y: geo.addPoint(x, y, 0.0) for y in every}
    ends = [0.0, *levels]
    sides = [
        lines([points[y] for y in every if low <= y <= high])
        for high, low in itertools.pairwise(ends)
    ]
    return [points[y] for y in ends], sides


def build(size: float, *, slices: bool, layers: bool) -> None:
    """The geometry with its groups."""
    levels = [[row[0][k] for row in SLICES] for k in range(3)]
    columns = [
        column(0.0, levels[0], STRUTS),
        column(WALL, levels[1], STRUTS),
        column(RIGHT, levels[2]),
    ]
    groups: dict[str, list[int]] = {}
    bottom = []
    for side, ((ends, left), (others, right)) in enumerate(itertools.pairwise(columns)):
        beds = [geo.addLine(a, b) for a, b in zip(ends, others, strict=True)]
        for k, row in enumerate(SLICES):
            back = [-line for line in reversed(right[k])]
            loop = geo.addCurveLoop([*left[k], beds[k + 1], *back, -beds[k]])
            layer = row[1 + side]
            name = layer if slices or layer.startswith("dig") else layer.split("-")[0]
            groups.setdefault(name, []).append(geo.addPlaneSurface([loop]))
        bottom.append(beds[-1])
    geo.synchronize()
    for name, tags in groups.items():
        gmsh.model.addPhysicalGroup(2, tags, name=name)
    (_, axis), (_, behind), (_, edge) = columns
    count = [row[0][1] for row in SLICES].index(TOE) + 1
    wall = list(itertools.chain(*behind[:count]))
    curves = {"axis": [*itertools.chain(*axis)], "side": [*itertools.chain(*edge)]}
    if layers:
        for side, row in zip(behind[:count], SLICES, strict=False):
            curves.setdefault(f"wall in {row[2].split('-')[0]}", []).extend(side)
    for name, tags in {**curves, "bottom": bottom, "wall": wall}.items():
        gmsh.model.addPhysicalGroup(1, tags, name=name)
    grow(size, [(FINE, GROWTH, "CurvesList", wall)])


def main() -> None:
    flags = {
        "triangles": "in place of quadrilaterals",
        "layers": "a group for the wall in each layer",
        "slices": "a group for each slice of a layer, whose moduli can then grow with depth",
    }
    options = read_options(__doc__, HERE / "pit.msh", order=2, flags=flags)
    with mesh_file(options, TRIANGLES if options.triangles else QUADRILATERALS):
        build(options.size, slices=options.slices, layers=options.layers)


if __name__ == "__main__":
    main()

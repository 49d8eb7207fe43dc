"""Make the meshes of tests, which come with geoident: python tests/manual/make_specimens.py

All have unit size: a cylinder of radius and height 1 m, a shear box of 1 m with its cap, a disk
around a cavity of radius 1 m, a half-space under a plate of radius 1 m.
"""

from pathlib import Path

import numpy as np

FOLDER = Path(__file__).parents[2] / "geoident" / "io" / "mesh" / "shipped_meshes"
FAR = 1000.0  # m from a cavity or a plate to the edge of its ground


def write(name, points, cells, groups, lines):
    """An MSH 2.2 file.

    Args:
        name: of the mesh.
        points: (n, 2).
        cells: lists of nodes from 0, corners first; all of one kind.
        groups: name to numbers of cells.
        lines: name to lists of nodes (2 or 3), corners first.
    """
    names = [(2, g) for g in groups] + [(1, g) for g in lines]
    tag = {key: n for n, key in enumerate(names, 1)}
    kinds = {4: 3, 8: 16}
    rows = [
        (8 if len(part) == 3 else 1, tag[1, g], part)
        for g, parts in lines.items()
        for part in parts
    ]
    rows += [(kinds[len(cells[n])], tag[2, g], cells[n]) for g, own in groups.items() for n in own]
    text = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(names))]
    text += [f'{dim} {n} "{g}"' for (dim, g), n in tag.items()]
    text += ["$EndPhysicalNames", "$Nodes", str(len(points))]
    text += [f"{n} {x:.10g} {y:.10g} 0" for n, (x, y) in enumerate(points, 1)]
    text += ["$EndNodes", "$Elements", str(len(rows))]
    text += [
        f"{n} {kind} 2 {group} {group} {' '.join(str(k + 1) for k in part)}"
        for n, (kind, group, part) in enumerate(rows, 1)
    ]
    (FOLDER / f"{name}.msh").write_text("\n".join([*text, "$EndElements"]) + "\n")


def grid(x, y, keep):
    """Eight-node elements between grid lines, and what finds a node at the half steps (i, j)."""
    at, points, cells = {}, [], []
    halves = [np.interp(np.arange(2 * len(v) - 1) / 2, np.arange(len(v)), v) for v in (x, y)]

    def node(i, j):
        if (i, j) not in at:
            at[i, j] = len(points)
            points.append((halves[0][i], halves[1][j]))
        return at[i, j]

    around = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1))
    for i in range(len(x) - 1):
        for j in range(len(y) - 1):
            if keep(x[i], y[j]):
                cells.append([node(2 * i + a, 2 * j + b) for a, b in around])
    return np.array(points), cells


def edges(points, cells, on):
    """Quadratic lines on the boundary whose middle fulfils a condition."""
    sides = ((0, 1, 4), (1, 2, 5), (2, 3, 6), (3, 0, 7))
    found = {}
    for cell in cells:
        for side in sides:
            part = [cell[k] for k in side]
            if on(*points[part[2]]):
                found[part[2]] = part
    return list(found.values())


def growing(first, ratio, start, end):
    """Grid lines from start to end whose distances grow."""
    lines = [start]
    while lines[-1] + 1.5 * first < end:
        lines.append(lines[-1] + first)
        first *= ratio
    return np.array([*lines, end])


square = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (1, 2), (0, 2)], float)
one = np.array([0.0, 1.0])
p, c = grid(one, one, lambda x, y: True)  # pressures of water need elements of second order
write(
    "specimen", p, c, {"specimen": [0]},
    {
        "bottom": edges(p, c, lambda x, y: y == 0.0),
        "side": edges(p, c, lambda x, y: x == 1.0),
        "top": edges(p, c, lambda x, y: y == 1.0),
    },
)  # fmt: skip
write(
    "shear-box", square, [[0, 1, 2, 3], [3, 2, 4, 5]], {"specimen": [0], "cap": [1]},
    {"bottom": [[0, 1]], "moved": [[2, 3], [4, 5]], "top": [[4, 5]]},
)  # fmt: skip

x = growing(0.02, 1.12, 1.0, FAR)
p, c = grid(x, np.array([0.0, 1.0]), lambda x, y: True)
write(
    "cavity", p, c, {"ground": range(len(c))},
    {
        "wall": edges(p, c, lambda x, y: x < 1.001),
        "far": edges(p, c, lambda x, y: x > FAR - 0.001),
        "held": edges(p, c, lambda x, y: y in (0.0, 1.0)),
    },
)  # fmt: skip

under = 1.0 - growing(0.02, 1.5, 0.0, 1.0)[::-1]
x = np.concatenate([under, growing(0.02, 1.5, 1.0, FAR)[1:]])
y = np.concatenate([-growing(0.03, 1.4, 0.0, FAR)[::-1], [0.2]])
p, c = grid(x, y, lambda x, y: y < 0.0 or x < 0.999)
plate = [n for n, cell in enumerate(c) if p[cell[2], 1] > 0.1]
write(
    "half-space", p, c, {"ground": [n for n in range(len(c)) if n not in plate], "plate": plate},
    {
        "surface": edges(p, c, lambda x, y: y == 0.0 and x > 1.0),
        "under": edges(p, c, lambda x, y: y == 0.0 and x < 1.0),
        "top": edges(p, c, lambda x, y: y > 0.19),
        "far": edges(p, c, lambda x, y: x > FAR - 0.001 or y < 0.001 - FAR),
    },
)  # fmt: skip

"""Meshes as Abaqus decks, with their groups of elements and the nodes of their faces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from geoident.model.mesh import Mesh, rows_in, spans

_TYPES = {"tri3": "CPE3", "tri6": "CPE6", "quad4": "CPE4", "quad8": "CPE8", "hex8": "C3D8"}


def write_deck(mesh: Mesh, path: Path) -> None:
    """Write a mesh; groups of lines become sets of nodes."""
    lines = ["*NODE"]
    for n, point in enumerate(mesh.points.tolist(), start=1):
        lines.append(", ".join([str(n), *map(repr, point), *["0"] * (3 - mesh.dim)]))
    for block, span in spans(mesh.blocks):
        lines.append(f"*ELEMENT, TYPE={_TYPES[block.kind]}")
        for n, nodes in enumerate(block.nodes + 1, start=span.start + 1):
            lines.append(", ".join(map(str, (n, *nodes))))
    for name, members in mesh.groups.items():
        lines += [f"*ELSET, ELSET={name}", *(str(n + 1) for n in members)]
    for name, members in mesh.facet_groups.items():
        found = [block.nodes[rows].ravel() for block, rows in rows_in(mesh.facets, members)]
        lines += [f"*NSET, NSET={name}", *(str(n + 1) for n in np.unique(np.concatenate(found)))]
    path.write_text("\n".join(lines) + "\n")


def write_grid(
    path: Path,
    n: tuple[int, int],
    size: tuple[int, int],
    groups: Sequence[str],
    group_of: Callable[[float, float], str],
    *,
    low: int = 0,
    sides: tuple[str, str, str] = ("left", "right", "bottom"),
) -> None:
    """Write a grid of quads from x = 0 and y = low on, with the nodes of three of its sides.

    Args:
        path: of the deck.
        n: number of elements each way.
        size: width and height, m.
        groups: names of the groups of elements, in the order of the deck.
        group_of: the group of an element by the coordinates of its centre, m.
        low: the coordinate y of its bottom, m.
        sides: names of the left side, the right side and the bottom.
    """
    (nx, ny), (width, height) = n, size
    number = {(i, j): 1 + i + (nx + 1) * j for j in range(ny + 1) for i in range(nx + 1)}
    lines = ["*NODE"]
    lines += [f"{k}, {width * i / nx}, {height * j / ny + low}, 0" for (i, j), k in number.items()]
    members: dict[str, list[int]] = {name: [] for name in groups}
    lines.append("*ELEMENT, TYPE=CPE4")
    for j in range(ny):
        for i in range(nx):
            element = 1 + i + nx * j
            corners = [number[c] for c in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))]
            lines.append(", ".join(map(str, [element, *corners])))
            x, y = width * (i + 0.5) / nx, height * (j + 0.5) / ny + low
            members[group_of(x, y)].append(element)
    for name, elements in members.items():
        lines += [f"*ELSET, ELSET={name}", *map(str, elements)]
    ends = [(0, 0), (0, nx), (1, 0)]  # axis, and number along it
    for name, (axis, end) in zip(sides, ends, strict=True):
        nodes = [k for at, k in number.items() if at[axis] == end]
        lines += [f"*NSET, NSET={name}", *map(str, nodes)]
    path.write_text("\n".join(lines) + "\n")

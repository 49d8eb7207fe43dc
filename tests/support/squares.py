"""Cases on a grid of squares of 1 m, as files: for what is said of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from support.commands import run_command

BASE = """\
format: geoident-case/1
analysis: plane-strain
mesh: {file: squares.msh}
parameters: {E: {start: 2 GPa, bounds: [0.1 GPa, 50 GPa], scale: log}}
materials: {rock: {E: $E, nu: 0.25}}
groups: {ground: rock, top: rock}
supports: {left: x, right: x, bottom: [x, y]}
stages: [{name: dig, excavate: [top]}]
gauges: {S: {kind: settlement, point: [2 m, 3 m], accuracy: 0.1 mm}}
"""
"""Four rows of squares, ``ground`` and the uppermost row, ``top``, which is excavated."""

GroupOf = Callable[[int, int], str]
"""Column and row of a square to its group."""


def case_of(**keys: str) -> str:
    """The lines of `BASE`, some of them with another value, one to a key; an empty one leaves."""
    lines = dict(line.split(": ", 1) for line in BASE.splitlines())
    lines |= keys
    return "".join(f"{key}: {value}\n" for key, value in lines.items() if value)


def said_of(folder: Path, text: str, mesh: str = "") -> str:
    """What ``geoident check`` says of a case."""
    (folder / "squares.msh").write_text(mesh or grid())
    (folder / "case.yaml").write_text(text)
    found = run_command("check", folder / "case.yaml")
    assert found.exception is None or isinstance(found.exception, SystemExit), found.output
    return found.output.replace(f"{folder}/", "")


def upper_row(_: int, row: int) -> str:
    """Group ``top`` for the fourth row, ``ground`` below."""
    return "top" if row == 3 else "ground"


def grid(
    columns: int = 4,
    rows: int = 4,
    group: GroupOf = upper_row,
    *,
    parted: bool = False,
    x0: int = 0,
) -> str:
    """The mesh, in gmsh's format 2.2: groups of squares, and of the lines at its edges.

    Args:
        columns: number of squares side by side, from x = `x0` on.
        rows: number of squares on one another, from y = 0 on.
        group: the group of a square.
        parted: whether each group has nodes of its own.
        x0: the left edge, m.
    """
    nodes: dict[tuple[int, int, str], int] = {}
    cells: list[tuple[int, str, list[int]]] = []
    edges = {"left": (0, 3), "right": (1, 2), "bottom": (0, 1), "crest": (2, 3)}
    for row in range(rows):
        for column in range(columns):
            name = group(column, row)
            corners = ((column, row), (column + 1, row), (column + 1, row + 1), (column, row + 1))
            key = name if parted else ""
            quad = [nodes.setdefault((*at, key), len(nodes) + 1) for at in corners]
            cells.append((3, name, quad))
            at_edge = {
                "left": column == 0, "right": column == columns - 1,
                "bottom": row == 0, "crest": row == rows - 1,
            }  # fmt: skip
            cells += [(1, e, [quad[k] for k in edges[e]]) for e, there in at_edge.items() if there]
            if group(column, row + 1) != name and row < rows - 1:
                cells.append((1, f"above {name}", [quad[3], quad[2]]))
    names = list(dict.fromkeys((kind, name) for kind, name, _ in cells))
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(names))]
    lines += [f'{1 if kind == 1 else 2} {n} "{name}"' for n, (kind, name) in enumerate(names, 1)]
    lines += ["$EndPhysicalNames", "$Nodes", str(len(nodes))]
    lines += [f"{n} {x + x0} {y} 0" for (x, y, _), n in nodes.items()]
    lines += ["$EndNodes", "$Elements", str(len(cells))]
    for number, (kind, name, corners) in enumerate(cells, 1):
        tag = names.index((kind, name)) + 1
        lines.append(" ".join(map(str, (number, kind, 2, tag, tag, *corners))))
    return "\n".join([*lines, "$EndElements", ""])

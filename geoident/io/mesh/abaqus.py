"""Meshes in Abaqus input files (also of CalculiX and, as gmsh writes them, of gmsh).

Read here and not through meshio, whose reader (5.3.5) keeps only the last of several *NODE
blocks and of several *ELEMENT blocks with one ELSET, puts sets of elements into the wrong block,
and does not know the plane strain and axisymmetric elements.

Format: Abaqus Keywords Reference, *NODE, *ELEMENT, *NSET, *ELSET, *INCLUDE. Names are read
without regard to case by Abaqus; here they keep the case in which they are first written.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from geoident.io.mesh.raw import (
    RawCells,
    RawMesh,
    Refused,
    check_unique,
    indices_of,
    join,
    resolve_nodes,
)
from geoident.model.arrays import Floats, Ints
from geoident.model.cells import CELLS

_LINES, _PLANES, _SOLIDS = (
    {str(cell.n_nodes): cell.kind for cell in CELLS.values() if cell.dim == dim}
    for dim in (1, 2, 3)
)
_TYPES = (
    (r"(?:T2D|T3D|R2D|RAX)([23])[A-Z]*", _LINES),
    (r"(?:B[23]|SAX|MAX)([123])[A-Z]*", {"1": "line2", "2": "line3", "3": "line2"}),
    (r"STRI()65", {"": "tri6"}),
    (r"(?:STRI|[SM]3D|SFM3D|R3D|DS|S)([3-9])[A-Z]*5?", _PLANES),
    (r"(?:CPEG|CPE|CPS|CGAX|CAX|AC2D|ACAX|DC2D|DCAX|M3D)([3-9])[A-Z]*", _PLANES),
    (r"(?:C3D|AC3D|DC3D)(\d+)[A-Z]*", _SOLIDS),
)
_DEPTH = 8
"""Files that include each other at most."""


@dataclass(frozen=True)
class _Keyword:
    """A keyword with its parameters and data lines.

    Args:
        keyword: in capitals, without the star.
        parameters: in capitals; the value as written, empty for none.
        lines: its data lines.
        line: where it stands, from 1.
        folder: folder of the file, for *INCLUDE.
    """

    keyword: str
    parameters: dict[str, str]
    lines: list[str]
    line: int
    folder: Path


@dataclass
class _Content:
    """What is read so far, everything by number."""

    nodes: list[tuple[Ints, Floats]] = field(default_factory=list)
    elements: list[tuple[str, Ints, Ints]] = field(default_factory=list)
    nsets: dict[str, list[Ints]] = field(default_factory=lambda: defaultdict(list))
    elsets: dict[str, list[Ints]] = field(default_factory=lambda: defaultdict(list))
    spelling: dict[str, str] = field(default_factory=dict)
    last_instance: bool = False

    def spell(self, name: str) -> str:
        """The first spelling of a name."""
        return self.spelling.setdefault(name.upper(), name)


def read_abaqus(text: str, *, folder: Path) -> RawMesh:
    """The mesh in the text of an Abaqus input file.

    ELSETs become groups, NSETs groups of nodes.

    Args:
        text: the file.
        folder: where files that it includes are looked for.

    Raises:
        Refused: a line cannot be understood, with its number.
    """
    if not text.endswith(("\n", "\r")):
        hint = "copy it again; if it is complete, end its last line"
        raise Refused("mesh-truncated", "the file ends within a line", hint)
    content = _Content()
    for block in _keywords(text, folder, depth=0):
        _read_block(block, content)
    if not content.nodes or not content.elements:
        missing = "*NODE" if not content.nodes else "*ELEMENT"
        raise Refused("mesh-empty", f"the file has no {missing}", "export the mesh with its nodes")
    return _assemble(content)


def _keywords(text: str, folder: Path, *, depth: int) -> Iterator[_Keyword]:
    """The keywords of a file and of the files that it includes."""
    block: _Keyword | None = None
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith("**") or not line.strip():
            continue
        if line.lstrip().startswith("*"):
            if block is not None:
                yield from _included(block, depth)
            block = _keyword(line.strip(), number, folder)
        elif block is not None:
            block.lines.append(line)
        else:
            raise Refused("mesh-malformed", "the first keyword is missing", "", number)
    if block is not None:
        yield from _included(block, depth)


def _keyword(line: str, number: int, folder: Path) -> _Keyword:
    """A keyword line."""
    keyword, *words = line[1:].split(",")
    pairs = (word.partition("=") for word in words)
    parameters = {key.strip().upper(): value.strip().strip('"') for key, _, value in pairs}
    return _Keyword(" ".join(keyword.upper().split()), parameters, [], number, folder)


def _included(block: _Keyword, depth: int) -> Iterator[_Keyword]:
    """The block itself, or what the file holds that it includes."""
    if block.keyword != "INCLUDE":
        yield block
        return
    path = block.folder / block.parameters.get("INPUT", "")
    if depth >= _DEPTH:
        raise Refused("mesh-include", "files include each other without end", "", block.line)
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except (OSError, ValueError) as error:
        message = f"the included file {path} cannot be read"
        hint = "put it there, or write the mesh as one file"
        raise Refused("mesh-include", message, hint, block.line) from error
    yield from _keywords(text, path.parent, depth=depth + 1)


def _read_block(block: _Keyword, content: _Content) -> None:
    """Take over what matters for the mesh."""
    try:
        if block.keyword == "NODE":
            _read_nodes(block, content)
        elif block.keyword == "ELEMENT":
            _read_elements(block, content)
        elif block.keyword in ("NSET", "ELSET"):
            _read_set(block, content)
        else:
            _check_others(block, content)
    except (ValueError, OverflowError) as error:
        message = f"the data of *{block.keyword} hold something that is not a number"
        raise Refused("mesh-malformed", message, "", block.line) from error


def _check_others(block: _Keyword, content: _Content) -> None:
    """Refuse keywords that move or make nodes and elements unseen."""
    if block.keyword in ("SYSTEM", "NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY"):
        message = f"*{block.keyword} is not read: it makes or moves nodes or elements"
    elif block.keyword == "INSTANCE" and (block.lines or content.last_instance):
        message = "a part with several instances, or with one that is moved, is not read"
    else:
        content.last_instance |= block.keyword == "INSTANCE"
        return
    hint = "export a flat mesh, with all nodes and elements (an orphan mesh)"
    raise Refused("mesh-keyword", message, hint, block.line)


def _read_nodes(block: _Keyword, content: _Content) -> None:
    """*NODE: number and coordinates; a missing coordinate is 0."""
    if block.parameters.get("SYSTEM", "R").upper() != "R":
        hint = "export the nodes in Cartesian coordinates"
        raise Refused("mesh-keyword", "*NODE has a curved SYSTEM", hint, block.line)
    rows = [_split(line) for line in block.lines]
    if any(len(row) < 2 for row in rows):
        raise Refused("mesh-malformed", "a line of *NODE is too short", "", block.line)
    numbers = np.array([int(row[0]) for row in rows], dtype=np.int64)
    coordinates = [[float(x or 0) for x in (*row[1:4], "0", "0")][:3] for row in rows]
    content.nodes.append((numbers, np.array(coordinates, dtype=float).reshape(-1, 3)))
    if block.parameters.get("NSET"):
        content.nsets[content.spell(block.parameters["NSET"])].append(numbers)


def _read_elements(block: _Keyword, content: _Content) -> None:
    """*ELEMENT: number and nodes, over as many lines as it takes."""
    kind = _kind(block.parameters.get("TYPE", ""), block.line)
    words = [word for line in block.lines for word in _split(line) if word]
    width = 1 + CELLS[kind].n_nodes
    if len(words) % width:
        message = f"the elements of *ELEMENT do not have {width - 1} nodes each"
        raise Refused("mesh-malformed", message, "", block.line)
    rows = np.array(words, dtype=np.int64).reshape(-1, width)
    content.elements.append((kind, rows[:, 0], rows[:, 1:]))
    if block.parameters.get("ELSET"):
        content.elsets[content.spell(block.parameters["ELSET"])].append(rows[:, 0])


def _kind(name: str, line: int) -> str:
    """Kind of the elements of an Abaqus type."""
    for pattern, kinds in _TYPES:
        match = re.fullmatch(pattern, name.upper())
        if match is not None and match[1] in kinds:
            return kinds[match[1]]
    raise Refused(
        "mesh-kind",
        f"elements of the type {name or '(none given)'} are not read",
        "known are solids C3D.., planes CPE.., CPS.., CAX.., S.. and lines T3D.., B..",
        line,
    )


def _read_set(block: _Keyword, content: _Content) -> None:
    """*NSET and *ELSET: numbers, names of other sets, or ranges."""
    name = block.parameters.get(block.keyword, "")
    if not name:
        message = f"*{block.keyword} has no name"
        raise Refused("mesh-malformed", message, f"{block.keyword}=NAME", block.line)
    sets = content.nsets if block.keyword == "NSET" else content.elsets
    target = sets[content.spell(name)]
    rows = [[word for word in _split(line) if word] for line in block.lines]
    if "GENERATE" in block.parameters:
        target += [_range([int(word) for word in row], block.line) for row in rows]
        return
    words = [word for row in rows for word in row]
    target.append(np.array([int(w) for w in words if w.isdecimal()], dtype=np.int64))
    for other in (w for w in words if not w.isdecimal()):
        if content.spell(other) not in sets:
            message = f"the set {name} names the set {other}, which is not defined before it"
            raise Refused("mesh-set", message, "", block.line)
        target += list(sets[content.spell(other)])


def _range(row: list[int], line: int) -> Ints:
    """First, last and step of a generated set."""
    first, last, step = (*row, 1)[:3] if len(row) in (2, 3) else (0, 0, 0)
    if step < 1 or not 0 <= last - first < 10**9:
        raise Refused("mesh-malformed", "GENERATE needs first, last and step", "", line)
    return np.arange(first, last + 1, step, dtype=np.int64)


def _split(line: str) -> list[str]:
    return [word.strip() for word in line.split(",")]


def _assemble(content: _Content) -> RawMesh:
    """The mesh of what was read."""
    numbers = np.concatenate([block for block, _ in content.nodes])
    check_unique(numbers)
    cells = tuple(
        RawCells(kind, CELLS[kind].dim, resolve_nodes(numbers, nodes, cells=ids), ids)
        for kind, ids, nodes in content.elements
    )
    ids = np.concatenate([block.numbers for block in cells])
    hint = "number elements once, over all parts"
    check_unique(ids, "element", code="mesh-duplicate", hint=hint)
    return RawMesh(
        np.concatenate([points for _, points in content.nodes]),
        cells,
        groups=_resolve_sets(content.elsets, ids),
        node_groups=_resolve_sets(content.nsets, numbers),
    )


def _resolve_sets(sets: dict[str, list[Ints]], numbers: Ints) -> dict[str, Ints]:
    """Sets of numbers as sets of indices; numbers that nothing has are left out, as Abaqus does."""
    united = join(sets)
    places = {name: [indices_of(numbers, wanted)] for name, wanted in united.items()}
    return join({name: [place[place >= 0] for place in parts] for name, parts in places.items()})

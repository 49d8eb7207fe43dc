"""Meshes of gmsh: MSH 2.2 and 4.1, as text and binary.

Read here and not through meshio, which loses the numbers of the elements, all but the first of
several physical groups of an element and groups of equal name in different dimensions, and which
refuses a file in which only some of the elements belong to a group.

Format: gmsh reference manual, "MSH file format" and "Legacy formats".
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from geoident.io.mesh.gmsh_stream import Encoding, Stream
from geoident.io.mesh.raw import (
    RawCells,
    RawMesh,
    Refused,
    check_unique,
    first_of_equal,
    join,
    resolve_nodes,
    row_keys,
    split_by,
)
from geoident.model.arrays import Floats, Ints
from geoident.model.cells import CELLS
from geoident.model.mesh import spans

_AGAIN = "write it again: gmsh FILE -save -format msh41 -o NEW.msh"
_INCOMPLETE = "it was not written or copied completely: make or copy it again"
_TYPES = {cell.gmsh: cell for cell in CELLS.values()}

Names = dict[tuple[int, int], str]
"""Dimension and tag of a physical group: its name."""


Entities = Mapping[tuple[int, int], tuple[int, ...]]
"""Dimension and tag of an entity of the geometry: tags of its physical groups."""


@dataclass(frozen=True)
class _Elements:
    """Elements of one type.

    Args:
        kind: kind of the elements.
        numbers: (n,) element numbers.
        nodes: (n, k) node numbers in gmsh's order.
        physical: tag of a physical group to the rows of its elements.
    """

    kind: str
    numbers: Ints
    nodes: Ints
    physical: Mapping[int, Ints] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.numbers)

    @property
    def dim(self) -> int:
        """Dimension of the elements."""
        return CELLS[self.kind].dim


@dataclass
class _Parts:
    """The sections of a file that matter, as far as they are read."""

    version: str
    names: Names = field(default_factory=dict)
    entities: Entities = field(default_factory=dict)
    nodes: tuple[Ints, Floats] | None = None
    blocks: list[_Elements] | None = None


def is_gmsh(head: bytes) -> bool:
    """Whether a file that begins with ``head`` is a mesh of gmsh."""
    return head.lstrip().startswith((b"$MeshFormat", b"$Comments", b"$PhysicalNames", b"$NOD"))


def read_gmsh(data: bytes) -> RawMesh:
    """The mesh in the bytes of an MSH file.

    Groups carry the names of the physical groups; a group without a name has its tag as name.
    An element of several groups is in each of them.

    Raises:
        Refused: the file is damaged, or of a version or with contents that are not read.
    """
    version, encoding = _read_header(data)
    parts = _Parts(version)
    position = 0
    while (start := re.compile(rb"\s*\$(\w+)[^\n]*\n?").match(data, position)) is not None:
        name = start[1].decode("ascii", "replace")
        end = data.find(b"$End" + start[1], start.end())
        if end < 0:
            raise Refused(
                "mesh-truncated", f"the file ends within the section ${name}", _INCOMPLETE
            )
        _read_section(name, data[start.end() : end], encoding, parts)
        position = end + len(b"$End" + start[1])
    if data[position:].strip(b"\0 \t\r\n"):
        raise Refused("mesh-malformed", "something stands between the sections", _AGAIN)
    return _assemble(parts)


def _read_header(data: bytes) -> tuple[str, Encoding]:
    """Version of the format and how the file holds its numbers."""
    if data.lstrip().startswith(b"$NOD"):
        raise Refused("mesh-version", "the file has MSH version 1, which is not read", _AGAIN)
    match = re.search(rb"\$MeshFormat\s+([\d.]+)\s+([01])\s+([48])[ \t]*\r?\n", data[:100_000])
    if match is None:
        raise Refused("mesh-malformed", "the section $MeshFormat is missing or damaged", _AGAIN)
    version = match[1].decode()
    if version not in ("2", "2.0", "2.1", "2.2", "4", "4.1"):
        raise Refused("mesh-version", f"MSH version {version} is not read, 2.2 and 4.1 are", _AGAIN)
    if match[2] == b"0":
        return version, Encoding()
    one = data[match.end() : match.end() + 4]
    return version, Encoding(True, "<" if one == b"\1\0\0\0" else ">", int(match[3]))


def _read_section(name: str, section: bytes, encoding: Encoding, parts: _Parts) -> None:
    """Read one section, if it is one that matters."""
    new = parts.version.startswith("4")
    if name == "PhysicalNames":
        parts.names.update(_read_names(section))
    elif name == "PartitionedEntities":
        message = "the mesh is partitioned"
        raise Refused("mesh-partitioned", message, "save it with gmsh's option Mesh.NbPartitions=0")
    elif name in ("Nodes", "Elements") or (name == "Entities" and new):
        if {"Nodes": parts.nodes, "Elements": parts.blocks}.get(name) is not None:
            raise Refused("mesh-malformed", f"the section ${name} is there more than once", _AGAIN)
        stream = Stream(section, name=name, encoding=encoding)
        if name == "Entities":
            parts.entities = _read_entities(stream)
        elif name == "Nodes":
            parts.nodes = _read_nodes_v4(stream) if new else stream.numbered(stream.count(), 3)
        elif new:
            parts.blocks = _read_elements_v4(stream, parts.entities)
        else:
            parts.blocks = _read_elements_v2(stream)
        if stream.rest():
            message = f"the section ${name} holds more than it announces"
            raise Refused("mesh-malformed", message, _AGAIN)


def _read_names(section: bytes) -> Names:
    """Names of the physical groups; MSH 2.0 gives no dimension, then the name is for all."""
    try:
        text = section.decode("utf-8")
    except UnicodeDecodeError:
        text = section.decode("latin-1")
    names: Names = {}
    for line in text.split("\n")[1:]:
        match = re.match(r'\s*(?:([0-3])\s+)?(\d{1,9})\s+"(.*)"\s*$', line)
        if match is None and line.strip():
            message = f"the section $PhysicalNames holds {line.strip()[:60]!r}"
            raise Refused("mesh-malformed", message, 'expected: dimension tag "name"')
        if match is not None:
            dims = range(4) if match[1] is None else (int(match[1]),)
            names.update({(dim, int(match[2])): match[3] for dim in dims})
    return names


def _element_type(number: int) -> tuple[str, int]:
    """Kind and number of nodes of gmsh's element type."""
    if number not in _TYPES:
        raise Refused(
            "mesh-kind",
            f"the mesh has elements of gmsh's type {number}, which is not of order 1 or 2",
            "mesh with gmsh's option Mesh.ElementOrder=1 or 2",
        )
    return _TYPES[number].kind, _TYPES[number].n_nodes


def _read_entities(stream: Stream) -> Entities:
    """Physical groups of each entity (section $Entities of MSH 4.1)."""
    entities: dict[tuple[int, int], tuple[int, ...]] = {}
    for dim, n in enumerate(stream.sizes(4)):
        for _ in range(n):
            tag = int(stream.ints(1)[0])
            stream.floats(3 if dim == 0 else 6)
            groups = stream.ints(int(stream.sizes(1)[0]))
            entities[dim, tag] = tuple(int(group) for group in np.unique(np.abs(groups)))
            if dim > 0:
                stream.ints(int(stream.sizes(1)[0]))
    return entities


def _read_nodes_v4(stream: Stream) -> tuple[Ints, Floats]:
    """Node numbers and (n, 3) coordinates, m (section $Nodes of MSH 4.1)."""
    n_blocks, total = (int(k) for k in stream.sizes(4)[:2])
    numbers, points = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))]
    for _ in range(n_blocks):
        dim, _, parametric = (int(k) for k in stream.ints(3))
        n = int(stream.sizes(1)[0])
        width = 3 + (dim if parametric else 0)
        numbers.append(stream.sizes(n))
        points.append(stream.floats(n * width).reshape(n, width)[:, :3])
    _check_count("Nodes", sum(map(len, numbers)), total)
    return np.concatenate(numbers), np.concatenate(points)


def _read_elements_v4(stream: Stream, entities: Entities) -> list[_Elements]:
    """The elements, a block for each entity and type (section $Elements of MSH 4.1)."""
    n_blocks, total = (int(k) for k in stream.sizes(4)[:2])
    blocks = []
    for _ in range(n_blocks):
        dim, tag, number = (int(k) for k in stream.ints(3))
        kind, width = _element_type(number)
        n = int(stream.sizes(1)[0])
        rows = stream.sizes(n * (1 + width)).reshape(n, 1 + width)
        physical = {group: np.arange(n) for group in entities.get((dim, tag), ()) if group}
        blocks.append(_Elements(kind, rows[:, 0], rows[:, 1:], physical))
    _check_count("Elements", sum(map(len, blocks)), total)
    return blocks


def _read_elements_v2(stream: Stream) -> list[_Elements]:
    """The elements, a block for each type (section $Elements of MSH 2.2)."""
    total = stream.count()
    runs = _text_runs(stream, total) if stream.text else _binary_runs(stream, total)
    by_kind: dict[str, list[Ints]] = {}
    for kind, rows in runs:
        by_kind.setdefault(kind, []).append(rows)
    return [_merge_groups(kind, np.concatenate(rows)) for kind, rows in by_kind.items()]


def _binary_runs(stream: Stream, total: int) -> Iterator[tuple[str, Ints]]:
    """Runs of equal elements: kind and rows of number, physical, elementary, nodes."""
    done = 0
    while done < total:
        number, n, n_tags = (int(k) for k in stream.ints(3))
        kind, width = _element_type(number)
        if n < 1 or n_tags < 0:
            raise Refused("mesh-malformed", "the section $Elements is damaged", "write it again")
        rows = stream.ints(n * (1 + n_tags + width)).reshape(n, 1 + n_tags + width)
        yield kind, _trim(rows[:, 0], rows[:, 1 : 1 + n_tags], rows[:, 1 + n_tags :])
        done += n


def _text_runs(stream: Stream, total: int) -> Iterator[tuple[str, Ints]]:
    """The same from text, where each row says its own type and number of tags."""
    values, start, done = stream.ints(stream.rest()), 0, 0
    while done < total:
        if start + 3 > len(values):
            raise Refused(
                "mesh-truncated", "the section $Elements ends too early", "write it again"
            )
        kind, width = _element_type(int(values[start + 1]))
        n_tags = int(values[start + 2])
        rows = _equal_rows(values[start:], width=3 + max(n_tags, 0) + width, most=total - done)
        yield kind, _trim(rows[:, 0], rows[:, 3 : 3 + n_tags], rows[:, 3 + n_tags :])
        start, done = start + rows.size, done + len(rows)
    _check_count("Elements", start, len(values))


def _equal_rows(values: Ints, *, width: int, most: int) -> Ints:
    """The leading rows of ``width`` numbers that agree in type and number of tags.

    Looks at ever longer pieces, so that the whole costs a time in proportion to the file.
    """
    n, length = 0, 64
    while True:
        piece = values[n * width : (n + length) * width]
        rows = piece[: len(piece) // width * width].reshape(-1, width)[: most - n]
        differ = np.flatnonzero(np.any(rows[:, 1:3] != values[1:3], axis=1))
        n += int(differ[0]) if len(differ) else len(rows)
        if len(differ) or len(rows) < length:
            break
        length *= 2
    if n == 0:
        raise Refused("mesh-truncated", "the section $Elements ends too early", "write it again")
    return values[: n * width].reshape(n, width)


def _trim(numbers: Ints, tags: Ints, nodes: Ints) -> Ints:
    """Rows of number, physical tag, elementary tag, nodes; 0 for tags that are not given."""
    padded = np.zeros((len(numbers), 2), dtype=np.int64)
    padded[:, : min(2, tags.shape[1])] = tags[:, :2]
    return np.column_stack([numbers, np.abs(padded), nodes])


def _merge_groups(kind: str, rows: Ints) -> _Elements:
    """One block of ``rows`` in which an element of several physical groups stands once.

    MSH 2.2 repeats such an element, with a new number, for each of its groups. The same element
    twice in the same group is no such repetition and stays, to be refused later.
    """
    physical = rows[:, 1]
    first, leads = first_of_equal(row_keys(rows[:, 2:]))
    _, new = first_of_equal(row_keys(rows[:, 1:]))
    keep = leads | ~new
    place = np.cumsum(keep) - 1
    target = np.where(keep, place, place[first])
    groups = {tag: np.unique(target[where]) for tag, where in split_by(physical) if tag}
    return _Elements(kind, rows[keep, 0], rows[keep, 3:], groups)


def _check_count(name: str, count: int, announced: int) -> None:
    """Refuse a section that holds another number of things than it announces."""
    if count != announced:
        message = f"the section ${name} holds {count} entries and announces {announced}"
        raise Refused("mesh-malformed", message, "the file is damaged: write it again with gmsh")


def _assemble(parts: _Parts) -> RawMesh:
    """The mesh of the sections."""
    if parts.nodes is None or parts.blocks is None:
        missing = "$Nodes" if parts.nodes is None else "$Elements"
        hint = "mesh the geometry before saving: gmsh -2 or gmsh -3"
        raise Refused("mesh-empty", f"the file has no section {missing}", hint)
    numbers, points = parts.nodes
    check_unique(numbers)
    cells = tuple(_cells(block, numbers) for block in parts.blocks)
    return RawMesh(points, cells, groups=_groups(parts.blocks, parts.names))


def _cells(block: _Elements, numbers: Ints) -> RawCells:
    """A block with node indices in VTK's order."""
    nodes = resolve_nodes(numbers, block.nodes, cells=block.numbers)
    order = CELLS[block.kind].gmsh_order
    nodes = nodes[:, order] if order else nodes
    return RawCells(block.kind, block.dim, nodes, block.numbers)


def _groups(blocks: list[_Elements], names: Names) -> dict[str, Ints]:
    """Name of each physical group to its cells, counted over all blocks."""
    parts: dict[str, list[Ints]] = defaultdict(list)
    for block, span in spans(blocks):
        for tag, rows in block.physical.items():
            parts[names.get((block.dim, tag), str(tag))].append(span.start + np.asarray(rows))
    return join(parts)

"""The sections of MSH 2.2 and 4.1 that hold nodes, elements and the tags of physical groups."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from geoident.io.mesh.gmsh_stream import BinaryStream, Stream
from geoident.io.mesh.raw import DIMENSIONS, Refused, first_of_equal, row_keys, split_by
from geoident.model.arrays import Floats, Ints

ELEMENT_TYPES: Mapping[int, tuple[str, int]] = {
    1: ("line2", 2),
    2: ("tri3", 3),
    3: ("quad4", 4),
    4: ("tet4", 4),
    5: ("hex8", 8),
    6: ("wedge6", 6),
    7: ("pyramid5", 5),
    8: ("line3", 3),
    9: ("tri6", 6),
    10: ("quad9", 9),
    11: ("tet10", 10),
    12: ("hex27", 27),
    13: ("wedge18", 18),
    14: ("pyramid14", 14),
    15: ("point", 1),
    16: ("quad8", 8),
    17: ("hex20", 20),
    18: ("wedge15", 15),
    19: ("pyramid13", 13),
}
"""gmsh's number of a type of elements: kind and number of nodes."""

Entities = Mapping[tuple[int, int], tuple[int, ...]]
"""Dimension and tag of an entity of the geometry: tags of its physical groups."""


@dataclass(frozen=True)
class Block:
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

    @property
    def dim(self) -> int:
        """Dimension of the elements."""
        return DIMENSIONS[self.kind]


def element_type(number: int) -> tuple[str, int]:
    """Kind and number of nodes of gmsh's element type.

    Raises:
        Refused: the type is not of order 1 or 2.
    """
    if number not in ELEMENT_TYPES:
        raise Refused(
            "mesh-kind",
            f"the mesh has elements of gmsh's type {number}, which is not of order 1 or 2",
            "mesh with gmsh's option Mesh.ElementOrder=1 or 2",
        )
    return ELEMENT_TYPES[number]


def read_entities(stream: Stream) -> Entities:
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


def read_nodes_v4(stream: Stream) -> tuple[Ints, Floats]:
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


def read_elements_v4(stream: Stream, entities: Entities) -> list[Block]:
    """The elements, a block for each entity and type (section $Elements of MSH 4.1)."""
    n_blocks, total = (int(k) for k in stream.sizes(4)[:2])
    blocks = []
    for _ in range(n_blocks):
        dim, tag, number = (int(k) for k in stream.ints(3))
        kind, width = element_type(number)
        n = int(stream.sizes(1)[0])
        rows = stream.sizes(n * (1 + width)).reshape(n, 1 + width)
        physical = {group: np.arange(n) for group in entities.get((dim, tag), ()) if group}
        blocks.append(Block(kind, rows[:, 0], rows[:, 1:], physical))
    _check_count("Elements", sum(len(block.numbers) for block in blocks), total)
    return blocks


def read_nodes_v2(stream: Stream) -> tuple[Ints, Floats]:
    """Node numbers and (n, 3) coordinates, m (section $Nodes of MSH 2.2)."""
    n = stream.count()
    if isinstance(stream, BinaryStream):
        records = stream.records(n, stream.record(3))
        return records["number"].astype(np.int64), records["values"].astype(np.float64)
    rows = stream.floats(4 * n).reshape(n, 4)
    with np.errstate(invalid="ignore"):
        return rows[:, 0].astype(np.int64), np.ascontiguousarray(rows[:, 1:])


def read_elements_v2(stream: Stream) -> list[Block]:
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
        kind, width = element_type(number)
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
        kind, width = element_type(int(values[start + 1]))
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


def _merge_groups(kind: str, rows: Ints) -> Block:
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
    return Block(kind, rows[keep, 0], rows[keep, 3:], groups)


def _check_count(name: str, found: int, announced: int) -> None:
    """Refuse a section that holds another number of things than it announces."""
    if found != announced:
        message = f"the section ${name} holds {found} entries and announces {announced}"
        raise Refused("mesh-malformed", message, "the file is damaged: write it again with gmsh")

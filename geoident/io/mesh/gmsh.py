"""Meshes of gmsh: MSH 2.2 and 4.1, as text and binary.

Read here and not through meshio, which loses the numbers of the elements, all but the first of
several physical groups of an element and groups of equal name in different dimensions, and which
refuses a file in which only some of the elements belong to a group.

Format: gmsh reference manual, "MSH file format" and "Legacy formats".
"""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from geoident.io.mesh.gmsh_sections import (
    Block,
    Entities,
    read_elements_v2,
    read_elements_v4,
    read_entities,
    read_nodes_v2,
    read_nodes_v4,
)
from geoident.io.mesh.gmsh_stream import Layout, Stream
from geoident.io.mesh.order import GMSH_HEX20, GMSH_TET10
from geoident.io.mesh.raw import RawCells, RawMesh, Refused, check_unique_nodes, join, resolve_nodes
from geoident.model.arrays import Floats, Ints

_AGAIN = "write it again: gmsh FILE -save -format msh41 -o NEW.msh"
_INCOMPLETE = "it was not written or copied completely: make or copy it again"
_ORDERS = {"tet10": GMSH_TET10, "hex20": GMSH_HEX20}

Names = dict[tuple[int, int], str]
"""Dimension and tag of a physical group: its name."""


@dataclass
class _Parts:
    """The sections of a file that matter, as far as they are read."""

    version: str
    names: Names = field(default_factory=dict)
    entities: Entities = field(default_factory=dict)
    nodes: tuple[Ints, Floats] | None = None
    blocks: list[Block] | None = None


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
    version, layout = _read_header(data)
    parts = _Parts(version)
    position = 0
    while (start := re.compile(rb"\s*\$(\w+)[^\n]*\n?").match(data, position)) is not None:
        name = start[1].decode("ascii", "replace")
        end = data.find(b"$End" + start[1], start.end())
        if end < 0:
            raise Refused(
                "mesh-truncated", f"the file ends within the section ${name}", _INCOMPLETE
            )
        _read_section(name, data[start.end() : end], layout, parts)
        position = end + len(b"$End" + start[1])
    if data[position:].strip(b"\0 \t\r\n"):
        raise Refused("mesh-malformed", "something stands between the sections", _AGAIN)
    return _assemble(parts)


def _read_header(data: bytes) -> tuple[str, Layout]:
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
        return version, Layout()
    one = data[match.end() : match.end() + 4]
    return version, Layout(True, "<" if one == b"\1\0\0\0" else ">", int(match[3]))


def _read_section(name: str, section: bytes, layout: Layout, parts: _Parts) -> None:
    """Read one section, if it is one that matters."""
    if name == "PhysicalNames":
        parts.names.update(_read_names(section))
    elif name == "PartitionedEntities":
        message = "the mesh is partitioned"
        raise Refused("mesh-partitioned", message, "save it with gmsh's option Mesh.NbPartitions=0")
    elif name == "Entities" and parts.version.startswith("4"):
        stream = layout.open(section, name=name)
        parts.entities = read_entities(stream)
        _check_end(stream, name)
    elif name in ("Nodes", "Elements"):
        _read_mesh_section(name, layout.open(section, name=name), parts)


def _read_mesh_section(name: str, stream: Stream, parts: _Parts) -> None:
    """Read the nodes or the elements."""
    if (parts.nodes if name == "Nodes" else parts.blocks) is not None:
        raise Refused("mesh-malformed", f"the section ${name} is there more than once", _AGAIN)
    new = parts.version.startswith("4")
    if name == "Nodes":
        parts.nodes = read_nodes_v4(stream) if new else read_nodes_v2(stream)
    else:
        parts.blocks = read_elements_v4(stream, parts.entities) if new else read_elements_v2(stream)
    _check_end(stream, name)


def _check_end(stream: Stream, name: str) -> None:
    """Refuse a section that holds more than it announces."""
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


def _assemble(parts: _Parts) -> RawMesh:
    """The mesh of the sections."""
    if parts.nodes is None or parts.blocks is None:
        missing = "$Nodes" if parts.nodes is None else "$Elements"
        hint = "mesh the geometry before saving: gmsh -2 or gmsh -3"
        raise Refused("mesh-empty", f"the file has no section {missing}", hint)
    numbers, points = parts.nodes
    check_unique_nodes(numbers)
    cells = tuple(_cells(block, numbers) for block in parts.blocks)
    return RawMesh(points, cells, groups=_groups(parts.blocks, parts.names))


def _cells(block: Block, numbers: Ints) -> RawCells:
    """A block with node indices in VTK's order."""
    nodes = resolve_nodes(numbers, block.nodes, cells=block.numbers)
    order = _ORDERS.get(block.kind)
    nodes = nodes if order is None else nodes[:, list(order)]
    return RawCells(block.kind, block.dim, nodes, block.numbers)


def _groups(blocks: list[Block], names: Names) -> dict[str, Ints]:
    """Name of each physical group to its cells, counted over all blocks."""
    parts: dict[str, list[Ints]] = defaultdict(list)
    start = 0
    for block in blocks:
        for tag, rows in block.physical.items():
            parts[names.get((block.dim, tag), str(tag))].append(start + np.asarray(rows))
        start += len(block.numbers)
    return join(parts)

"""A finite element mesh as geoident sees it: nodes, elements, faces and their named groups."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from geoident.model.arrays import Floats, Ints

ELEMENT_KINDS_2D = ("tri3", "tri6", "quad4", "quad8")
ELEMENT_KINDS_3D = ("tet4", "tet10", "hex8", "hex20")
FACET_KINDS_2D = ("line2", "line3")
FACET_KINDS_3D = ("tri3", "tri6", "quad4", "quad8")


@dataclass(frozen=True)
class ElementBlock:
    """Elements of one kind.

    Args:
        kind: such as ``tri3`` or ``hex20``.
        nodes: (n_elements, nodes per element) node indices from 0, in VTK's order.
        numbers: (n_elements,) the numbers under which the user knows these elements
            (from the file, else counted from 1), for messages.
    """

    kind: str
    nodes: Ints
    numbers: Ints

    def __len__(self) -> int:
        return int(self.nodes.shape[0])


@dataclass(frozen=True)
class Mesh:
    """Nodes, elements and named groups.

    Elements (and likewise facets) are numbered through all blocks in their order: an
    *element index* counts from 0 over ``blocks``, a *facet index* over ``facets``.

    Args:
        points: (n_nodes, dim) coordinates in m, dim 2 or 3.
        blocks: the elements of dimension dim, by kind.
        facets: the lines (dim 2) or surfaces (dim 3) that the file holds, by kind.
        groups: name to element indices, sorted.
        facet_groups: name to facet indices, sorted.
        node_groups: name to node indices, sorted (physical points, node sets).
        file: where it came from, for messages.
    """

    points: Floats
    blocks: tuple[ElementBlock, ...]
    facets: tuple[ElementBlock, ...] = ()
    groups: Mapping[str, Ints] = field(default_factory=dict)
    facet_groups: Mapping[str, Ints] = field(default_factory=dict)
    node_groups: Mapping[str, Ints] = field(default_factory=dict)
    file: str = ""

    @property
    def dim(self) -> int:
        """Number of space dimensions."""
        return int(self.points.shape[1])

    @property
    def n_nodes(self) -> int:
        """Number of nodes, used or not."""
        return int(self.points.shape[0])

    @property
    def n_elements(self) -> int:
        """Number of elements of all blocks."""
        return sum(len(block) for block in self.blocks)

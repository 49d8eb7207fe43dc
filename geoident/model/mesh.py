"""A finite element mesh as geoident sees it: nodes, elements, faces and their named groups."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sized
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.cells import CELLS

_Row = TypeVar("_Row", bound=Sized)


@dataclass(frozen=True)
class ElementBlock:
    """Elements of one kind.

    Args:
        kind: a key of `geoident.model.cells.CELLS` that is usable, such as ``hex20``.
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
        rotations_of: (k,) nodes, ascending, at which shells turn. Nodes of ``points`` behind the
            places stand for their rotations there: their three unknowns.
        inner: (k, 2) a node of the ground, and that which a beam between interfaces has there.
        stations_by: (m,) for each station of grouted bars a node near it. The last m nodes of
            ``points`` are these stations: their first unknown is the motion of the bar along
            itself, the others are its motions across, or none.
        stations_bend: (m,) which of them move across their bars.
    """

    points: Floats
    blocks: tuple[ElementBlock, ...]
    facets: tuple[ElementBlock, ...] = ()
    groups: Mapping[str, Ints] = field(default_factory=dict)
    facet_groups: Mapping[str, Ints] = field(default_factory=dict)
    node_groups: Mapping[str, Ints] = field(default_factory=dict)
    file: str = ""
    rotations_of: Ints = field(default_factory=lambda: np.empty(0, np.int64))
    inner: Ints = field(default_factory=lambda: np.empty((0, 2), np.int64))
    stations_by: Ints = field(default_factory=lambda: np.empty(0, np.int64))
    stations_bend: Bools = field(default_factory=lambda: np.empty(0, np.bool_))

    @property
    def n_places(self) -> int:
        """Number of nodes that are places of the ground; those behind them are not."""
        return self.n_nodes - len(self.beside)

    @property
    def beside(self) -> Ints:
        """For each node behind the places a place near it."""
        return np.concatenate([self.rotations_of, self.stations_by])

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


def spans(blocks: Iterable[_Row]) -> Iterator[tuple[_Row, slice]]:
    """Every block with the slice of its elements among those of all blocks.

    >>> [span for _, span in spans(["abc", "de"])]
    [slice(0, 3, None), slice(3, 5, None)]
    """
    first = 0
    for block in blocks:
        yield block, slice(first, first + len(block))
        first += len(block)


def rows_in(
    blocks: Iterable[ElementBlock], members: Ints | Bools
) -> Iterator[tuple[ElementBlock, Ints]]:
    """Every block with the rows in it of some elements, in the order in which these are given.

    Args:
        blocks: the elements or the facets of a mesh.
        members: (n,) element (facet) indices, or (n_elements,) which elements.
    """
    chosen = np.flatnonzero(members) if members.dtype == bool else members
    for block, span in spans(blocks):
        yield block, chosen[(chosen >= span.start) & (chosen < span.stop)] - span.start


def nodes_in(blocks: Iterable[ElementBlock], members: Ints | Bools) -> Ints:
    """Nodes (n,) of some elements, each once, ascending; arguments as for `rows_in`."""
    node_lists = [block.nodes[rows] for block, rows in rows_in(blocks, members)]
    used = np.zeros(
        max((int(nodes.max(initial=-1)) for nodes in node_lists), default=-1) + 1, np.bool_
    )
    for nodes in node_lists:
        used[nodes] = True
    return np.flatnonzero(used)


def with_rotations(mesh: Mesh, nodes: Ints) -> Mesh:
    """The same mesh with unknowns for the rotations at some nodes (k,), ascending."""
    points = np.concatenate([mesh.points, mesh.points[nodes]])
    return replace(mesh, points=points, rotations_of=nodes)


def and_inner(mesh: Mesh, nodes: Ints) -> Ints:
    """Some nodes (k,) with those that beams between interfaces have there, ascending."""
    outer, inner = mesh.inner.T
    return np.union1d(nodes, inner[np.isin(outer, nodes)])


def with_stations(mesh: Mesh, stations: Floats, bend: Bools) -> Mesh:
    """The same mesh with unknowns for the motion of bars at some stations (m, dim), m.

    Args:
        mesh: the mesh.
        stations: of all bars.
        bend: (m,) which move across their bars too.
    """
    from scipy.spatial import cKDTree  # noqa: PLC0415 - 0.3 s, for cases with such bars alone

    by = cKDTree(mesh.points[: mesh.n_places]).query(stations)[1]
    points = np.concatenate([mesh.points, stations])
    by_nodes = np.asarray(by, dtype=np.int64)
    return replace(mesh, points=points, stations_by=by_nodes, stations_bend=bend)


def motions_of_nodes(mesh: Mesh, u: Floats) -> Floats:
    """Displacements (n_nodes, dim) in u (n_dofs,); of nodes that are no places zero."""
    motions = u.reshape(mesh.points.shape).copy()
    motions[mesh.n_places :] = 0.0
    return motions


def element_centres(mesh: Mesh) -> Floats:
    """(n_elements, dim) means of the corners, m."""
    corners = [block.nodes[:, : CELLS[block.kind].n_corners] for block in mesh.blocks]
    return np.concatenate([mesh.points[nodes].mean(axis=1) for nodes in corners])

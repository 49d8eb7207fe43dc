"""The stiffness matrix K(p) = sum over groups of C^T V E(p) C on patterns that are built once.

The elastic moduli are constant over a material, so the integrals over elements need to be made only
once per mesh. For every *group* (the smallest set of elements that a stage can move) and every
pair of neighbouring nodes a, b of it, this module stores

    G_ab[j, l] = sum over the elements of the group of  integral g_a[j] g_b[l]

with g_a the gradient vector of node a (dN_a/dx_j, and N_a/r about an axis: see `kinematics`), and
the block of any material is a linear map of it (`Kinematics.stiffness_map`). So K for
new moduli costs one pass over node pairs, not over elements (for tet4 a fifth of the data), and a
general anisotropic material costs what an isotropic one costs.

Unknowns are numbered in the fill-reducing order of the mesh from the start, so the assembled
matrix goes to the solver as it is. Computed once: the order and G (per mesh), the pattern with its
maps (per set of active unknowns). Per stage and parameter vector: one product and one indexed sum
per group.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import scipy.sparse as sp

from geoident.fem.kinematics import BlockGeometry
from geoident.fem.solvers.direct import LowerPattern, UnknownPlaces
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.cells import CELLS
from geoident.model.mesh import Mesh, rows_in

_CHUNK = 2_000_000  # gradient products made at once, in numbers
_HELD = 12  # chunks of them that are summed at once
_BLOCKS = 50_000  # blocks of node pairs worked on at once
_KEPT = 20_000_000  # entries of blocks up to which their places are kept


@dataclass(frozen=True)
class GroupBlocks:
    """Gradient products of one group.

    Args:
        row: (n_b,) rank of node a in the elimination order, the larger of the two.
        column: (n_b,) rank of node b.
        make_products: makes the products, which only what is solved needs.
    """

    row: Ints
    column: Ints
    make_products: Callable[[], Floats]

    @cached_property
    def products(self) -> Floats:
        """(n_b, n_entries^2) G_ab, m (or 1 in plane strain)."""
        return self.make_products()


@dataclass(frozen=True)
class CompressedColumns:
    """How the unknowns of nodes stand in compressed columns.

    The entries of a column are the unknowns of the node itself from its own on, then those of the
    nodes below, in their order. So the place of an entry (i of node a, k of node b) is the sum of
    three numbers: where column k of b starts, how many unknowns of other nodes stand above a in
    it, and the number of i among those of a.

    Args:
        unknown: (n_nodes, dim) number of each unknown by rank and component, -1 if there is none.
        number: (n_nodes, dim) its number among those of its node.
        start: (n_nodes, dim) where its column starts, less its number among those of its node.
        nnz: entries of all columns; stands for nowhere.
    """

    unknown: Ints
    number: Ints
    start: Ints
    nnz: int

    def places(self, row: Ints, column: Ints, above: Ints) -> Ints:
        """Places (n, dim, dim) of blocks (i of a, k of b), nnz for fixed ones and upper ones.

        Args:
            row: (n,) rank of node a, not below that of b.
            column: (n,) rank of node b.
            above: (n,) unknowns of other nodes above those of a in the columns of b, its own too.
        """
        place = self.start[column][:, None, :] + (self.number[row] + above[:, None])[:, :, None]
        fixed = (self.unknown[row] < 0)[:, :, None] | (self.unknown[column] < 0)[:, None, :]
        place[fixed] = self.nnz
        own = np.flatnonzero(row == column)
        i, k = np.triu_indices(place.shape[1], 1)
        place[own[:, None], i, k] = self.nnz
        return np.asarray(place)


@dataclass(frozen=True)
class StiffnessPattern:
    """The lower triangle of K for one set of active unknowns.

    Args:
        lower: the pattern.
        dofs: (n,) degree of freedom of each unknown, in elimination order.
        columns: how they stand in it.
        above: per group, (n_b,) unknowns that stand above those of node a of a block.
    """

    lower: LowerPattern
    dofs: Ints
    columns: CompressedColumns
    above: dict[int, Ints]

    def values(self, blocks: dict[int, GroupBlocks], maps: dict[int, Floats]) -> Floats:
        """Values (nnz,) of K for the stiffness map of every present group."""
        total = np.zeros(len(self.lower.indices) + 1)
        for group, transform in maps.items():
            for some, place in self._places(group, blocks[group]):
                # Within a group every place but the last occurs once: an indexed sum is exact.
                total[place] += (blocks[group].products[some] @ transform).ravel()
        return total[:-1]

    def _places(self, group: int, blocks: GroupBlocks) -> Iterator[tuple[slice, Ints]]:
        """Runs of the blocks of a group, and the places of their entries (n,)."""
        above = self.above[group]
        if len(above) * self.columns.unknown.shape[1] ** 2 > _KEPT:
            for some in _runs(len(above)):
                row, column = blocks.row[some], blocks.column[some]
                yield some, self.columns.places(row, column, above[some]).ravel()
            return
        if group not in self._kept:
            places = self.columns.places(blocks.row, blocks.column, above)
            self._kept[group] = places.ravel()
        yield slice(None), self._kept[group]

    @cached_property
    def _kept(self) -> dict[int, Ints]:
        return {}


def group_blocks(
    mesh: Mesh, geometries: tuple[BlockGeometry, ...], elements: Ints, rank: Ints
) -> GroupBlocks:
    """Gradient products of a group.

    Args:
        mesh: the mesh.
        geometries: geometry of its blocks.
        elements: (k,) element indices of the group.
        rank: (n_nodes,) place of each node in the elimination order.
    """
    parts = [
        (rank[block.nodes[e]], geometry, e)
        for (block, rows), geometry in zip(rows_in(mesh.blocks, elements), geometries, strict=True)
        for e in _chunks(rows, geometry)
    ]
    keys = [np.empty(0, np.int64), *(_keys(ranks) for ranks, _, _ in parts)]
    unique, place = np.unique(np.concatenate(keys), return_inverse=True)
    make = partial(_summed, parts, place.astype(np.int32), geometries[0].gradients.shape[3] ** 2)
    return GroupBlocks(unique & 0xFFFFFFFF, unique >> 32, make)


def _summed(parts: Sequence[tuple[Ints, BlockGeometry, Ints]], place: Ints, width: int) -> Floats:
    """(n_b, width) gradient products of the elements in some parts, each pair at its place."""
    total, at = np.zeros((int(place.max(initial=-1)) + 1, width)), 0
    for first in range(0, len(parts), _HELD):
        products = np.concatenate([_products(*part) for part in parts[first : first + _HELD]])
        total += _sums(place[at : at + len(products)], products, len(total))
        at += len(products)
    return total


def free_dofs(
    groups: Iterable[GroupBlocks], *, node_of_rank: Ints, fixed: Bools, dim: int
) -> tuple[Ints, Ints]:
    """Unknowns (n_nodes, dim) of ranks and components, -1 for none, and their dofs (n,).

    Args:
        groups: the present groups.
        node_of_rank: (n_nodes,) the elimination order.
        fixed: (n_dofs,) degrees of freedom held by supports.
        dim: space dimensions.
    """
    active = np.zeros((len(node_of_rank), dim), dtype=bool)
    for group in groups:
        active[group.row] = True
    active &= ~fixed.reshape(-1, dim)[node_of_rank]
    unknown = np.full(active.shape, -1, dtype=np.int64)
    unknown[active] = np.arange(np.count_nonzero(active))
    rank, component = np.nonzero(active)
    return unknown, node_of_rank[rank] * dim + component


def stiffness_pattern(
    groups: dict[int, GroupBlocks],
    *,
    node_of_rank: Ints,
    fixed: Bools,
    dim: int,
    places: Callable[[Ints], UnknownPlaces] | None = None,
) -> StiffnessPattern:
    """The pattern of the present groups.

    Args:
        groups: the present groups.
        node_of_rank: (n_nodes,) the elimination order.
        fixed: (n_dofs,) degrees of freedom held by supports.
        dim: space dimensions.
        places: where unknowns stand in the mesh, by their degrees of freedom.
    """
    unknown, dofs = free_dofs(groups.values(), node_of_rank=node_of_rank, fixed=fixed, dim=dim)
    keys = _union([(g.column << 32) | g.row for g in groups.values()])
    row, column = keys & 0xFFFFFFFF, keys >> 32
    free = unknown >= 0
    n_free = free.sum(axis=1)
    first = np.concatenate([[True], column[1:] != column[:-1]])[: len(column)]
    height = np.cumsum(n_free[row]) - n_free[row]
    above = height - height[first][np.cumsum(first) - 1]
    number = np.where(free, np.cumsum(free, axis=1) - 1, 0)
    of_column = np.bincount(column, n_free[row], minlength=len(free)).astype(np.int64)
    lengths = (of_column[:, None] - number)[free]
    indptr = np.concatenate([[0], np.cumsum(lengths)])
    start = np.zeros_like(unknown)
    start[free] = indptr[:-1] - number[free]
    columns = CompressedColumns(unknown, number, start, int(indptr[-1]))
    indices = np.empty(columns.nnz + 1, dtype=np.int64)
    for some in _runs(len(keys)):
        place = columns.places(row[some], column[some], above[some])
        indices[place] = unknown[row[some]][:, :, None]
    heights = {
        name: above[np.searchsorted(keys, (group.column << 32) | group.row)]
        for name, group in groups.items()
    }
    where = None if places is None else places(dofs)
    lower = LowerPattern(indptr, indices[:-1], places=where)
    return StiffnessPattern(lower, dofs, columns, heights)


def _union(runs: list[Ints]) -> Ints:
    """Numbers that stand in any of some ascending runs, each once, ascending."""
    keys = np.concatenate([np.empty(0, np.int64), *runs])
    if len(runs) > 1:
        keys.sort(kind="stable")  # merges the runs
        keys = keys[np.concatenate([[True], keys[1:] != keys[:-1]])[: len(keys)]]
    return keys


def _runs(n: int) -> Iterable[slice]:
    """Runs of blocks that are worked on at once."""
    return (slice(at, min(at + _BLOCKS, n)) for at in range(0, n, _BLOCKS))


def _chunks(elements: Ints, geometry: BlockGeometry) -> Iterable[Ints]:
    if len(elements) == 0:
        return []
    _, _, n_a, n_entries = geometry.gradients.shape
    pairs = n_a * (n_a + 1) // 2 * n_entries**2
    return np.array_split(elements, min(-(-len(elements) * pairs // _CHUNK), len(elements)))


def _keys(ranks: Ints) -> Ints:
    """Keys of all node pairs of elements with ranks (n_el, n_a), by which they are sorted."""
    ranks = np.sort(ranks, axis=1)
    a, b = np.tril_indices(ranks.shape[1])
    return np.asarray((ranks[:, b] << 32) | ranks[:, a]).ravel()


def _products(ranks: Ints, geometry: BlockGeometry, elements: Ints) -> Floats:
    """Gradient products of all node pairs of some elements, larger rank first, as `_keys`."""
    n_el, n_a = ranks.shape
    order = np.argsort(ranks, axis=1)[:, None, :, None]
    gradients = np.take_along_axis(geometry.gradients[elements], order, axis=2)
    n = gradients.shape[3]
    weighted = gradients * geometry.volumes[elements][:, :, None, None]
    flat = weighted.reshape(n_el, -1, n_a * n)
    full = np.matmul(flat.transpose(0, 2, 1), gradients.reshape(n_el, -1, n_a * n))
    a, b, j, k = (part.ravel() for part in np.broadcast_arrays(
        *(part[:, None, None] for part in np.tril_indices(n_a)),
        np.arange(n)[:, None], np.arange(n),
    ))  # fmt: skip
    wanted = (a * n + j) * (n_a * n) + b * n + k
    return np.asarray(np.take(full.reshape(n_el, -1), wanted, axis=1).reshape(-1, n * n))


def _sums(place: Ints, values: Floats, n: int) -> Floats:
    """(n, k) sums of the values (m, k) that have the same place."""
    shape = (len(place), n)
    scatter = sp.csr_array((np.ones(len(place)), place, np.arange(len(place) + 1)), shape=shape)
    return np.asarray(scatter.T @ values)


def node_graph(mesh: Mesh) -> tuple[Ints, Ints]:
    """Nodes that share an element: (indptr (n_nodes + 1,), indices), each its own neighbour."""
    sizes = np.concatenate([np.full(len(block), block.nodes.shape[1]) for block in mesh.blocks])
    nodes = np.concatenate([block.nodes.ravel() for block in mesh.blocks])
    starts = np.concatenate([[0], np.cumsum(sizes)])
    incidence = sp.csr_array(
        (np.ones(len(nodes)), nodes, starts), shape=(mesh.n_elements, mesh.n_nodes)
    )
    incidence.sort_indices()
    graph = (incidence.T @ incidence).tocsr()
    return graph.indptr.astype(np.int64), graph.indices.astype(np.int64)


def nodes_on_edges(mesh: Mesh) -> Ints:
    """(k, 3) nodes on edges of elements of second order, each with the two ends of its edge."""
    rows = [np.empty((0, 3), dtype=np.int64)]
    for block in mesh.blocks:
        cell = CELLS[block.kind]
        for n, (a, b) in enumerate(cell.edges):
            rows.append(block.nodes[:, [cell.n_corners + n, a, b]])
    edges = np.concatenate(rows)
    _, first = np.unique(edges[:, 0], return_index=True)
    return edges[first]

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

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from geoident.fem.kinematics import BlockGeometry
from geoident.fem.solvers.direct import LowerPattern
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.mesh import Mesh, rows_in

_CHUNK = 4_000_000  # gradient products held at once, in numbers


@dataclass(frozen=True)
class GroupBlocks:
    """Gradient products of one group.

    Args:
        row: (n_b,) rank of node a in the elimination order, the larger of the two.
        column: (n_b,) rank of node b.
        products: (n_b, n_entries^2) G_ab, m (or 1 in plane strain).
    """

    row: Ints
    column: Ints
    products: Floats


@dataclass(frozen=True)
class StiffnessPattern:
    """The lower triangle of K for one set of active unknowns.

    Args:
        lower: the pattern.
        dofs: (n,) degree of freedom of each unknown, in elimination order.
        slots: per group, (n_b dim^2,) place of each entry of its blocks in the values; the last
            place, one past the pattern, collects entries of fixed unknowns and is thrown away.
    """

    lower: LowerPattern
    dofs: Ints
    slots: dict[int, Ints]

    def values(self, blocks: dict[int, GroupBlocks], maps: dict[int, Floats]) -> Floats:
        """Values (nnz,) of K for the stiffness map of every present group."""
        total = np.zeros(len(self.lower.indices) + 1)
        for group, transform in maps.items():
            # Within a group every place but the last occurs once, so an indexed sum is exact.
            total[self.slots[group]] += (blocks[group].products @ transform).ravel()
        return total[:-1]


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
    parts = []
    for (block, rows), geometry in zip(rows_in(mesh.blocks, elements), geometries, strict=True):
        parts += [_products(rank[block.nodes[e]], geometry, e) for e in _chunks(rows, geometry)]
    keys = np.concatenate([k for k, _ in parts]) if parts else np.empty(0, np.int64)
    unique, place = np.unique(keys, return_inverse=True)
    total = np.zeros((len(unique), geometries[0].gradients.shape[3] ** 2))
    at = 0
    for key, products in parts:
        _add_at(total, place[at : at + len(key)], products)
        at += len(key)
    return GroupBlocks(unique & 0xFFFFFFFF, unique >> 32, total)


def stiffness_pattern(
    groups: dict[int, GroupBlocks],
    *,
    node_of_rank: Ints,
    fixed: Bools,
    dim: int,
    lasting: int = 0,
) -> StiffnessPattern:
    """The pattern of the present groups.

    Args:
        groups: the present groups.
        node_of_rank: (n_nodes,) the elimination order.
        fixed: (n_dofs,) degrees of freedom held by supports.
        dim: space dimensions.
        lasting: number of nodes, the first in the order, whose equations are those of all stages.
    """
    keys = np.unique(np.concatenate([(g.column << 32) | g.row for g in groups.values()]))
    row, column = keys & 0xFFFFFFFF, keys >> 32
    unknown, dofs = _number_unknowns(row, node_of_rank, fixed, dim)
    lower, slot = _scalar_pattern(row, column, unknown, dim)
    if lasting:
        first = int(np.count_nonzero(unknown[:lasting] >= 0))
        lower = replace(lower, lasting=first, names=dofs)
    slots = {}
    for name, group in groups.items():
        at = np.searchsorted(keys, (group.column << 32) | group.row)
        slots[name] = slot[at].ravel()
    return StiffnessPattern(lower, dofs, slots)


def _chunks(elements: Ints, geometry: BlockGeometry) -> Iterable[Ints]:
    if len(elements) == 0:
        return []
    _, _, n_a, n_entries = geometry.gradients.shape
    pairs = n_a * (n_a + 1) // 2 * n_entries**2
    return np.array_split(elements, -(-len(elements) * pairs // _CHUNK))


def _products(ranks: Ints, geometry: BlockGeometry, elements: Ints) -> tuple[Ints, Floats]:
    """Keys and gradient products of all node pairs of some elements, larger rank first."""
    n_el, n_a = ranks.shape
    gradients = geometry.gradients[elements]
    n = gradients.shape[3]
    a, b = np.tril_indices(n_a)
    weighted = gradients * geometry.volumes[elements][:, :, None, None]
    flat = weighted.reshape(n_el, -1, n_a * n)
    full = np.matmul(flat.transpose(0, 2, 1), gradients.reshape(n_el, -1, n_a * n))
    pairs = full.reshape(n_el, n_a, n, n_a, n).transpose(0, 1, 3, 2, 4)[:, a, b]
    row, column = ranks[:, a], ranks[:, b]
    swapped = row < column
    pairs[swapped] = pairs[swapped].swapaxes(1, 2)
    keys = (np.minimum(row, column) << 32) | np.maximum(row, column)
    return keys.ravel(), pairs.reshape(-1, n * n)


def _add_at(total: Floats, place: Ints, values: Floats) -> None:
    """total[place] += values, with repeated places summed."""
    n = len(place)
    gather = sp.csr_array((np.ones(n), (place, np.arange(n))), shape=(len(total), n))
    total += np.asarray(gather @ values)


def _number_unknowns(row: Ints, node_of_rank: Ints, fixed: Bools, dim: int) -> tuple[Ints, Ints]:
    """Unknown of every (rank, component), -1 if fixed or absent; and the unknowns' dofs."""
    active = np.zeros((len(node_of_rank), dim), dtype=bool)
    active[row] = True
    active &= ~fixed.reshape(-1, dim)[node_of_rank]
    unknown = np.full(active.shape, -1, dtype=np.int64)
    unknown[active] = np.arange(np.count_nonzero(active))
    rank, component = np.nonzero(active)
    return unknown, node_of_rank[rank] * dim + component


def _scalar_pattern(row: Ints, column: Ints, unknown: Ints, dim: int) -> tuple[LowerPattern, Ints]:
    """Expand node blocks to single entries; also where each entry of each block goes."""
    i = np.repeat(unknown[row], dim, axis=1).reshape(-1, dim, dim)
    k = np.repeat(unknown[column][:, None, :], dim, axis=1).reshape(-1, dim, dim)
    kept = (i >= 0) & (k >= 0) & (i >= k)
    n = int(unknown.max(initial=-1)) + 1
    nnz = int(np.count_nonzero(kept))
    # Blocks come sorted by column, then row, so the compressed columns come out sorted too.
    matrix = sp.csc_array((np.arange(nnz), (i[kept], k[kept])), shape=(n, n))
    matrix.sort_indices()
    place = np.empty(nnz, dtype=np.int64)
    place[matrix.data] = np.arange(nnz)
    slot = np.full(kept.shape, nnz, dtype=np.int64)
    slot[kept] = place
    pattern = LowerPattern(matrix.indptr.astype(np.int64), matrix.indices.astype(np.int64))
    return pattern, slot


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

"""Coarser spaces of displacements: what a level of a multilevel solver passes to the next.

*Corners of elements of second order.* Displacements that are linear between the corners are a
subspace of those of second order: a node on an edge has half the displacement of either end
(p-multigrid). In space they have an eighth of the unknowns.

*Aggregates.* Otherwise nodes are gathered around roots, no two of which have a neighbour in common
(a maximal independent set of distance two: Luby 1986; Bell, Dalton & Olson 2012, SIAM J. Sci.
Comput. 34, C123-C152), and what an aggregate can do is move as a rigid body: three translations
and three rotations, two and one in the plane. One step of damped Jacobi takes the jumps between
aggregates out of these motions (smoothed aggregation: Vanek, Mandel & Brezina 1996, Computing 56,
179-196).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.fem.solvers.direct import UnknownPlaces
from geoident.model.arrays import Bools, Floats, Ints

MOST_OF_CORNERS = 0.4
"""Share of the unknowns that may be those of corners, for a level of the corners alone."""


@dataclass(frozen=True)
class Coarser:
    """A coarser space.

    Args:
        interpolation: (n, n_coarse) displacements of it by its unknowns.
        point: (n_coarse, dim) about where each of its unknowns stands.
        places: of its unknowns in the mesh; None where they are no displacements of nodes.
    """

    interpolation: sp.csr_array
    point: Floats
    places: UnknownPlaces | None


def corners(places: UnknownPlaces) -> Coarser | None:
    """The space of the corners; None where elements of second order are few.

    Args:
        places: of the unknowns.
    """
    n, dim = len(places.dofs), places.dim
    on_edge = np.zeros(len(places.points), dtype=bool)
    on_edge[places.edges[:, 0]] = True
    stays = np.flatnonzero(~on_edge[places.node])
    if not 0 < len(stays) <= MOST_OF_CORNERS * n:
        return None
    unknown = np.full(places.points.size, -1, dtype=np.int64)
    unknown[places.dofs] = np.arange(n)
    column = np.empty(n, dtype=np.int64)
    column[stays] = np.arange(len(stays))
    rows, columns, shares = [stays], [column[stays]], [np.ones(len(stays))]
    middle, *ends = np.moveaxis(unknown[places.edges[:, :, None] * dim + np.arange(dim)], 1, 0)
    for end in ends:
        both = (middle >= 0) & (end >= 0)
        rows.append(middle[both])
        columns.append(column[end[both]])
        shares.append(np.full(np.count_nonzero(both), 0.5))
    places_of_entries = np.concatenate(rows), np.concatenate(columns)
    entries = sp.coo_array((np.concatenate(shares), places_of_entries), shape=(n, len(stays)))
    dofs, nothing = places.dofs[stays], np.empty((0, 3), dtype=np.int64)
    coarser_places = UnknownPlaces(dofs, places.points, nothing)
    return Coarser(sp.csr_array(entries), places.points[dofs // dim], coarser_places)


def aggregates(matrix: sp.csr_array, places: UnknownPlaces, step: sp.csr_array) -> Coarser:
    """The space of rigid motions of aggregates, smoothed.

    Args:
        matrix: (n, n) K.
        places: of its unknowns.
        step: (n, n) of the step of Jacobi: the smoothed motions are those less ``step @ K @`` them.
    """
    dim = places.dim
    node, at = np.unique(places.dofs // dim, return_inverse=True)
    graph = node_graph(matrix, at, len(node))
    aggregate = _aggregate_numbers(graph)
    motions = _rigid_motions(places, node, at, aggregate)
    count = int(aggregate.max()) + 1
    centres = _means(places.points[node], aggregate, count)
    tentative, of = _orthogonal(motions, aggregate[at], count)
    smooth = sp.csr_array(tentative - step @ (matrix @ tentative))
    smooth.sort_indices()
    return Coarser(smooth, centres[of], None)


def node_graph(matrix: sp.csr_array, at: Ints, n_nodes: int) -> sp.csr_array:
    """Pattern (n_nodes, n_nodes) of the nodes that are coupled, each with itself.

    Args:
        matrix: (n, n) K.
        at: (n,) node of each unknown.
        n_nodes: their number.
    """
    n = len(at)
    of = sp.csr_array((np.ones(n, dtype=np.int8), at, np.arange(n + 1)), shape=(n, n_nodes))
    pattern = sp.csr_array(
        (np.ones(matrix.nnz, dtype=np.int8), matrix.indices, matrix.indptr), shape=matrix.shape
    )
    graph = sp.csr_array(of.T.astype(np.int32) @ (pattern.astype(np.int32) @ of))
    graph.sort_indices()
    return graph


def _aggregate_numbers(graph: sp.csr_array) -> Ints:
    """(n_nodes,) number of the aggregate of each node."""
    n = graph.shape[0]
    indices, starts = graph.indices, graph.indptr[:-1]
    priority = np.random.default_rng(0).permutation(n) + 1
    state = priority.copy()  # priority while undecided, 0 for what is near a root
    root = np.zeros(n, dtype=bool)
    while (state > 0).any():
        near = np.maximum.reduceat(state[indices], starts)
        highest = np.maximum.reduceat(near[indices], starts)
        new_root = (state > 0) & (highest == state)
        root |= new_root
        taken = np.logical_or.reduceat(new_root[indices], starts)
        taken = np.logical_or.reduceat(taken[indices], starts)
        state[taken] = 0
    number = np.full(n, -1, dtype=np.int64)
    number[root] = np.arange(np.count_nonzero(root))
    while (number < 0).any():  # first the neighbours of roots, then theirs
        around = np.maximum.reduceat(number[indices], starts)
        number = np.where(number < 0, around, number)
    return number


def _means(points: Floats, group: Ints, count: int) -> Floats:
    sums = [np.bincount(group, points[:, k], minlength=count) for k in range(points.shape[1])]
    return np.asarray(np.stack(sums, axis=1) / np.bincount(group, minlength=count)[:, None])


def _rigid_motions(places: UnknownPlaces, node: Ints, at: Ints, aggregate: Ints) -> Floats:
    """(n, m) displacement of each unknown by the rigid motions of its aggregate."""
    dim = places.dim
    centre = _means(places.points[node], aggregate, int(aggregate.max()) + 1)
    x = places.points[node][at] - centre[aggregate[at]]
    component = places.dofs % dim
    pairs = [(0, 1)] if dim == 2 else [(0, 1), (1, 2), (2, 0)]
    motions = np.zeros((len(at), dim + len(pairs)))
    motions[np.arange(len(at)), component] = 1.0
    for k, (i, j) in enumerate(pairs):
        motions[:, dim + k] = np.where(component == j, x[:, i], 0.0)
        motions[:, dim + k] -= np.where(component == i, x[:, j], 0.0)
    return motions


def _orthogonal(motions: Floats, group: Ints, count: int) -> tuple[sp.csr_array, Ints]:
    """Orthonormal motions of each aggregate, those that are none left out; the aggregate of each.

    Args:
        motions: (n, m).
        group: (n,) aggregate of each unknown.
        count: of aggregates.
    """
    n, m = motions.shape
    products = np.zeros((count, m, m))
    np.add.at(products, group, motions[:, :, None] * motions[:, None, :])
    scale = np.sqrt(np.maximum(np.einsum("gii->gi", products), 1e-300))
    products /= scale[:, :, None] * scale[:, None, :]
    values, vectors = np.linalg.eigh(products)
    keep: Bools = values > 1e-6 * m
    vectors = vectors / np.where(keep, np.sqrt(np.maximum(values, 1e-300)), np.inf)[:, None, :]
    orthonormal = np.einsum("nm,nmk->nk", motions / scale[group], vectors[group])
    number = np.full(count * m, -1, dtype=np.int64)
    number[keep.ravel()] = np.arange(np.count_nonzero(keep))
    columns = number[group[:, None] * m + np.arange(m)]
    kept = columns >= 0
    rows = np.repeat(np.arange(n), kept.sum(axis=1))
    shape = (n, int(np.count_nonzero(keep)))
    matrix = sp.csr_array(sp.coo_array((orthonormal[kept], (rows, columns[kept])), shape=shape))
    return matrix, np.repeat(np.arange(count), m)[keep.ravel()]

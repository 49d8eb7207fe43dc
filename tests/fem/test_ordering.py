"""Geometric nested dissection: a permutation, whose fill is small, on any mesh."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from geoident.fem.solvers.ordering import nested_dissection


def grid(*counts):
    """Points and graph of a grid: neighbours differ by at most one along every axis."""
    points = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1)
    graph = sp.csr_array(np.ones((1, 1)))
    for count in counts:
        line = sp.diags_array([np.ones(count)] * 3, offsets=[-1, 0, 1], shape=(count, count))
        graph = sp.csr_array(sp.kron(graph, line))
    return points.reshape(-1, len(counts)).astype(float), graph


def order_of(points, graph):
    return nested_dissection(points, graph.indptr.astype(np.int64), graph.indices.astype(np.int64))


def fill(graph, order):
    """Entries of the Cholesky factor, by symbolic elimination."""
    rank = np.argsort(order)
    later = [set() for _ in order]
    coo = graph.tocoo()
    for i, j in zip(rank[coo.row], rank[coo.col], strict=True):
        if j > i:
            later[i].add(j)
    for k in range(len(order)):
        if later[k]:
            parent = min(later[k])
            later[parent] |= later[k] - {parent}
    return len(order) + sum(map(len, later))


MESHES = {
    "line": grid(100),
    "square": grid(20, 20),
    "slab": grid(20, 20, 3),
    "plane in space": (np.column_stack([grid(15, 15)[0], np.zeros(225)]), grid(15, 15)[1]),
    "coincident points": (np.zeros((225, 2)), grid(15, 15)[1]),
    "slivers": (grid(15, 15)[0] * [1.0, 1e-12], grid(15, 15)[1]),
    "no elements": (grid(10, 10)[0], sp.csr_array((100, 100))),
    "all joined": (grid(10, 10)[0], sp.csr_array(np.ones((100, 100)))),
    "one node": (np.zeros((1, 3)), sp.csr_array((1, 1))),
    "no node": (np.zeros((0, 2)), sp.csr_array((0, 0))),
}


@pytest.mark.parametrize("name", MESHES)
def test_every_node_is_eliminated_once(name):
    points, graph = MESHES[name]
    assert np.array_equal(np.sort(order_of(points, graph)), np.arange(len(points)))


def test_disconnected_bodies_and_unused_nodes_are_ordered():
    points, graph = grid(12, 12)
    both = sp.csr_array(sp.block_diag([graph, graph, sp.csr_array((7, 7))]))
    apart = np.concatenate([points, points + 100.0, np.full((7, 2), 50.0)])
    order = order_of(apart, both)
    assert np.array_equal(np.sort(order), np.arange(295))
    alone = fill(graph, order_of(points, graph))
    assert fill(both, order) <= 2.1 * alone + 7


def test_the_last_nodes_separate_the_mesh_into_halves():
    points, graph = grid(21, 21)
    order = order_of(points, graph)
    rest = np.sort(order[:-21])
    inner = graph[rest][:, rest]
    count, body = sp.csgraph.connected_components(inner)
    assert count == 2
    assert np.bincount(body).min() >= 0.4 * rest.size


@pytest.mark.parametrize("counts", [(24, 24), (9, 9, 9)])
def test_fill_is_well_below_that_of_the_natural_order(counts):
    points, graph = grid(*counts)
    scattered = np.random.default_rng(1).permutation(len(points))
    graph = sp.csr_array(graph[scattered][:, scattered])
    natural = fill(graph, np.argsort(scattered))
    assert fill(graph, order_of(points[scattered], graph)) < 0.75 * natural


def test_fill_grows_as_n_log_n_in_the_plane():
    per_node_and_level = [
        fill(graph, order_of(points, graph)) / (len(points) * np.log2(len(points)))
        for points, graph in (grid(12, 12), grid(24, 24), grid(48, 48))
    ]
    assert max(per_node_and_level) < 1.6 * min(per_node_and_level)

"""Costs told from the pattern are those of a factorization that is done."""

import numpy as np
import pytest
import scipy.sparse as sp

from geoident.fem.solvers.direct import LowerPattern
from geoident.fem.solvers.factor_cost import factor_cost


@pytest.mark.parametrize("part", [0.0, 0.01, 0.05, 0.3])  # of the pairs; few leave many trees
@pytest.mark.parametrize("seed", range(3))
def test_entries_and_operations_are_those_of_a_dense_cholesky_factor(seed, part):
    rng = np.random.default_rng(seed)
    n_nodes = 40
    size = rng.integers(1, 4, n_nodes)  # some nodes have fixed directions
    node = np.repeat(np.arange(n_nodes), size)
    links = np.eye(n_nodes, dtype=bool) | (rng.random((n_nodes, n_nodes)) < part)
    pattern = (links | links.T)[np.ix_(node, node)]
    values = np.where(pattern, rng.random(pattern.shape) + 0.1, 0.0)
    values = values + values.T + 1e3 * np.eye(len(node))
    factor = np.abs(np.linalg.cholesky(values)) > 0
    lower = sp.csc_array(np.tril(pattern))
    cost = factor_cost(LowerPattern(lower.indptr, lower.indices), node)
    assert cost.entries == np.count_nonzero(factor)
    assert cost.flops == (factor.sum(axis=0).astype(float) ** 2).sum()


def test_nothing_to_factorize_costs_nothing():
    empty = LowerPattern(np.zeros(1, np.int64), np.empty(0, np.int64))
    assert factor_cost(empty, np.empty(0, np.int64)).entries == 0

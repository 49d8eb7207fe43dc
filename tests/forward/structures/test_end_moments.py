"""Moments at the nodes of beams from those at the middles of their pieces."""

from __future__ import annotations

import numpy as np
import pytest

from geoident.forward.structures.end_moments import end_moments

N = 12
X = np.cumsum(np.r_[0.0, np.tile([0.5, 0.5, 0.3, 0.3], 3)])
TEETH = 7.0 * (-1.0) ** np.arange(N + 1)


def _found(moments, *, turned=(), kinked=(), held=(), hinged=(), toothed=True):
    """Moments (n, 2) at the ends of pieces along x that have some (n_nodes,) at their nodes."""
    nodes = np.stack([np.arange(N), np.arange(1, N + 1)], axis=1)
    turned = np.isin(np.arange(N), turned)
    nodes[turned] = nodes[turned, ::-1]
    ends = np.stack([X, np.zeros(N + 1)], axis=1)[nodes]
    some = [np.isin(np.arange(N + 1), each) for each in (kinked, held, hinged)]
    how = end_moments(nodes, ends, np.full(N, toothed), *some)
    sign = np.where(turned, -1.0, 1.0)[:, None]
    there = sign * np.asarray(moments)[nodes]
    return nodes, sign * np.stack(how.apply(there[:, 0], there[:, 1]), axis=1)


@pytest.mark.parametrize("turned", [(), (3, 4, 8)])
def test_teeth_go_and_a_line_with_a_kink_under_a_strut_stays(turned):
    smooth = 3.0 - 2.0 * X + 5.0 * np.abs(X - X[6])
    nodes, found = _found(smooth + TEETH, turned=turned, kinked=(6,), held=(0, N))
    np.testing.assert_allclose(found, smooth[nodes], atol=1e-12)


def test_free_ends_and_hinges_keep_what_they_have():
    nodes, found = _found(np.where(np.isin(np.arange(N + 1), [0, 6, N]), 0.0, 20.0), hinged=(6,))
    assert np.all(found[np.isin(nodes, [0, 6, N])] == 0.0)


def test_pieces_of_elements_without_middle_nodes_stay_as_they_are():
    nodes, found = _found(TEETH, toothed=False, held=(0, N))
    np.testing.assert_array_equal(found, TEETH[nodes])


def test_derivatives_travel_in_columns():
    _, one = _found(TEETH + X**2)
    nodes = np.stack([np.arange(N), np.arange(1, N + 1)], axis=1)
    ends = np.stack([X, np.zeros(N + 1)], axis=1)[nodes]
    no = np.zeros(N + 1, dtype=bool)
    how = end_moments(nodes, ends, np.ones(N, dtype=bool), no, no, no)
    there = np.stack([TEETH + X**2, X], axis=1)[nodes]  # (n, 2 ends, 2 columns)
    first, second = how.apply(there[:, 0], there[:, 1])
    np.testing.assert_allclose(first[:, 0], one[:, 0], rtol=1e-14)
    np.testing.assert_allclose(second[:, 0], one[:, 1], rtol=1e-14)

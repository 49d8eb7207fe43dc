"""Quasi-definite matrices in all libraries that factorize them, against dense algebra."""

import numpy as np
import pytest
import scipy.sparse as sp

from geoident.errors import UsageError
from geoident.fem.solvers import INDEFINITE, pick_solver
from geoident.fem.solvers.direct import NotPositiveDefinite


def solver(name):
    try:
        return pick_solver(name)
    except UsageError:
        pytest.skip(f"{name} is missing: pip install 'geoident[{name}]', and run again")


def blocks(n, m, small):
    """A chain of springs with pressures at every third node that give way by next to nothing."""
    K = sp.diags_array([2.0, -1.0, -1.0], offsets=[0, 1, -1], shape=(n, n))
    rng = np.random.default_rng(0)
    Q = sp.csr_array((rng.normal(size=3 * m), (rng.integers(0, n, 3 * m), np.repeat(range(m), 3))))
    Q.resize((n, m))
    constant = sp.block_array([[K, -Q], [-Q.T, -small * sp.eye_array(m)]], format="csr")
    growing = sp.block_diag([sp.csr_array((n, n)), -sp.eye_array(m)], format="csr")
    return sp.csr_array(constant), sp.csr_array(growing)


@pytest.mark.parametrize("name", INDEFINITE)
@pytest.mark.parametrize("small", [1e-2, 1e-13])
def test_solutions_are_those_of_dense_algebra(name, small):
    n, m = 60, 20
    constant, growing = blocks(n, m, small)
    signs = np.repeat([1.0, -1.0], [n, m])
    order = np.random.default_rng(1).permutation(n + m)
    made = solver(name).quasi_definite(constant, growing, signs=signs, order=order)
    right = np.random.default_rng(2).normal(size=(n + m, 3))
    for h in (0.0, 1.0, 1e-3):
        whole = (constant + h * growing).toarray()
        factor = made.factor(h)
        for some in (
            0.0 * right,
            right,
            right**3,
        ):  # the first that is not zero tells of the pivots
            assert np.abs(whole @ factor.solve(some) - some).max() < 1e-10 * (1.0 + some.max())
    with pytest.raises(NotPositiveDefinite):
        made.factor(-1.0)
    factor = made.factor(0.0)
    made.factor(1.0)
    with pytest.raises(RuntimeError, match="replaced"):
        factor.solve(right)

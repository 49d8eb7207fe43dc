"""Divided differences of the exponential and the logarithm, of dual numbers, with no cancellation.

Integrals of powers end in quotients such as (x^m - 1) / m, which lose all digits as m goes to zero
though nothing happens there (Mohr-Coulomb becomes Tresca). They are divided differences:
exp[0, m ln x] ln x, and these are smooth in their nodes. The derivative of f[x0, .., xn] by one
node is the divided difference in which that node stands twice.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import expm

from geoident.model.arrays import Floats
from geoident.model.dual import Dual

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
_NODES, _WEIGHTS = (_NODES + 1.0) / 2.0, _WEIGHTS / 2.0

_NEAR = 0.5
"""From here on ln(1 + x) / x and its derivative are taken as they are written."""


def exp_divided(*nodes: Dual) -> Dual:
    """exp[0, x1, .., xn], the divided difference of exp over 0 and the nodes.

    It is the integral over 0 < t_n < .. < t_1 < 1 of exp(x1 (t_1 - t_2) + .. + xn t_n) (Hermite and
    Genocchi), and the corner of exp of the matrix with the nodes on its diagonal and ones above it
    (G. Opitz, Steigungsmatrizen, Z. angew. Math. Mech. 44, 1964).

    >>> one = Dual(np.array([1.0, 0.0]))
    >>> round(float(exp_divided(one).value), 12) == round(np.e - 1.0, 12)
    True
    """
    shape = np.broadcast_shapes(*(node.value.shape for node in nodes))
    values = [np.broadcast_to(node.value, shape) for node in nodes]
    result = np.zeros(np.broadcast_shapes(*(node.columns.shape for node in nodes)))
    result[..., 0] = _corner([np.zeros_like(values[0]), *values])
    if nodes[0].columns.shape[-1] == 1:  # no parameters
        return Dual(result)
    for value, node in zip(values, nodes, strict=True):
        slope = _corner([np.zeros_like(value), *values, value])
        result[..., 1:] += slope[..., None] * node.columns[..., 1:]
    return Dual(result)


def log_divided(x: Dual) -> Dual:
    """ln[1, 1 + x] = ln(1 + x) / x for x > -1, one at x = 0."""
    return x.through(_log_ratio, _log_ratio_slope)


def _corner(nodes: Sequence[Floats]) -> Floats:
    """The corner (...) of exp of the bidiagonal matrices with these diagonals."""
    size = len(nodes)
    matrix = np.zeros((*nodes[0].shape, size, size))
    for k, node in enumerate(nodes):
        matrix[..., k, k] = node
    for k in range(size - 1):
        matrix[..., k, k + 1] = 1.0
    return np.asarray(expm(matrix)[..., 0, -1]) if nodes[0].size else np.empty(nodes[0].shape)


def _log_ratio(x: Floats) -> Floats:
    safe = np.where(x == 0.0, 1.0, x)
    return np.where(x == 0.0, 1.0, np.log1p(safe) / safe)


def _log_ratio_slope(x: Floats) -> Floats:
    """Near zero from the integral of t -> -t / (1 + t x)^2 over 0..1, which loses no digits."""
    near = np.abs(x) < _NEAR
    small, large = np.where(near, x, 0.0), np.where(near, 1.0, x)
    series = -(_WEIGHTS * _NODES / (1.0 + small[..., None] * _NODES) ** 2).sum(axis=-1)
    return np.where(near, series, (1.0 / (1.0 + large) - np.log1p(large) / large) / large)

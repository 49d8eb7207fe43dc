"""Divided differences of the exponential and the logarithm, of dual numbers, with no cancellation.

Integrals of powers end in quotients such as (x^m - 1) / m, which lose all digits as m goes to zero
though nothing happens there (Mohr-Coulomb becomes Tresca). They are divided differences:
exp[0, m ln x] ln x, and these are smooth in their nodes. The derivative of f[x0, .., xn] by one
node is the divided difference in which that node stands twice.
"""

from __future__ import annotations

import numpy as np

from geoident.model.arrays import Floats
from geoident.model.dual import Dual

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
_NODES, _WEIGHTS = (_NODES + 1.0) / 2.0, _WEIGHTS / 2.0

_TERMS = 16
"""Of the exponential series of matrices with elements up to a half: more change no digit."""

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
    values = [np.zeros(shape), *(np.broadcast_to(node.value, shape) for node in nodes)]
    size, slopes = len(nodes), nodes[0].columns.shape[-1] > 1
    ends = values[1:] if slopes else []  # the node that stands twice, of each derivative
    # the matrices of all derivatives are exponentiated together, and hold that of the value
    rows = [[*values, end] for end in ends] or [values]
    corners = _exp_of_bidiagonal(np.stack([np.stack(row, axis=-1) for row in rows]))
    result = np.zeros(np.broadcast_shapes(*(node.columns.shape for node in nodes)))
    result[..., 0] = corners[0, ..., 0, size]
    for slope, node in zip(corners[: len(ends), ..., 0, -1], nodes, strict=False):
        result[..., 1:] += slope[..., None] * node.columns[..., 1:]
    return Dual(result)


def log_divided(x: Dual) -> Dual:
    """ln[1, 1 + x] = ln(1 + x) / x for x > -1, one at x = 0."""
    return x.through(_log_ratio, _log_ratio_slope)


def _exp_of_bidiagonal(diagonal: Floats) -> Floats:
    """Exp (..., n, n) of the matrices with a diagonal (..., n) and ones above it.

    By scaling and squaring; of real nodes nothing cancels in the squares, since divided differences
    of exp are positive.
    """
    n = diagonal.shape[-1]
    size = max(1.0, float(np.abs(diagonal).max(initial=0.0)))
    halvings = 1 + int(np.ceil(np.log2(size)))
    ones = np.eye(n)
    matrix = diagonal[..., None] * ones + np.eye(n, k=1)
    matrix *= 0.5**halvings
    exponential = ones + matrix / _TERMS
    for term in range(_TERMS - 1, 0, -1):
        exponential = ones + matrix @ exponential / term
    for _ in range(halvings):
        exponential = exponential @ exponential
    return np.asarray(exponential)


def _log_ratio(x: Floats) -> Floats:
    safe = np.where(x == 0.0, 1.0, x)
    return np.where(x == 0.0, 1.0, np.log1p(safe) / safe)


def _log_ratio_slope(x: Floats) -> Floats:
    """Near zero from the integral of t -> -t / (1 + t x)^2 over 0..1, which loses no digits."""
    near = np.abs(x) < _NEAR
    small, large = np.where(near, x, 0.0), np.where(near, 1.0, x)
    series = -(_WEIGHTS * _NODES / (1.0 + small[..., None] * _NODES) ** 2).sum(axis=-1)
    return np.where(near, series, (1.0 / (1.0 + large) - np.log1p(large) / large) / large)

"""Linear least squares in a box, exactly, with the smallest step where the matrix is singular.

    min |A d + b|^2   subject to   lower <= d <= upper,   lower <= 0 <= upper

is the step that every Gauss-Newton iteration asks for. The unconstrained minimum of smallest norm
is tried first; near the solution it is the answer. Otherwise an active-set method (Stark &
Parker's BVLS, started at d = 0) fixes the variables that run into the box and releases those
whose gradient points back inside, until the Kuhn-Tucker conditions hold: each variable is free
with zero gradient, or on a side of the box with the gradient pushing outwards.

Singular values of the free columns below `RANK` of the largest count as zero, and the step has no
part along their directions: what A does not see does not move.

One singular value decomposition of (rows, n) for each change of the active set; n is small.
"""

from __future__ import annotations

import numpy as np

from geoident.model.arrays import Bools, Floats

RANK = 1e-10
"""Singular values below this part of the largest count as zero."""


def smallest_solution(A: Floats, b: Floats) -> Floats:
    """The d (n,) of smallest norm that minimises |A d + b|, A (rows, n), b (rows,)."""
    if A.shape[1] == 0:
        return np.zeros(0)
    return np.asarray(np.linalg.lstsq(A, -b, rcond=RANK)[0], dtype=np.float64)


def bounded_least_squares(A: Floats, b: Floats, lower: Floats, upper: Floats) -> Floats:
    """The d (n,) in the box that minimises |A d + b|.

    Args:
        A: (rows, n).
        b: (rows,).
        lower: (n,) lower side of the box, not above zero.
        upper: (n,) upper side, not below zero.

    Returns:
        (n,) the minimum; variables on the box are on it exactly. Rounding could make the active set
        go round in circles: after 20 (n + 1) changes the point reached, no worse than d = 0, is it.
    """
    d = smallest_solution(A, b)
    if np.all((d >= lower) & (d <= upper)):
        return d
    d = np.zeros(A.shape[1])
    free = _released(A, A.T @ b, d, lower, upper)
    for _ in range(20 * (len(d) + 1)):
        d, free, moved_fully = _move(A, b, d, free, lower, upper)
        if moved_fully:
            back = _most_inward(A, A.T @ (A @ d + b), free, d, lower, upper, float(b @ b))
            if back is None:
                return d
            free[back] = True
    return d


def _released(A: Floats, g: Floats, d: Floats, lower: Floats, upper: Floats) -> Bools:
    """Variables (n,) that can go down the gradient g (n,) without leaving the box."""
    return ((d > lower) | (g < 0.0)) & ((d < upper) | (g > 0.0)) & (lower < upper)


def _move(
    A: Floats, b: Floats, d: Floats, free: Bools, lower: Floats, upper: Floats
) -> tuple[Floats, Bools, bool]:
    """Goes towards the minimum over the free variables until the first one meets the box.

    Returns:
        The new d, the new free set, and whether the minimum was reached.
    """
    step = np.zeros_like(d)
    step[free] = smallest_solution(A[:, free], A @ d + b)
    side = np.where(step > 0.0, upper, lower)
    reach = np.full_like(d, np.inf)
    moving = step != 0.0
    reach[moving] = (side[moving] - d[moving]) / step[moving]
    part = float(reach.min(initial=np.inf))
    if part > 1.0:
        return np.clip(d + step, lower, upper), free, True
    blocked = reach <= part
    d = np.where(blocked, side, np.clip(d + max(part, 0.0) * step, lower, upper))
    return d, free & ~blocked, False


def _most_inward(
    A: Floats, g: Floats, free: Bools, d: Floats, lower: Floats, upper: Floats, size: float
) -> int | None:
    """The fixed variable whose gradient points most strongly back into the box, or None."""
    columns = np.linalg.norm(A, axis=0)
    inward = np.where(d <= lower, -g, 0.0) + np.where(d >= upper, g, 0.0)
    inward[free | (lower >= upper)] = 0.0
    gain = np.divide(inward, columns, out=np.zeros_like(d), where=columns > 0.0)
    best = int(np.argmax(gain))
    return best if gain[best] > 1e-13 * np.sqrt(size) else None

"""Whether yield planes leave a stress at all, and which of them contradict each other."""

from __future__ import annotations

import numpy as np

from geoident.fem.yielding.planes import YieldPlanes
from geoident.model.arrays import Floats

_FLAT = 1e-10
"""Of the largest distance: a domain thinner than that below nothing counts as flat, not empty."""


class EmptyDomain(ValueError):
    """No stress satisfies all yield conditions.

    Args:
        planes: indices of planes that contradict each other.
    """

    def __init__(self, planes: tuple[int, ...]) -> None:
        names = ", ".join(str(plane + 1) for plane in planes)
        super().__init__(f"no stress satisfies the yield planes {names} at once")
        self.planes = planes


class NoProjection(ArithmeticError):
    """The projection of some points on the yield planes did not end, to any accuracy worth having.

    Args:
        points: how many.
    """

    def __init__(self, points: int) -> None:
        super().__init__(f"the projection of {points} points on the yield planes did not end")
        self.points = points


class NoReturn(ArithmeticError):
    """No set of yield planes with flow of their own brings a stress back (non-associated flow)."""


def empty_domain(normals: Floats, distances: Floats) -> tuple[int, ...] | None:
    """Planes that contradict each other, none to spare, or None where a stress satisfies all.

    A linear program seeks the stress with the most room t <= 1 to all planes. Where t < 0, the
    multipliers of its constraints are Farkas' certificate: a combination of the normals that
    vanishes while that of the distances is negative.

    Args:
        normals: (y, s) in the space of stresses, of any length.
        distances: (y,), Pa.

    Raises:
        ArithmeticError: the linear program was not solved.
    """
    lengths = np.linalg.norm(normals, axis=1)
    normals, distances = normals / lengths[:, None], distances / lengths
    largest = float(np.abs(distances).max(initial=0.0))
    distances = distances / (largest or 1.0)
    involved = _contradiction(normals, distances, np.arange(len(distances)))
    return None if involved is None else _fewest(normals, distances, involved)


def _fewest(normals: Floats, distances: Floats, involved: tuple[int, ...]) -> tuple[int, ...]:
    """Leave out planes as long as the rest still contradicts itself."""
    for plane in involved:
        rest = np.array([other for other in involved if other != plane], dtype=np.int64)
        if rest.size and (fewer := _contradiction(normals, distances, rest)) is not None:
            return _fewest(normals, distances, fewer)
    return involved


def _contradiction(
    normals: Floats, distances: Floats, some: np.typing.NDArray[np.int64]
) -> tuple[int, ...] | None:
    """Those of some planes with a multiplier in the certificate, or None."""
    from scipy.optimize import linprog  # 0.4 s to import  # noqa: PLC0415

    size = normals.shape[1]
    room = np.zeros(size + 1)
    room[-1] = -1.0
    result = linprog(
        room,
        A_ub=np.column_stack([normals[some], np.ones(len(some))]),
        b_ub=distances[some],
        bounds=[(None, None)] * size + [(None, 1.0)],
        method="highs-ds",
    )
    # Any low t is feasible and t <= 1: only a failure of the method itself could come here.
    if result.fun is None:
        raise ArithmeticError(f"whether the yield planes leave a stress: {result.message}")
    if result.fun <= _FLAT:
        return None
    return tuple(int(p) for p in some[-result.ineqlin.marginals > _FLAT])


def empty_principal_domain(planes: YieldPlanes) -> tuple[int, ...] | None:
    """The same for planes (y, 3) in sorted principal stresses, with all their images.

    The surface is convex and the same in all orders of the principal stresses, so where it leaves a
    stress, it leaves the mean of its six orders, which is hydrostatic.
    """
    normals, limits = planes.normals.value, planes.distances.value
    sums = normals.sum(axis=1)
    flat = np.abs(sums) <= 1e-12 * np.abs(normals).sum(axis=1)
    if (bad := flat & (limits < 0.0)).any():
        return (int(np.argmax(bad)),)
    pressures = limits / np.where(flat, 1.0, sums)
    most = np.where(~flat & (sums > 0.0), pressures, np.inf)
    least = np.where(~flat & (sums < 0.0), pressures, -np.inf)
    if most.min(initial=np.inf) >= least.max(initial=-np.inf):
        return None
    return int(most.argmin()), int(least.argmax())

"""Further starts, even over the bounds and always the same (Halton's sequence)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from geoident.identify.problem.problem import Scaling
from geoident.model.arrays import Floats


def halton_starts(scaling: Scaling, count: int) -> Iterator[Floats]:
    """``count`` points x (n,) inside the bounds, the same in every run.

    A parameter without finite bounds varies by two units of x to both sides of its start.
    """
    lower = np.where(np.isfinite(scaling.lower), scaling.lower, scaling.start - 2.0)
    upper = np.where(np.isfinite(scaling.upper), scaling.upper, scaling.start + 2.0)
    bases = _primes(len(scaling))
    for index in range(1, count + 1):
        share = np.array([radical_inverse(index, base) for base in bases])
        yield lower + share * (upper - lower)


def radical_inverse(index: int, base: int) -> float:
    """The digits of ``index`` in a base, mirrored at the point (van der Corput).

    >>> [radical_inverse(i, 2) for i in (1, 2, 3)]
    [0.5, 0.25, 0.75]
    """
    value, weight = 0.0, 1.0 / base
    while index:
        index, digit = divmod(index, base)
        value += digit * weight
        weight /= base
    return value


def _primes(count: int) -> list[int]:
    found: list[int] = []
    candidate = 2
    while len(found) < count:
        if all(candidate % prime for prime in found):
            found.append(candidate)
        candidate += 1
    return found

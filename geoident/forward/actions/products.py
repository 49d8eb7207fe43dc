"""Where numbers of a case multiply each other, the equations are not affine in both."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from geoident.model.parameter import Scalar


def product_obstacle(
    what: str, factors: Sequence[Scalar | None], free: frozenset[str]
) -> str | None:
    """Why a product is not affine in the free parameters, or None if it is.

    >>> product_obstacle("the weight", (Scalar(1.0, "g"), Scalar(1.0, "rho")), frozenset({"g"}))
    >>> product_obstacle("the weight", (Scalar(1.0, "g"), Scalar(2.0, "g")), frozenset({"g"}))
    'the weight is a product with g twice in it'
    """
    loose = [f.parameter for f in factors if f is not None and f.parameter in free]
    for one, other in combinations(loose, 2):
        if one == other:
            return f"{what} is a product with {one} twice in it"
        return f"{what} is the product of {one} and {other}, and both are free"
    return None

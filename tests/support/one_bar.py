"""A bar that yields beside an elastic one, as a bilinear system.

With the elongation u, the force sigma of the bar that yields and its plastic elongation lam,

    sigma + 3 u = 10,    sigma = 2 (u - lam),    s = p0 - sigma + p1 lam

so u = 2 + 0.4 lam and s = p0 - 4 + 1.2 lam + p1 lam.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp

from geoident.model.response import Bilinear, BilinearSystem


def bilinear(
    constant: Any, by_p: Any, by_x: Any, products: Mapping[int, Any] | None = None
) -> Bilinear:
    """Constant, factors of parameters and of unknowns, and of their products, by lists."""
    found = {h: sp.csr_array(np.array(A, dtype=float)) for h, A in (products or {}).items()}
    constant, by_p, by_x = (np.array(a, dtype=float) for a in (constant, by_p, by_x))
    return Bilinear(constant, by_p, sp.csr_array(by_x), found)


def bar_system(readings: Bilinear, *, beside: float = 3.0) -> BilinearSystem:
    """The system with unknowns u, sigma, lam and parameters k, H.

    Args:
        readings: what is read.
        beside: stiffness of the elastic bar.
    """
    return BilinearSystem(
        names=("k", "H"),
        equations=bilinear([-10.0, 0.0], np.zeros((2, 2)), [[beside, 1.0, 0.0], [-2.0, 1.0, 2.0]]),
        slacks=bilinear([0.0], [[1.0, 0.0]], [[0.0, -1.0, 0.0]], {1: [[0.0, 0.0, 1.0]]}),
        readings=readings,
        multipliers=np.array([2]),
        stiffness=np.array([2.0]),
        work=np.array([7.0]),
        kind_of_unknown=np.array([0, 1, -1]),
        kind_of_equation=np.array([-1, 1]),
        kind_of_slack=np.array([1]),
    )

"""Which elastic constants give a positive definite matrix, and which bound those break that do not.

Strain energy must be positive for every strain. For engineering constants that means, besides
positive moduli, bounds on Poisson's ratios: with nu_ij <= sqrt(E_i / E_j) in size the two-by-two
minors of the compliance are positive, and one bound more makes its determinant positive (B. M.
Lempriere, 1968, Poisson's ratio in orthotropic materials, AIAA Journal 6).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import degrees, sqrt

import numpy as np

from geoident.model.elastic import (
    Anisotropic,
    Elastic,
    Isotropic,
    LoveModuli,
    Orthotropic,
    TransverselyIsotropic,
    constants,
)

Numbers = Mapping[str, float]

_ANGLES = ("friction", "dilation")


@dataclass(frozen=True)
class Breach:
    """A constant outside its bounds.

    Args:
        constant: its name.
        value: SI.
        limit: what it must be, half a sentence.
    """

    constant: str
    value: float
    limit: str

    @property
    def shown(self) -> str:
        """The value with its unit."""
        if self.constant in _ANGLES:
            return f"{degrees(self.value):.6g} deg"
        return f"{self.value:.6g}" + ("" if self.constant.startswith("nu") else " Pa")


def breach(elastic: Elastic, values: Mapping[str, float]) -> Breach | None:
    """The first bound that the constants break at parameter values (SI), or None."""
    numbers = {name: scalar.value(values) for name, scalar in constants(elastic).items()}
    return _CHECKS[type(elastic)](numbers)


def _isotropic(given: Numbers) -> Breach | None:
    found = _not_positive(given, ("E", "K", "G"))
    return found or _outside(given, "nu", -1.0, 0.5)


def _strata(given: Numbers) -> Breach | None:
    found = _not_positive(given, ("E_p", "E_n", "G_np")) or _outside(given, "nu_p", -1.0, 1.0)
    if found:
        return found
    ratio = given["E_n"] / given["E_p"]
    bound = sqrt(ratio * (1 - given["nu_p"]) / 2)
    known = f"with E_n/E_p = {ratio:.4g} and nu_p = {given['nu_p']:.4g} "
    return _outside(given, "nu_np", -bound, bound, known)


def _love(given: Numbers) -> Breach | None:
    found = _not_positive(given, ("A", "C", "L", "N"))
    if found:
        return found
    if given["A"] <= given["N"]:
        return Breach("A", given["A"], f"it must exceed N = {given['N']:.6g} Pa")
    bound = sqrt((given["A"] - given["N"]) * given["C"])
    return _outside(given, "F", -bound, bound, "with these A, C and N ")


def _orthotropic(given: Numbers) -> Breach | None:
    found = _not_positive(given, ("E_1", "E_2", "E_3", "G_12", "G_13", "G_23"))
    if found:
        return found
    size = {(i, j): sqrt(given[f"E_{i}"] / given[f"E_{j}"]) for i, j in ((1, 2), (1, 3), (2, 3))}
    for (i, j), bound in size.items():
        known = f"with E_{i}/E_{j} = {bound**2:.4g} "
        found = found or _outside(given, f"nu_{i}{j}", -bound, bound, known)
    if found:
        return found
    # Scaled to ones on the diagonal the compliance is [1, -a, -b; -a, 1, -c; -b, -c, 1]; its
    # determinant 1 - a^2 - b^2 - c^2 - 2 a b c is positive between two values of c.
    a, b = given["nu_12"] / size[1, 2], given["nu_13"] / size[1, 3]
    middle, half = -a * b * size[2, 3], sqrt((1 - a**2) * (1 - b**2)) * size[2, 3]
    known = f"with nu_12 = {given['nu_12']:.4g} and nu_13 = {given['nu_13']:.4g} "
    return _outside(given, "nu_23", middle - half, middle + half, known)


def _anisotropic(given: Numbers) -> Breach | None:
    """By the pivots of elimination: c_kk must exceed what its column takes away."""
    n = 6 if "c55" in given and "c66" in given else 4
    matrix = np.zeros((n, n))
    for name, value in given.items():
        i, j = int(name[1]) - 1, int(name[2]) - 1
        if max(i, j) < n:
            matrix[i, j] = matrix[j, i] = value
    for k in range(n):
        column = matrix[:k, k]
        least = float(column @ np.linalg.solve(matrix[:k, :k], column)) if k else 0.0
        if not matrix[k, k] > least:
            limit = "it must be positive"
            if least > 0:
                limit = f"with the entries above and left of it, it must exceed {least:.6g} Pa"
            return Breach(f"c{k + 1}{k + 1}", float(matrix[k, k]), limit)
    return None


_CHECKS: Mapping[type, Callable[[Numbers], Breach | None]] = {
    Isotropic: _isotropic,
    TransverselyIsotropic: _strata,
    LoveModuli: _love,
    Orthotropic: _orthotropic,
    Anisotropic: _anisotropic,
}


def _not_positive(given: Numbers, names: tuple[str, ...]) -> Breach | None:
    for name in names:
        if name in given and not given[name] > 0:
            return Breach(name, given[name], "it must be positive")
    return None


def _outside(given: Numbers, name: str, low: float, high: float, known: str = "") -> Breach | None:
    if name not in given or low < given[name] < high:
        return None
    unit = "" if name.startswith("nu") else " Pa"
    limit = f"{known}it must be between {low:.4g} and {high:.4g}{unit}"
    return Breach(name, given[name], limit)

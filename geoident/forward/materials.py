"""From the numbers of a case to elastic moduli, with exact derivatives by the parameters."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from geoident.fem.elasticity import isotropic_matrices, lame_from_bulk, lame_from_young
from geoident.model.arrays import Floats
from geoident.model.case import Isotropic, Material
from geoident.model.parameter import Scalar

Values = Mapping[str, float]
"""Parameter name to value, SI."""


def elasticity(material: Material, values: Values, n_strain: int) -> Floats:
    """E (n_strain, n_strain), Pa."""
    lame, _ = _lame(material.elastic, values)
    return np.asarray(np.tensordot(lame, isotropic_matrices(n_strain), axes=1))


def elasticity_slopes(material: Material, values: Values, n_strain: int) -> dict[str, Floats]:
    """dE/dp (n_strain, n_strain) for every parameter on which the material's moduli depend."""
    _, by_constant = _lame(material.elastic, values)
    matrices = isotropic_matrices(n_strain)
    slopes: dict[str, Floats] = {}
    for constant, column in zip(constants(material.elastic).values(), by_constant.T, strict=True):
        if constant.parameter is not None:
            change = np.tensordot(column * constant.factor, matrices, axes=1)
            slopes[constant.parameter] = slopes.get(constant.parameter, 0.0) + change
    return slopes


def constants(elastic: Isotropic) -> dict[str, Scalar]:
    """The pair of constants by which the elasticity is given, E and nu or K and G."""
    if elastic.E is not None and elastic.nu is not None:
        return {"E": elastic.E, "nu": elastic.nu}
    if elastic.K is not None and elastic.G is not None:
        return {"K": elastic.K, "G": elastic.G}
    msg = "isotropic elasticity is given by E and nu or by K and G"
    raise ValueError(msg)


def inadmissible(material: Material, values: Values) -> str | None:
    """Why the moduli are not positive definite, a sentence, or None if they are."""
    for name, constant in constants(material.elastic).items():
        value = constant.value(values)
        if name == "nu" and not -1 < value < 0.5:
            return f"nu of {material.name} is {value:.6g}, it must be between -1 and 0.5"
        if name != "nu" and not value > 0:
            return f"{name} of {material.name} is {value:.6g} Pa, it must be positive"
    return None


def affine_obstacle(material: Material, free: frozenset[str]) -> str | None:
    """Why the moduli are not affine in the free parameters, or None if they are."""
    nu = material.elastic.nu
    if nu is not None and nu.parameter in free:
        return f"nu of {material.name} enters the stiffness nonlinearly (K and G enter linearly)"
    return None


def _lame(elastic: Isotropic, values: Values) -> tuple[Floats, Floats]:
    pair = constants(elastic)
    first, second = (constant.value(values) for constant in pair.values())
    return lame_from_young(first, second) if "E" in pair else lame_from_bulk(first, second)

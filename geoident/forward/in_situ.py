"""In-situ stress sigma_0 and its derivatives (theory 2): linear or bilinear in its numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoident.forward.materials import Values
from geoident.model.arrays import Floats
from geoident.model.in_situ import ConstantStress, HeimStress, InSitu
from geoident.model.parameter import Scalar

_ROWS = {2: (0, 1, 2, 3), 3: (0, 1, 2, 3, 4, 5)}  # xx yy zz xy (yz xz) of the strain points


def in_situ_stress(
    model: InSitu | None, values: Values, names: Sequence[str], positions: Floats
) -> Floats:
    """Stress and its derivatives at some points.

    Args:
        model: the in-situ model, None for no stress.
        values: parameter values.
        names: the parameters to differentiate by.
        positions: (m, dim) coordinates, m.

    Returns:
        (n_strain, m, 1 + n) stress in column 0, its derivatives in the others; Pa, tension
        positive.
    """
    m, dim = positions.shape
    result = np.zeros((len(_ROWS[dim]), m, 1 + len(names)))
    if isinstance(model, ConstantStress):
        for row, scalar in enumerate(model.components[: result.shape[0]]):
            result[row] = _columns(scalar, values, names)
    elif isinstance(model, HeimStress):
        _fill_heim(result, model, values, names, positions)
    return result


def edges_held(model: InSitu | None) -> bool:
    """Whether tractions on the edges of the model hold the stress (`HeimStress.held`).

    A stress that is the same everywhere can't vanish at the surface: the ground that continues
    beyond the edges of the model holds it.
    """
    if model is None:
        return False
    if model.held is not None:
        return model.held
    return isinstance(model, ConstantStress) or model.vertical is not None


def affine_obstacle(model: InSitu | None, free: frozenset[str]) -> str | None:
    """Why sigma_0 is not affine in the free parameters, or None if it is."""
    if isinstance(model, HeimStress):
        level = model.vertical or model.unit_weight
        if level is not None and {level.parameter, model.K0.parameter} <= free:
            return (
                f"the horizontal stress is the product of {level.parameter} and "
                f"{model.K0.parameter}, and both are free"
            )
    return None


def _columns(scalar: Scalar, values: Values, names: Sequence[str]) -> Floats:
    """(1 + n,) value and derivatives of a number."""
    return np.array([scalar.value(values), *(scalar.slope(name) for name in names)])


def _fill_heim(
    result: Floats, model: HeimStress, values: Values, names: Sequence[str], positions: Floats
) -> None:
    dim = positions.shape[1]
    up = dim - 1
    vertical = -_overburden(model, values, names, positions)
    K0 = _columns(model.K0, values, names)
    horizontal = vertical * K0[0]
    horizontal[:, 1:] += vertical[:, :1] * K0[1:]
    result[up] = vertical
    for row in {0, 1, 2} - {up}:
        result[row] = horizontal


def _overburden(
    model: HeimStress, values: Values, names: Sequence[str], positions: Floats
) -> Floats:
    """Vertical pressure (m, 1 + n), compression positive."""
    if model.vertical is not None:
        return np.tile(_columns(model.vertical, values, names), (len(positions), 1))
    if model.unit_weight is None or model.surface is None:
        msg = "Heim's stress needs a vertical stress, or a unit weight and the surface's level"
        raise ValueError(msg)
    depth = np.maximum(model.surface.factor - positions[:, -1], 0.0)
    return np.outer(depth, _columns(model.unit_weight, values, names))

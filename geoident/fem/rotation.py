"""Material axes in the axes of the model, and what turning them does to an elasticity matrix."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from geoident.model.arrays import Floats

_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
_FIRST, _SECOND = np.array(_PAIRS).T


@dataclass(frozen=True)
class Turn:
    """A rotation and its derivatives.

    Args:
        matrix: R (3, 3); its columns are the material axes 1, 2, 3 in the axes of the model.
        slopes: dR by each angle, (3, 3) per rad.
    """

    matrix: Floats
    slopes: Mapping[str, Floats]


def about(axis: int, angle: float) -> tuple[Floats, Floats]:
    """Right-handed rotation (3, 3) about a coordinate axis, and its derivative by the angle."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    c, s = np.cos(angle), np.sin(angle)
    matrix, slope = np.eye(3), np.zeros((3, 3))
    matrix[[j, k], [j, k]], matrix[j, k], matrix[k, j] = c, -s, s
    slope[[j, k], [j, k]], slope[j, k], slope[k, j] = -s, -c, c
    return matrix, slope


def turn_of_attitude(
    dip: float, dip_direction: float, rotation: float, *, section: bool = False
) -> Turn:
    """Material axes of strata: 1 down the dip, 2 along the strike, 3 normal, upwards.

    R = R_z(-dip_direction) R_x(-dip) R_z(90 deg + rotation) in axes east, north, up.

    Args:
        dip: rad, from the horizontal downwards.
        dip_direction: rad, clockwise from north.
        rotation: rad, of axes 1 and 2 about the normal.
        section: in the axes of a plane section that is seen looking north: x east, y up, z south.
    """
    plan, by_plan = about(2, -dip_direction)
    tilt, by_tilt = about(0, -dip)
    spin, by_spin = about(2, np.pi / 2 + rotation)
    upright = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]) if section else np.eye(3)
    plan, by_plan = upright @ plan, upright @ by_plan
    slopes = {
        "dip": plan @ -by_tilt @ spin,
        "dip_direction": -by_plan @ tilt @ spin,
        "rotation": plan @ tilt @ by_spin,
    }
    return Turn(plan @ tilt @ spin, slopes)


def turn_of_axes(first: Floats, second: Floats) -> Turn:
    """Material axes by the orthonormal vectors of axis 1 and axis 2, each (3,)."""
    matrix = np.column_stack([first, second, np.cross(first, second)])
    return Turn(matrix, {})


def bond(R: Floats) -> Floats:
    """Bond's matrix M (6, 6): stress in the model's axes = M (stress in the material axes).

    So the elasticity matrix turns as E = M E' M^T. W. L. Bond (1943), The mathematics of the
    physical properties of crystals, Bell System Technical Journal 22; here with the components
    in the order xx, yy, zz, xy, yz, xz.
    """
    return _double(R, R)


def bond_slope(R: Floats, dR: Floats) -> Floats:
    """Derivative of `bond` along dR, (6, 6)."""
    return _double(R, dR) + _double(dR, R)


def _double(P: Floats, Q: Floats) -> Floats:
    """The bilinear form behind Bond's matrix: sigma_ij = P_ik Q_jl sigma'_kl."""
    straight = P[_FIRST][:, _FIRST] * Q[_SECOND][:, _SECOND]
    crossed = P[_FIRST][:, _SECOND] * Q[_SECOND][:, _FIRST]
    return np.asarray(straight + np.where(_FIRST == _SECOND, 0.0, 1.0) * crossed)

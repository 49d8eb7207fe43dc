"""Elasticity as a case states it: symmetry, constants, and how the symmetry lies in the ground."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields

from geoident.model.parameter import Scalar

Vector3 = tuple[float, float, float]

ENTRIES = tuple(f"c{i}{j}" for i in range(1, 7) for j in range(i, 7))
"""Names of the 21 entries of the upper triangle: c11, c12, ..., c66."""


@dataclass(frozen=True)
class Attitude:
    """How strata lie: angles in rad, as a compass with clinometer reads them.

    Material axes: 1 down the dip, 2 along the strike, 3 normal to the strata, upwards; then 1 and 2
    are turned about 3. In a solid x is east, y north, z up. A plane section is seen looking north:
    x is east, y up, z south, out of the plane towards the viewer.

    Args:
        dip: inclination of the strata, from the horizontal downwards.
        dip_direction: azimuth of the line of dip, clockwise from north. A quarter turn in a plane
            section: the strata fall towards +x, and ``dip`` is their apparent dip.
        rotation: turns axes 1 and 2 about the normal, right-handed.
    """

    dip: Scalar
    dip_direction: Scalar
    rotation: Scalar = Scalar(0.0)


@dataclass(frozen=True)
class Axes:
    """Material axes by two vectors in x, y, z, orthonormal: axis 1 and axis 2; 3 completes them."""

    first: Vector3
    second: Vector3


Frame = Attitude | Axes
"""Where the material axes 1, 2, 3 point."""


@dataclass(frozen=True)
class Isotropic:
    """Isotropic elasticity by Young's modulus and Poisson's ratio, or by bulk and shear modulus.

    Exactly one pair is given. Moduli in Pa.
    """

    E: Scalar | None = None
    nu: Scalar | None = None
    K: Scalar | None = None
    G: Scalar | None = None


@dataclass(frozen=True)
class TransverselyIsotropic:
    """Strata: isotropic in their plane, different along their normal n. Moduli in Pa.

    Args:
        E_p: Young's modulus in the plane.
        nu_p: Poisson's ratio in the plane.
        E_n: Young's modulus along the normal.
        nu_np: under a stress along the normal, -strain in the plane / strain along the normal.
        G_np: shear modulus between the normal and the plane.
        frame: its axis 3 is the normal.
    """

    E_p: Scalar
    nu_p: Scalar
    E_n: Scalar
    nu_np: Scalar
    G_np: Scalar
    frame: Frame


@dataclass(frozen=True)
class LoveModuli:
    """Transverse isotropy by Love's moduli (Pa), in which the elasticity is linear.

    A. E. H. Love, A Treatise on the Mathematical Theory of Elasticity, article 110: with axis 3
    normal to the strata, A = c11 = c22, C = c33, F = c13 = c23, L the shear modulus between normal
    and plane, N the shear modulus in the plane, c12 = A - 2 N.
    """

    A: Scalar
    C: Scalar
    F: Scalar
    L: Scalar
    N: Scalar
    frame: Frame


@dataclass(frozen=True)
class Orthotropic:
    """Three planes of symmetry normal to the axes 1, 2, 3. Moduli in Pa.

    nu_ij is -strain along j / strain along i under a stress along i; nu_ij / E_i = nu_ji / E_j.
    """

    E_1: Scalar
    E_2: Scalar
    E_3: Scalar
    nu_12: Scalar
    nu_13: Scalar
    nu_23: Scalar
    G_12: Scalar
    G_13: Scalar
    G_23: Scalar
    frame: Frame


@dataclass(frozen=True)
class Anisotropic:
    """No symmetry: the upper triangle of the elasticity matrix, Pa; what is missing is zero.

    Rows and columns in the order xx, yy, zz, xy, yz, xz of the model's own axes; shear strains are
    gamma = 2 eps.
    """

    entries: Mapping[str, Scalar] = field(default_factory=dict)


Elastic = Isotropic | TransverselyIsotropic | LoveModuli | Orthotropic | Anisotropic


def constants(elastic: Elastic) -> dict[str, Scalar]:
    """The numbers that the elasticity matrix is made of, by name, without the frame's angles."""
    if isinstance(elastic, Anisotropic):
        return dict(elastic.entries)
    given = {f.name: getattr(elastic, f.name) for f in fields(elastic) if f.name != "frame"}
    return {name: value for name, value in given.items() if value is not None}


def angles(elastic: Elastic) -> dict[str, Scalar]:
    """The numbers that say how the material axes lie, by name."""
    frame = getattr(elastic, "frame", None)
    if not isinstance(frame, Attitude):
        return {}
    return {f.name: getattr(frame, f.name) for f in fields(frame)}


def numbers_of(elastic: Elastic) -> dict[str, Scalar]:
    """All numbers on which the elasticity matrix depends, by name."""
    return {**constants(elastic), **angles(elastic)}

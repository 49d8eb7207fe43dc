"""Elasticity as a case states it: symmetry, constants, and how the symmetry lies in the ground.

Also: which constants give a positive definite matrix, and which bound is broken if not.

Strain energy must be positive for every strain. For engineering constants that means, besides
positive moduli, bounds on Poisson's ratios: with nu_ij <= sqrt(E_i / E_j) in size the two-by-two
minors of the compliance are positive, and one bound more makes its determinant positive (B. M.
Lempriere, 1968, Poisson's ratio in orthotropic materials, AIAA Journal 6).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import sqrt

import numpy as np

from geoident.model.arrays import Floats, Ints
from geoident.model.bounds import Breach, Numbers, beyond, not_positive, outside
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.empirical.rock_mass import LARGEST_GSI, RockMassModulus
from geoident.model.in_situ import Surface
from geoident.model.parameter import Scalar, Values, scalars_of

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


@dataclass(frozen=True)
class PointValue:
    """The value of a constant of the ground at a point, from a test there.

    Args:
        position: (dim,) m.
        value: SI.
        accuracy: its standard deviation, SI; 0 where it is exact.
        origin: where it is written, for messages, such as ``boreholes.csv, line 7``.
        path: keys below the field that lead to it.
    """

    position: tuple[float, ...]
    value: float
    accuracy: float = 0.0
    origin: str = ""
    path: tuple[str | int, ...] = ()


@dataclass(frozen=True)
class RandomField:
    """A positive constant that varies from place to place as a lognormal random field (theory 10).

    Its logarithm has the mean log(mean), the standard deviation ``sd`` and a Matern correlation
    with a length along each of three axes. Where tests gave its value, it passes through them.

    Args:
        material: of this material.
        constant: name among `constants` of its elasticity, or among the strengths of a surface.
        mean: the median of the values in Pa (rad for an angle), the constant without its field.
        sd: standard deviation of the logarithm, about that of the values by their mean.
        lengths: (1,) correlation length in all directions, or (dim,) along the axes, m: 1, 2, 3 of
            the frame in a solid; 1 (down the dip) and 3 (normal to it) in a section.
        frame: where the axes point; angles are given numbers.
        smoothness: nu of the Matern correlation: 0.5 exponential, 1.5 once differentiable.
        modes: most modes; None: as many as the variance needs.
        measured: values at points.
        surface: index of the yield surface whose strength it is; None for an elastic constant.
        dimension: physical dimension, a key of `geoident.units.DIMENSIONS`.
        unit: in which the user wrote the mean, for tables.
        path: keys of the case that lead to it.
    """

    material: str
    constant: str
    mean: Scalar
    sd: float
    lengths: tuple[float, ...]
    frame: Frame
    smoothness: float = 1.5
    modes: int | None = None
    measured: tuple[PointValue, ...] = ()
    surface: int | None = None
    dimension: str = "pressure"
    unit: str = ""
    path: tuple[str | int, ...] = ()

    @property
    def name(self) -> str:
        """By which people and files know it.

        >>> flat = Attitude(Scalar(0.0), Scalar(0.0))
        >>> RandomField("rock", "E", Scalar(1.0), 0.3, (20.0,), flat).name
        'rock.E'
        """
        return _name(self)


@dataclass(frozen=True)
class WithDepth:
    """A constant that grows in proportion to depth: value = base + gradient * depth.

    Args:
        gradient: per metre of depth, Pa/m.
        surface: where depth is counted from, downwards; above it depth is negative.
    """

    gradient: Scalar
    surface: Surface


@dataclass(frozen=True)
class WithStress:
    """A constant that grows with the stress in situ: value = base (p' / pressure)^exponent.

    p' is the mean effective in-situ stress as the case gives it, compression positive, and at
    least ``least``: soil that is pulled, or bears nothing, keeps the stiffness of that pressure.

    Args:
        exponent: of the power.
        pressure: at which the constant is its base, Pa.
        least: the least p' that counts, Pa.
    """

    exponent: Scalar
    pressure: Scalar
    least: Scalar


@dataclass(frozen=True)
class Growth:
    """A constant that grows with depth or with the stress in situ (theory 10.7).

    Args:
        material: of this material.
        constant: name among `constants` of its elasticity, or among the strengths of a surface.
        base: the number from which it grows, Pa: at the surface, or at the reference pressure; the
            constant without its growth.
        law: how it grows.
        surface: index of the yield surface whose strength it is; None for an elastic constant.
        dimension: physical dimension, a key of `geoident.units.DIMENSIONS`.
        unit: in which the user wrote the base, for tables.
        path: keys of the case that lead to it.
    """

    material: str
    constant: str
    base: Scalar
    law: WithDepth | WithStress
    surface: int | None = None
    dimension: str = "pressure"
    unit: str = ""
    path: tuple[str | int, ...] = ()

    @property
    def name(self) -> str:
        """By which people and files know it."""
        return _name(self)

    @property
    def words(self) -> str:
        """That it grows, a clause."""
        with_what = "depth" if isinstance(self.law, WithDepth) else "the in-situ stress"
        written = self.path[-1] if self.path else self.constant
        return f"{written} of {self.material} grows with {with_what}"


def _name(varied: RandomField | Growth) -> str:
    surface = f".yield-{varied.surface + 1}" if varied.surface else ""
    return f"{varied.material}{surface}.{varied.constant}"


@dataclass(frozen=True)
class PointField:
    """A field at the strain points of its material, as a sum of modes (theory 10).

    With q a point, m the mean at the parameters, and xi the coefficients of the modes, each of them
    a parameter with the prior N(0, 1):

        value_q = m (reference / m)^pull_q exp(known_q + sum_k modes_qk xi_k)

    Args:
        material: of this material.
        constant: name among the constants of its elasticity, or the strengths of its surface.
        surface: index of the yield surface; None for an elastic constant.
        points: (n,) numbers of the strain points of all ground that is ever of the material,
            ascending.
        known: (n,) what tests say of the logarithm, against ``reference``; zero without tests.
        modes: (n, r) modes times their standard deviation.
        names: (r,) of the coefficients, the parameters.
        pull: (n,) by how much tests hold the value whatever the mean: 0 for not, 1 for wholly.
        reference: the mean against which ``known`` counts, Pa (rad).
        explained: part of the variance that the modes hold.
    """

    material: str
    constant: str
    surface: int | None
    points: Ints
    known: Floats
    modes: Floats
    names: tuple[str, ...]
    pull: Floats
    reference: float
    explained: float = 1.0

    def factor(self, values: Values, mean: float) -> Floats:
        """By what the mean is multiplied at the points, (n,), at parameter values."""
        xi = np.array([values[name] for name in self.names])
        held = self.pull * np.log(self.reference / mean)
        return np.asarray(np.exp(self.known + held + self.modes @ xi))


@dataclass(frozen=True, eq=False)
class PointGrowth:
    """A constant at the strain points of its material.

    Args:
        growth: as the case says it.
        points: (q,) numbers of the strain points of all ground that is ever of the material,
            ascending.
        positions: (q, dim) their coordinates, m.
        names: parameters that its values may depend on.
        value: its values (q,) at parameters, Pa.
        typical: a number of its size, Pa, at which matrices are scaled; it depends on no parameter.
        n_outside: points beside the footprint of the surface from which depth is counted.
    """

    growth: Growth
    points: Ints
    positions: Floats
    names: frozenset[str]
    value: Callable[[ParameterPoint], Dual]
    typical: float
    n_outside: int = 0


def constants(elastic: Elastic) -> dict[str, Scalar]:
    """The numbers that the elasticity matrix is made of, by name, without the frame's angles."""
    if isinstance(elastic, Anisotropic):
        return dict(elastic.entries)
    return scalars_of(elastic)


def with_constants(elastic: Elastic, changed: Mapping[str, Scalar]) -> Elastic:
    """An elasticity with other numbers for some of its constants, by name."""
    if isinstance(elastic, Anisotropic):
        return Anisotropic({**elastic.entries, **changed})
    known = {**elastic.__dict__, **changed}
    return type(elastic)(**known)


def bounded(elastic: Elastic, growths: Sequence[Growth]) -> Elastic:
    """The elasticity to check against bounds.

    A modulus of isotropic ground that grows may start from zero, and the bounds of others do not
    depend on it, so it is replaced by 1 here and checked at the points of the ground.
    """
    if not isinstance(elastic, Isotropic):
        return elastic
    grown = [growth.constant for growth in growths if growth.surface is None]
    return with_constants(elastic, dict.fromkeys(grown, Scalar(1.0)))


def angles(elastic: Elastic) -> dict[str, Scalar]:
    """The numbers that say how the material axes lie, by name."""
    frame = getattr(elastic, "frame", None)
    return {} if frame is None else angles_of(frame)


def angles_of(frame: Frame) -> dict[str, Scalar]:
    """The angles of a frame, by name; none where vectors give it."""
    return scalars_of(frame)


def elastic_scalars(elastic: Elastic) -> dict[str, Scalar]:
    """All numbers on which the elasticity matrix depends, by name."""
    return {**constants(elastic), **angles(elastic)}


def breach(elastic: Elastic, values: Values) -> Breach | None:
    """The first bound that the constants break at parameter values (SI), or None."""
    for scalar in constants(elastic).values():
        if isinstance(scalar, RockMassModulus) and (fault := _rock_mass(scalar, values)):
            return fault
    numbers = {name: scalar.value(values) for name, scalar in constants(elastic).items()}
    return _CHECKS[type(elastic)](numbers)


def _rock_mass(modulus: RockMassModulus, values: Values) -> Breach | None:
    constants = {name: part.value(values) for name, part in modulus.parts.items()}
    fault = beyond(constants, "GSI", 0.0, LARGEST_GSI) or beyond(constants, "D", 0.0, 1.0)
    return fault or not_positive(constants, "Ei", "MR", "sigci")


def _isotropic(constants: Numbers) -> Breach | None:
    fault = not_positive(constants, "E", "K", "G")
    return fault or outside(constants, "nu", -1.0, 0.5)


def _strata(constants: Numbers) -> Breach | None:
    fault = not_positive(constants, "E_p", "E_n", "G_np") or outside(constants, "nu_p", -1.0, 1.0)
    if fault:
        return fault
    ratio = constants["E_n"] / constants["E_p"]
    bound = sqrt(ratio * (1 - constants["nu_p"]) / 2)
    known = f"with E_n/E_p = {ratio:.4g} and nu_p = {constants['nu_p']:.4g} "
    return outside(constants, "nu_np", -bound, bound, known)


def _love(constants: Numbers) -> Breach | None:
    fault = not_positive(constants, "A", "C", "L", "N")
    if fault:
        return fault
    if constants["A"] <= constants["N"]:
        return Breach("A", constants["A"], f"it must exceed N = {constants['N']:.6g} Pa")
    bound = sqrt((constants["A"] - constants["N"]) * constants["C"])
    return outside(constants, "F", -bound, bound, "with these A, C and N ")


def _orthotropic(constants: Numbers) -> Breach | None:
    fault = not_positive(constants, "E_1", "E_2", "E_3", "G_12", "G_13", "G_23")
    if fault:
        return fault
    size = {
        (i, j): sqrt(constants[f"E_{i}"] / constants[f"E_{j}"]) for i, j in ((1, 2), (1, 3), (2, 3))
    }
    for (i, j), bound in size.items():
        known = f"with E_{i}/E_{j} = {bound**2:.4g} "
        fault = fault or outside(constants, f"nu_{i}{j}", -bound, bound, known)
    if fault:
        return fault
    # Scaled to ones on the diagonal the compliance is [1, -a, -b; -a, 1, -c; -b, -c, 1]; its
    # determinant 1 - a^2 - b^2 - c^2 - 2 a b c is positive between two values of c.
    a, b = constants["nu_12"] / size[1, 2], constants["nu_13"] / size[1, 3]
    middle, half = -a * b * size[2, 3], sqrt((1 - a**2) * (1 - b**2)) * size[2, 3]
    known = f"with nu_12 = {constants['nu_12']:.4g} and nu_13 = {constants['nu_13']:.4g} "
    return outside(constants, "nu_23", middle - half, middle + half, known)


def _anisotropic(constants: Numbers) -> Breach | None:
    """By the pivots of elimination: c_kk must exceed what its column takes away."""
    n = 6 if "c55" in constants and "c66" in constants else 4
    matrix = np.zeros((n, n))
    for name, value in constants.items():
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

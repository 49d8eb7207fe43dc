"""Polyhedra for the yield surfaces of ground, with derivatives by their strengths and angles.

Mohr-Coulomb's function is the largest, over all pairs of directions a, b at a right angle, of

    (1 + sin phi) a^T sigma a - (1 - sin phi) b^T sigma b - 2 c cos phi ;

a finite set of pairs gives a polyhedron around the surface: *circumscribed*. Where the stress of
the pair is split into its mean and its deviator, dividing the deviator by a factor 0 < kappa <= 1
shrinks the polyhedron: with the smallest ratio between what the set finds and the true largest
value it lies inside, *inscribed*; with the mean of the ratio it is of the same size on average,
*best*.

In a section (xx, yy, zz, xy) the stress out of plane is principal. With the mean m of xx and yy,
the radius r of Mohr's circle in the plane and S = sin phi, the pairs of two directions of the
plane, of one with z, and of z with one give

    S m + r <= c cos phi
    (1 + S) (m + r) - (1 - S) zz <= 2 c cos phi
    (1 + S) zz - (1 - S) (m - r) <= 2 c cos phi

so all that is not linear is r, the radius of a circle: a polygon of N equal sides in its place
does for all three, with kappa = cos(pi / N) inscribed and N / pi sin(pi / N) best. These are 3 N
planes, whose error falls with 1 / N^2. The first family is that of S. W. Sloan (1988 and 1989, Int.
J. Numer. Anal. Methods Geomech. 12 and 13: lower and upper bounds by linear programming).

In a solid the pairs are those of frames that are spread evenly over all rotations, six from each;
kappa is found as `facets` tells. The error falls with y^(-2/3) in the number y of planes only:
inscribed, kappa is 0.64 with 48 planes, 0.79 with 108, 0.87 with 300, 0.91 with 600. In solids the
exact surface is to be preferred.

A cut-off limits the largest principal stress to the tensile strength T: over all directions a,
a^T sigma a <= T. In a section that is m + r <= T, with Mohr's circle by a polygon, and zz <= T. In
a solid directions a are spread evenly.
"""

from __future__ import annotations

from functools import lru_cache
from math import ceil

import numpy as np

from geoident.fem.yielding.planes import YieldPlanes, common_inside
from geoident.forward.yielding.facets import (
    polygon_shrinkage,
    principal_deviators,
    shrinkage,
    spread_directions,
    spread_frames,
)
from geoident.model.arrays import Floats
from geoident.model.dual import Dual, ParameterPoint, joined, stacked
from geoident.model.yielding import Fit, MohrCoulomb

MEAN = np.array([0.5, 0.5, 0.0, 0.0])
"""Mean of xx and yy, of the stresses of a section."""

AXIAL = np.array([0.0, 0.0, 1.0, 0.0])
"""The stress normal to a section."""

PRESSURE = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]) / 3
"""The mean stress of a solid."""

_FEWEST = 12  # directions that enclose all deviators well


def circle(sides: int, fit: Fit) -> Floats:
    """Directions (sides, 4) whose largest product with a stress stands for r.

    The first takes (xx - yy) / 2; equally spaced, so that the mirror images of x and y are there.
    """
    angle = 2 * np.pi * np.arange(sides) / sides
    zero = np.zeros(sides)
    unit = np.stack([np.cos(angle) / 2, -np.cos(angle) / 2, zero, np.sin(angle)], axis=1)
    return np.asarray(unit / polygon_shrinkage(sides, fit))


def angle_names(sides: int) -> list[str]:
    """Directions of the larger stress, from x towards y, of the planes of `circle`."""
    return [f"{180 * n / sides:g} deg" for n in range(sides)]


def products(a: Floats, b: Floats) -> Floats:
    """What takes a^T sigma b from the six components of a stress: (..., 6) from (..., 3) twice."""
    shear = [a[..., i] * b[..., j] + a[..., j] * b[..., i] for i, j in ((0, 1), (1, 2), (0, 2))]
    return np.concatenate([a * b, np.stack(shear, axis=-1)], axis=-1)


def cut_off(limit: Dual, point: ParameterPoint, n_strain: int, count: int, fit: Fit) -> YieldPlanes:
    """The planes that limit principal stresses.

    Args:
        limit: T, Pa.
        point: for numbers that depend on nothing.
        n_strain: 4 or 6.
        count: sides of the polygon of a section, or least number of directions in a solid.
        fit: how they lie.
    """
    normals = _in_section(count, fit) if n_strain < 6 else _in_solid(count, fit)
    names = tuple(f"tension {n}" for n in range(1, 1 + len(normals)))
    if n_strain < 6:
        names = (*(f"tension {angle}" for angle in angle_names(count)), "tension axial")
    distances = Dual(np.repeat(limit.columns[None], len(normals), axis=0))
    return YieldPlanes(point.constant(normals), distances, names=names)


def _in_section(sides: int, fit: Fit) -> Floats:
    return np.concatenate([MEAN + circle(sides, fit), AXIAL[None]])


@lru_cache(maxsize=32)
def _in_solid(count: int, fit: Fit) -> Floats:
    both = spread_directions(2 * max(count, _FEWEST))
    half = both[_upper(both)]
    deviators = products(half, half) - PRESSURE
    kappa = shrinkage(fit, deviators, lambda x: principal_deviators(x)[0])
    return PRESSURE + deviators / kappa


def _upper(vectors: Floats) -> Floats:
    """Which of vectors and their opposites to keep: the first component that counts is positive."""
    signs = np.where(np.abs(vectors) > 1e-9, np.sign(vectors), 0.0)
    return np.asarray(signs @ np.array([9.0, 3.0, 1.0]) > 0)


_PAIRS = ((0, 1), (1, 0), (0, 2), (2, 0), (1, 2), (2, 1))
_SINES = (0.0, 0.125, 0.25, 0.375, 0.5, 0.75, 0.95)
"""Sines of the friction angle, 0 to 72 degrees, at which the smallest ratio is looked for."""

_BETWEEN_SINES = 0.995  # what the smallest ratio may fall between those


def mohr_coulomb(surface: MohrCoulomb, point: ParameterPoint, n_strain: int) -> YieldPlanes:
    """Mohr-Coulomb as a polyhedron, with its cut-off of tension.

    Args:
        surface: by planes, as the case states it.
        point: the parameters.
        n_strain: number s of strain components.
    """
    assert surface.planes is not None
    count = surface.planes if n_strain < 6 else ceil(surface.planes / 6)
    parts = [(_section if n_strain < 6 else _solid)(surface, point, count)]
    if surface.tension is not None:
        limit = point.number(surface.tension)
        parts.append(cut_off(limit, point, n_strain, count, surface.fit))
    return common_inside(parts).of_unit_length()


def _section(surface: MohrCoulomb, point: ParameterPoint, sides: int) -> YieldPlanes:
    S, one = point.number(surface.friction).sine(), point.constant(1.0)
    round_ = circle(sides, surface.fit)
    normals = [
        S * (2 * MEAN) + one * (2 * round_),
        (one + S) * (MEAN + round_) - (one - S) * AXIAL,
        (one + S) * AXIAL - (one - S) * (MEAN - round_),
    ]
    families = ("shear", "shear, axial compression", "shear, axial tension")
    names = tuple(f"{family} {angle}" for family in families for angle in angle_names(sides))
    distances = Dual(np.repeat(_strength(surface, point).columns, len(names), axis=0))
    return YieldPlanes(joined(normals), distances, names=names)


def _solid(surface: MohrCoulomb, point: ParameterPoint, count: int) -> YieldPlanes:
    """2 S p + D^T sigma / kappa <= 2 c cos phi, with p the mean stress and D the pairs' deviator.

    D = (1 + S) a a^T - (1 - S) b b^T - 2 S / 3 I, linear in S.
    """
    S = point.number(surface.friction).sine()
    difference, total = _pair_deviators(count)
    kappa = _solid_shrinkage(count, surface.fit)
    normals = S * (2 * PRESSURE) + (S * total + point.constant(difference)) / kappa
    names = tuple(f"shear {n}" for n in range(1, 1 + len(difference)))
    distances = Dual(np.repeat(_strength(surface, point).columns, len(names), axis=0))
    return YieldPlanes(normals, distances, names=names)


def _pair_deviators(count: int) -> tuple[Floats, Floats]:
    """Deviators of a a^T - b b^T and of a a^T + b b^T, (y, 6) each."""
    axes = spread_frames(count).transpose(0, 2, 1)
    first = products(axes, axes)[:, [a for a, _ in _PAIRS]].reshape(-1, 6)
    second = products(axes, axes)[:, [b for _, b in _PAIRS]].reshape(-1, 6)
    return first - second, first + second - 2 * PRESSURE


@lru_cache(maxsize=32)
def _solid_shrinkage(count: int, fit: Fit) -> float:
    """The factor kappa for all angles of friction: it hardly changes with them (1 or 2 %)."""
    difference, total = _pair_deviators(count)

    def kappa(S: float) -> float:
        def borne(deviators: Floats) -> Floats:
            high, _, low = principal_deviators(deviators)
            return np.asarray((1 + S) * high - (1 - S) * low)

        return shrinkage(fit, difference + S * total, borne)

    if fit == "inscribed":
        return _BETWEEN_SINES * min(kappa(S) for S in _SINES)
    return kappa(0.5)


def _strength(surface: MohrCoulomb, point: ParameterPoint) -> Dual:
    """2 c cos phi, (1,)."""
    return stacked([point.number(surface.cohesion) * point.number(surface.friction).cosine() * 2.0])


def _wedge(S: Dual) -> Dual:
    """(1 + S, 0, -(1 - S)), (1, 3)."""
    return S * np.array([[1.0, 0.0, 1.0]]) + np.array([[1.0, 0.0, -1.0]])


def exact_mohr_coulomb(surface: MohrCoulomb, point: ParameterPoint) -> YieldPlanes:
    """Its plane for principal stresses in descending order; the others are its mirror images.

    The flow has the angle of dilation in place of that of friction.
    """
    friction = point.number(surface.friction)
    dilation = friction if surface.dilation is None else point.number(surface.dilation)
    cone = YieldPlanes(
        _wedge(friction.sine()),
        _strength(surface, point),
        None if surface.dilation is None else _wedge(dilation.sine()),
        names=("shear",),
    )
    if surface.tension is None:
        return cone.of_unit_length()
    cut = point.constant(np.array([[1.0, 0.0, 0.0]]))
    return YieldPlanes(
        joined([cone.normals, cut]),
        stacked([cone.distances[0], point.number(surface.tension)]),
        None if cone.flow is None else joined([cone.flow, cut]),
        names=("shear", "tension"),
    ).of_unit_length()

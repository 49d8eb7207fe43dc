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
"""

from __future__ import annotations

import numpy as np

from geoident.forward.facets import Facets, joined, stacked
from geoident.forward.jets import Jet, Point
from geoident.model.arrays import Floats
from geoident.model.yields import Fit, GivenPlanes, MohrCoulomb

_COMPONENTS = {4: [0, 1, 2, 3], 6: [0, 1, 2, 3, 4, 5]}
_MEAN = np.array([0.5, 0.5, 0.0, 0.0])
_AXIAL = np.array([0.0, 0.0, 1.0, 0.0])


def polygon_shrinkage(sides: int, fit: Fit) -> float:
    """The factor kappa of a regular polygon in place of a circle."""
    half = np.pi / sides
    return float(
        {"circumscribed": 1.0, "inscribed": np.cos(half), "best": np.sin(half) / half}[fit]
    )


def given_planes(surface: GivenPlanes, point: Point, n_strain: int) -> Facets:
    """The planes of a case, cut to the components of the analysis."""
    normals = np.array([plane.normal for plane in surface.planes])[:, _COMPONENTS[n_strain]]
    distances = stacked([point.jet(plane.distance) for plane in surface.planes])
    hardening = Jet(np.repeat(point.jet(surface.hardening).columns[None], len(normals), axis=0))
    still = not hardening.columns.any()
    names = tuple(plane.name for plane in surface.planes)
    return Facets(names, point.given(normals), distances, hardening=None if still else hardening)


def sine(angle: Jet) -> Jet:
    """Its sine."""
    return angle.through(np.sin, np.cos)


def cosine(angle: Jet) -> Jet:
    """Its cosine."""
    return angle.through(np.cos, lambda x: -np.sin(x))


def mohr_coulomb(surface: MohrCoulomb, point: Point, n_strain: int) -> Facets:
    """Mohr-Coulomb as a polyhedron, with its cut-off of tension."""
    parts = [_section_shear(surface, point)]
    if surface.tension is not None:
        parts.append(_section_tension(surface, point.jet(surface.tension), point))
    return joined(parts).scaled()


def _section_shear(surface: MohrCoulomb, point: Point) -> Facets:
    S, one = sine(point.jet(surface.friction)), point.given(1.0)
    circle = _circle(_sides(surface), surface.fit)
    normals = [
        S * (2 * _MEAN) + one * (2 * circle),
        (one + S) * (_MEAN + circle) - (one - S) * _AXIAL,
        (one + S) * _AXIAL - (one - S) * (_MEAN - circle),
    ]
    names = [
        f"{family} {angle}"
        for family in ("in plane", "plane-axial", "axial-plane")
        for angle in _angles(len(circle))
    ]
    strength = _strength(surface, point).columns
    distances = Jet(np.repeat(strength, len(names), axis=0))
    return Facets(tuple(names), Jet(np.concatenate([n.columns for n in normals])), distances)


def _section_tension(surface: MohrCoulomb, limit: Jet, point: Point) -> Facets:
    circle = _circle(_sides(surface), surface.fit)
    normals = np.concatenate([_MEAN + circle, _AXIAL[None]])
    names = (*(f"tension {angle}" for angle in _angles(len(circle))), "axial tension")
    distances = Jet(np.repeat(limit.columns[None], len(names), axis=0))
    return Facets(names, point.given(normals), distances)


def _sides(surface: MohrCoulomb) -> int:
    if surface.planes is None:
        raise ValueError("the smooth surface has no polyhedron")
    return surface.planes


def _circle(sides: int, fit: Fit) -> Floats:
    """Directions (sides, 4) whose largest product with a stress stands for r.

    The first takes (xx - yy) / 2; equally spaced, so that the mirror images of x and y are there.
    """
    angle = 2 * np.pi * np.arange(sides) / sides
    zero = np.zeros(sides)
    unit = np.stack([np.cos(angle) / 2, -np.cos(angle) / 2, zero, np.sin(angle)], axis=1)
    return np.asarray(unit / polygon_shrinkage(sides, fit))


def _angles(sides: int) -> list[str]:
    """Directions of the larger stress of the pairs, from x towards y."""
    return [f"{180 * n / sides:g} deg" for n in range(sides)]


def _strength(surface: MohrCoulomb, point: Point) -> Jet:
    """2 c cos phi, (1,)."""
    return stacked([point.jet(surface.cohesion) * cosine(point.jet(surface.friction)) * 2.0])


def _wedge(S: Jet) -> Jet:
    """(1 + S, 0, -(1 - S)), (1, 3)."""
    return S * np.array([[1.0, 0.0, 1.0]]) + np.array([[1.0, 0.0, -1.0]])


def smooth_mohr_coulomb(surface: MohrCoulomb, point: Point) -> Facets:
    """Its plane for principal stresses in descending order; the others are its mirror images.

    The flow has the angle of dilation in place of that of friction.
    """
    friction = point.jet(surface.friction)
    dilation = friction if surface.dilation is None else point.jet(surface.dilation)
    cone = Facets(
        ("shear",),
        _wedge(sine(friction)),
        _strength(surface, point),
        None if surface.dilation is None else _wedge(sine(dilation)),
    )
    if surface.tension is None:
        return cone.scaled()
    cut = point.given(np.array([[1.0, 0.0, 0.0]]))
    normals = Jet(np.concatenate([cone.normals.columns, cut.columns]))
    distances = stacked([cone.distances[0], point.jet(surface.tension)])
    flow = None if cone.flow is None else Jet(np.concatenate([cone.flow.columns, cut.columns]))
    return Facets((*cone.names, "tension"), normals, distances, flow).scaled()

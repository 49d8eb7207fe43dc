"""Faceted cones: Drucker-Prager's, and Coulomb's on the planes of strata and joints.

Drucker and Prager (1952, Soil mechanics and plastic analysis or limit design, Quart. Appl. Math.
10): alpha I1 + sqrt(J2) <= k, with alpha and k from Mohr-Coulomb's c and phi

    outer         alpha = 2 sin phi / (sqrt3 (3 - sin phi)), k = alpha 3 c / tan phi
    inner         alpha = 2 sin phi / (sqrt3 (3 + sin phi)), k = alpha 3 c / tan phi
    plane strain  alpha = tan phi / sqrt(9 + 12 tan^2 phi),  k = 3 c / sqrt(9 + 12 tan^2 phi)

(W. F. Chen and E. Mizuno, 1990, Nonlinear Analysis in Soil Mechanics, chapter 3.) sqrt(J2) is
1 / sqrt2 of the deviator's length, in a space of three dimensions in a section and of five in a
solid; facets touch the sphere in directions that are spread evenly.
"""

from __future__ import annotations

from functools import lru_cache
from math import sqrt
from typing import Literal

import numpy as np

from geoident.fem.rotation import turn_of_attitude, turn_of_axes
from geoident.forward.yielding.even_directions import spread_deviators
from geoident.forward.yielding.mohr_coulomb import cosine, sine
from geoident.forward.yielding.planes import Facets, joined
from geoident.forward.yielding.smooth_distance import deviator_basis, polygon_shrinkage, shrinkage
from geoident.forward.yielding.tension import cut_off
from geoident.model.arrays import Floats
from geoident.model.dual import Jet, Point
from geoident.model.ground import Axes, Frame
from geoident.model.yielding import DruckerPrager, Fit, WeakPlane


def drucker_prager(surface: DruckerPrager, point: Point, n_strain: int) -> Facets:
    """Drucker-Prager's cone with facets, and its cut-off of tension."""
    alpha, k = cone(surface, point)
    deviators = _facets_of_sphere(surface.planes, n_strain, surface.fit)
    trace = np.zeros(n_strain)
    trace[:3] = 1.0
    normals = alpha * trace + point.given(deviators / sqrt(2.0))
    names = tuple(f"shear {n}" for n in range(1, 1 + len(deviators)))
    distances = Jet(np.repeat(k.columns[None], len(names), axis=0))
    parts = [Facets(names, normals, distances)]
    if surface.tension is not None:
        count = cut_off_count(surface.planes, n_strain)
        limit = point.jet(surface.tension)
        parts.append(cut_off(limit, point, n_strain, count, surface.fit))
    return joined(parts).scaled()


def cut_off_count(planes: int, n_strain: int) -> int:
    """Sides or directions of the cut-off of a cone with some facets."""
    return max(4, 2 * (planes // 4)) if n_strain < 6 else planes // 6


def cone(surface: DruckerPrager, point: Point) -> tuple[Jet, Jet]:
    """Its alpha and k."""
    angle = point.jet(surface.friction)
    S, C, c = sine(angle), cosine(angle), point.jet(surface.cohesion)
    width = _width(surface.match, S)
    return S / width, c * C * 3.0 / width


def _width(match: Literal["outer", "inner", "plane-strain"], S: Jet) -> Jet:
    """S / alpha: sqrt3 / 2 (3 -+ S), or sqrt(9 + 3 S^2), which is cos phi sqrt(9 + 12 tan^2)."""
    if match == "plane-strain":
        return (9.0 + S * S * 3.0).through(np.sqrt, lambda x: 0.5 / np.sqrt(x))
    return (3.0 - S if match == "outer" else 3.0 + S) * (sqrt(3.0) / 2)


@lru_cache(maxsize=32)
def _facets_of_sphere(count: int, n_strain: int, fit: Fit) -> Floats:
    """Deviators (y, n_strain) whose largest product with a stress stands for its length."""
    facets = spread_deviators(count, n_strain) @ deviator_basis(n_strain)
    return facets / shrinkage(fit, facets, lambda x: np.linalg.norm(x, axis=1))


def weak_plane(surface: WeakPlane, point: Point, n_strain: int) -> Facets:
    """Coulomb on planes of one orientation: |tau| cos phi + sigma_n sin phi <= c cos phi.

    In a section the planes stand on it, and two facets are exact. In a solid tau has two
    components, and a polygon of the same size on average takes the place of the circle.
    """
    angle = point.jet(surface.friction)
    S, C = sine(angle), cosine(angle)
    normal, slides = _directions(surface, point, n_strain)
    pressing = _traction(normal, normal, n_strain)
    facets = [(S * pressing + C * _traction(normal, slide, n_strain)).columns for slide in slides]
    distances = [(C * point.jet(surface.cohesion)).columns] * len(facets)
    names = [f"slip {n}" for n in range(1, 1 + len(slides))]
    if surface.tension is not None:
        facets.append(pressing.columns)
        distances.append(point.jet(surface.tension).columns)
        names.append("opening")
    return Facets(tuple(names), Jet(np.stack(facets)), Jet(np.stack(distances))).scaled()


def _directions(surface: WeakPlane, point: Point, n_strain: int) -> tuple[Jet, list[Jet]]:
    """The normal (3,), and the directions of sliding (3,), longer where a polygon is shrunk."""
    section = n_strain < 6
    axes = frame_jet(surface.frame, point, section=section)
    first, second, normal = (Jet(axes.columns[:, k]) for k in range(3))
    if section:
        x, y = normal[0], normal[1]
        along = Jet(np.stack([-y.columns, x.columns, np.zeros_like(x.columns)]))
        return normal, [along, -along]
    turns = 2 * np.pi * np.arange(surface.planes) / surface.planes
    longer = 1 / polygon_shrinkage(surface.planes, "best")
    pairs = longer * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    return normal, [first * a + second * b for a, b in pairs]


def frame_jet(frame: Frame, point: Point, *, section: bool) -> Jet:
    """Material axes as columns (3, 3), with derivatives by the angles that give them."""
    if isinstance(frame, Axes):
        return point.given(turn_of_axes(np.array(frame.first), np.array(frame.second)).matrix)
    angles = {
        "dip": point.jet(frame.dip),
        "dip_direction": point.jet(frame.dip_direction),
        "rotation": point.jet(frame.rotation),
    }
    turn = turn_of_attitude(**{k: float(a.value) for k, a in angles.items()}, section=section)
    columns = point.given(turn.matrix).columns
    for name, angle in angles.items():
        columns[..., 1:] += turn.slopes[name][..., None] * angle.columns[1:]
    return Jet(columns)


def _traction(a: Jet, b: Jet, n_strain: int) -> Jet:
    """What takes a^T sigma b from the components of a stress, (n_strain,)."""
    straight = [a[i] * b[i] for i in range(3)]
    shear = [a[i] * b[j] + a[j] * b[i] for i, j in ((0, 1), (1, 2), (0, 2))]
    return Jet(np.stack([jet.columns for jet in [*straight, *shear]])[:n_strain])

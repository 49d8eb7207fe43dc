"""Planes of a yield surface together with their derivatives by the parameters.

Facets of several surfaces join to one polyhedron. Normals end with unit length (theory 5): a plane
and its distance are divided by the length of the normal, which may depend on parameters as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoident.fem.yielding.law import LawSlopes, Planes
from geoident.model.arrays import Floats
from geoident.model.dual import Jet


@dataclass(frozen=True)
class Facets:
    """Yield planes n^T sigma <= k with their derivatives.

    Args:
        names: of the y planes, for outputs.
        normals: n, (y, s).
        distances: k, (y,), Pa.
        flow: m, (y, s) directions of plastic strain; None: the normals (associated).
        hardening: (y,) growth of k by the plane's own multiplier, Pa; None: none.
    """

    names: tuple[str, ...]
    normals: Jet
    distances: Jet
    flow: Jet | None = None
    hardening: Jet | None = None

    def scaled(self) -> Facets:
        """The same planes with normals of unit length; the flow keeps its angle to them."""
        shrink = _length(self.normals).reciprocal()
        rows = Jet(shrink.columns[:, None])
        flow = None if self.flow is None else self.flow * rows
        hardening = None if self.hardening is None else self.hardening * shrink * shrink
        return Facets(self.names, self.normals * rows, self.distances * shrink, flow, hardening)

    def planes(self) -> Planes:
        """The numbers."""
        flow = None if self.flow is None else self.flow.value
        hardening = None if self.hardening is None else np.diag(self.hardening.value)
        return Planes(self.normals.value, self.distances.value, flow, hardening)

    def slopes(self, column: int) -> LawSlopes:
        """Derivatives by the parameter of one column (from 0)."""
        hardening = _slope(self.hardening, column)
        return LawSlopes(
            normals=_slope(self.normals, column),
            distances=_slope(self.distances, column),
            flow=_slope(self.flow, column),
            hardening=None if hardening is None else np.diag(hardening),
        )


def joined(parts: Sequence[Facets]) -> Facets:
    """One polyhedron that lies inside several; none of them may have a flow of its own."""
    names = tuple(name for part in parts for name in part.names)
    normals = Jet(np.concatenate([part.normals.columns for part in parts]))
    distances = Jet(np.concatenate([part.distances.columns for part in parts]))
    if all(part.hardening is None for part in parts):
        return Facets(names, normals, distances)
    still = [np.zeros_like(part.distances.columns) for part in parts]
    hardening = [
        none if part.hardening is None else part.hardening.columns
        for part, none in zip(parts, still, strict=True)
    ]
    return Facets(names, normals, distances, hardening=Jet(np.concatenate(hardening)))


def stacked(jets: Sequence[Jet]) -> Jet:
    """Numbers as one array (len(jets),)."""
    return Jet(np.stack([jet.columns for jet in jets]))


def _length(vectors: Jet) -> Jet:
    squares = Jet((vectors * vectors).columns.sum(axis=1))
    return squares.through(np.sqrt, lambda x: 0.5 / np.sqrt(x))


def _slope(jet: Jet | None, column: int) -> Floats | None:
    """The derivative, or None where it is zero throughout."""
    if jet is None:
        return None
    slope = np.ascontiguousarray(jet.columns[..., 1 + column])
    return slope if slope.any() else None

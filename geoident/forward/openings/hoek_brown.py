"""The limit of Hoek and Brown around a circular opening (theory 4.6).

sigma_t = sigma_r + sigci (mb sigma_r / sigci + s)^a, compression positive. With
P = mb sigma_r / sigci + s equilibrium is dP / d ln r = mb P^a, so for any a, in radii inwards from
P_o by l = ln(r_o / r),

    P^(1-a) = P_o^(1-a) - (1 - a) mb l

(C. Carranza-Torres & C. Fairhurst, The elasto-plastic response of underground excavations in rock
masses that satisfy the Hoek-Brown failure criterion, Int. J. Rock Mech. Min. Sci. 36, 1999, for
a = 0.5; Carranza-Torres, Elasto-plastic solution of tunnel problems using the generalized form of
the Hoek-Brown failure criterion, ibid. 41, 2004). Their displacements take the elastic strains of
the plastic zone as those of its edge or leave them out; here all are counted, and sigma_z where it
meets sigma_t (step 3 of `closed_forms`). The integral has no closed form then, and is smooth: Gauss
and Legendre's rule gives it to rounding.

The edge of the plastic zone, and the place where sigma_z meets sigma_t, are roots of convex
functions of sigma_r; their derivatives are those of an implicit function.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.forward.openings.closed_forms import (
    NO_EQUILIBRIUM,
    BeyondClosedForm,
    PlasticZone,
    Rock,
    WallLimit,
)
from geoident.model.dual import Dual, Number

EXPANDED = "the wall yields in expansion, for which there is no closed form of Hoek and Brown"

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(24)
_PLACES, _SIZES = 0.5 * (_POINTS + 1.0), 0.5 * _WEIGHTS
"""Gauss points and weights of the interval from 0 to 1."""

_EXACT = 4.0 * np.finfo(np.float64).eps
"""Relative tolerance of roots: the smallest that the method of Brent takes."""


@dataclass(frozen=True)
class HoekBrownLimit(WallLimit):
    """Hoek-Brown's limit in the direction of contraction.

    Args:
        sigci: uniaxial strength of intact rock, Pa.
        mb: slope.
        s: of the rock mass, 0 to 1.
        a: exponent, less than 1.
        K: the slope of the flow, eps_r^p = -K eps_t^p.
    """

    sigci: Dual
    mb: Dual
    s: Dual
    a: Dual
    K: Dual

    @property
    def reversed(self) -> WallLimit:
        """None: expansion has no closed form.

        Raises:
            BeyondClosedForm: always.
        """
        raise BeyondClosedForm(EXPANDED)

    def difference(self, radial: Number) -> Dual:
        """Q = sigci P^a; 0 where the rock mass is torn."""
        scaled = self._scaled(radial)
        if np.any(scaled.value <= 0.0):
            return 0.0 * (self.sigci + radial)
        return self.sigci * scaled.power(self.a)

    def critical(self, pressure: Dual) -> Dual:
        """The root of 2 sigma_r + Q = 2 p0.

        Raises:
            BeyondClosedForm: p0 tears the rock mass.
        """
        torn, one = -self.s * self.sigci / self.mb, 0.0 * pressure + 1.0
        radial = self._root(-2.0 * pressure, 2.0 * one, one, torn, pressure)
        if radial is None:
            raise BeyondClosedForm(NO_EQUILIBRIUM)
        return radial

    def way(self, inner: Dual, outer: Dual) -> Dual:
        """(P_o^(1-a) - P_i^(1-a)) / ((1 - a) mb)."""
        left = 1.0 - self.a
        rise = self._scaled(outer).power(left) - self._scaled(inner).power(left)
        return rise / (left * self.mb)

    def inwards(self, radial: Dual, way: Dual) -> Dual:
        """By P^(1-a) = P_o^(1-a) - (1 - a) mb l."""
        left = 1.0 - self.a
        scaled = (self._scaled(radial).power(left) - left * self.mb * way).power(1.0 / left)
        return (scaled - self.s) * self.sigci / self.mb

    def integral(self, zone: PlasticZone, way: Dual) -> Dual:
        """By Gauss and Legendre's rule over ways (...)."""
        steps = Dual(np.expand_dims(way.columns, -2)).times(_PLACES)
        terms = (-(self.K + 1.0) * steps).exp() * zone.source(self.inwards(zone.radial, steps))
        return way * Dual(terms.times(_SIZES).columns.sum(axis=-2))

    def meets_axial(self, rock: Rock, pressure: Dual, edge: Dual) -> Dual | None:
        """The root of z0 - 2 nu p0 + nu sigma_r = (1 - nu) (sigma_r + Q)."""
        nu = rock.nu
        constant = rock.out_of_plane - 2.0 * nu * rock.pressure
        return self._root(constant, 2.0 * nu - 1.0, nu - 1.0, pressure, edge)

    def _root(
        self, constant: Dual, slope: Dual, factor: Dual, low: Dual, high: Dual
    ) -> Dual | None:
        """sigma_r between two at which constant + slope sigma_r + factor Q = 0, or None."""
        from scipy.optimize import brentq  # noqa: PLC0415 - 0.2 s, and most cases have no such root

        c, b, f, sigci, mb, s, a = (
            float(number.value)
            for number in (constant, slope, factor, self.sigci, self.mb, self.s, self.a)
        )

        def value(radial: float) -> float:
            return float(c + b * radial + f * sigci * max(mb * radial / sigci + s, 0.0) ** a)

        ends = float(low.value), float(high.value)
        if value(ends[0]) * value(ends[1]) >= 0.0:
            return None
        root = float(brentq(value, *ends, xtol=_EXACT * max(map(abs, ends)), rtol=_EXACT))
        off = constant + slope * root + factor * self.difference(root)
        rise = b + f * a * mb * (mb * root / sigci + s) ** (a - 1.0)
        return Dual(np.append(root, -off.columns[1:] / rise))  # of an implicit function

    def _scaled(self, radial: Number) -> Dual:
        """P = mb sigma_r / sigci + s."""
        return self.mb * radial / self.sigci + self.s

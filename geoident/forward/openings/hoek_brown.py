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

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geoident.forward.openings.closed_forms import BeyondClosedForm, PlasticZone, Rock, WallLimit
from geoident.model.dual import Dual, Number

EXPANDED = "the wall yields in expansion, for which there is no closed form of Hoek and Brown"

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(24)
_PLACES, _SIZES = 0.5 * (_POINTS + 1.0), 0.5 * _WEIGHTS
"""Gauss points and weights of the interval from 0 to 1."""

_EXACT = 4.0 * np.finfo(np.float64).eps


@dataclass(frozen=True)
class HoekBrownLimit:
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
        """The same limit for expansion: only where that begins is known."""
        return _Expansion(self.sigci, self.mb, self.s, self.a, self.K)

    def hoop(self, radial: Number) -> Dual:
        """sigma_t at the limit."""
        return radial + self.difference(radial)

    def difference(self, radial: Number) -> Dual:
        """Q = sigma_t - sigma_r at the limit; 0 where the rock mass is torn."""
        scaled = self._scaled(radial)
        if np.any(scaled.value <= 0.0):
            return 0.0 * (self.sigci + radial)
        return self.sigci * scaled.power(self.a)

    def critical(self, pressure: Dual) -> Dual:
        """sigma_R, the inner pressure at which the wall begins to yield: sigma_R + sigma_t = 2 p0.

        Args:
            pressure: p0, Pa.
        """
        far = float(pressure.value)
        return _root(
            lambda radial: 2.0 * (radial - far) + self._height(radial),
            lambda radial: radial + self.hoop(radial) - 2.0 * pressure,
            lambda radial: 2.0 + self._rise(radial),
            (float(self.tension_limit.value), far),
        )

    @property
    def tension_limit(self) -> Dual:
        """sigma_r below which the rock mass is torn, -s sigci / mb, Pa."""
        return -self.s * self.sigci / self.mb

    def way(self, inner: Dual, outer: Dual) -> Dual:
        """Logarithm of the ratio of the radii at which sigma_r has two values."""
        left = 1.0 - self.a
        return (self._scaled(outer).power(left) - self._scaled(inner).power(left)) / (
            left * self.mb
        )

    def inwards(self, radial: Dual, way: Dual) -> Dual:
        """sigma_r further in by ln(r_o / r), the ``way``."""
        left = 1.0 - self.a
        scaled = (self._scaled(radial).power(left) - left * self.mb * way).power(1.0 / left)
        return (scaled - self.s) * self.sigci / self.mb

    def integral(self, zone: PlasticZone, way: Dual) -> Dual:
        """Integral over t = 0..l of e^(-(K+1) t) g(t), inwards from the edge of a zone.

        Args:
            zone: the zone.
            way: l, (...).
        """
        steps = Dual(np.expand_dims(way.columns, -2)).times(_PLACES)
        terms = (-(self.K + 1.0) * steps).exp() * zone.source(self.inwards(zone.radial, steps))
        return way * Dual(terms.times(_SIZES).columns.sum(axis=-2))

    def meets_axial(self, rock: Rock, pressure: Dual, critical: Dual) -> Dual | None:
        """sigma_r between two at which sigma_z meets sigma_t, or None.

        Args:
            rock: the ground.
            pressure: at the wall.
            critical: at the edge of the plastic zone.
        """
        nu, z0 = rock.nu, rock.out_of_plane - 2.0 * rock.nu * rock.pressure
        part, least = float(nu.value), float(z0.value)

        def value(radial: float) -> float:
            hoop = radial + self._height(radial)
            return least + part * radial - (1.0 - part) * hoop

        low, high = float(pressure.value), float(critical.value)
        if value(low) * value(high) >= 0.0:
            return None
        return _root(
            value,
            lambda radial: z0 + nu * radial - (1.0 - nu) * self.hoop(radial),
            lambda radial: part - (1.0 - part) * (1.0 + self._rise(radial)),
            (low, high),
        )

    def _height(self, radial: float) -> float:
        """Q, without derivatives."""
        sigci, mb, s, a = self._numbers
        return float(sigci * max(mb * radial / sigci + s, 0.0) ** a)

    def _rise(self, radial: float) -> float:
        """Slope of Q by sigma_r."""
        sigci, mb, s, a = self._numbers
        return float(a * mb * (mb * radial / sigci + s) ** (a - 1.0))

    @property
    def _numbers(self) -> tuple[float, float, float, float]:
        sigci, mb, s, a = (float(number.value) for number in (self.sigci, self.mb, self.s, self.a))
        return sigci, mb, s, a

    def _scaled(self, radial: Number) -> Dual:
        """P = mb sigma_r / sigci + s."""
        return self.mb * radial / self.sigci + self.s


class _Expansion(HoekBrownLimit):
    """Expansion: sigma_r is the largest stress, sigma_r = sigma_t + Q(sigma_t)."""

    def critical(self, pressure: Dual) -> Dual:
        """The inner pressure at which it begins: that of contraction at the other stress."""
        return 2.0 * pressure - HoekBrownLimit.critical(self, pressure)

    def way(self, inner: Dual, outer: Dual) -> Dual:
        """None is known.

        Raises:
            BeyondClosedForm: always.
        """
        raise BeyondClosedForm(EXPANDED)


def _root(
    value: Callable[[float], float],
    function: Callable[[float], Dual],
    slope: Callable[[float], float],
    between: tuple[float, float],
) -> Dual:
    """Where a function is zero, with its derivatives.

    Args:
        value: the function of a place.
        function: the same with derivatives.
        slope: of the function by the place.
        between: two places where it has different signs.
    """
    from scipy.optimize import brentq  # noqa: PLC0415 - 0.2 s, and most cases have no such root

    found = float(brentq(value, *between, xtol=_EXACT * max(map(abs, between)), rtol=_EXACT))
    off = function(found).columns
    return Dual(np.append(found, -off[1:] / slope(found)))

"""Closed form of a deep circular opening in ground of Hoek and Brown (theory 4.6).

Signs and the other zones are those of `closed_forms`. With sigma_t = sigma_r + sigci y^a, where
y = mb sigma_r / sigci + s, equilibrium d sigma_r / d ln r = sigci y^a integrates for every a:

    w = y^(1-a) = w_a + (1 - a) mb ln(r / a) ,

so the plastic radius is R = a exp((w_R - w_a) / ((1 - a) mb)), and sigma_R follows from
2 (p0 - sigma_R) = sigci y^a. For a = 1/2: C. Carranza-Torres and C. Fairhurst (1999), The
elasto-plastic response of underground excavations in rock masses that satisfy the Hoek-Brown
failure criterion, Int. J. Rock Mech. Min. Sci. 36; for all a: S. K. Sharan (2008), Int. J. Rock
Mech. Min. Sci. 45. The flow has a constant dilation, so that

    u(r) = r^-K (R^K u_R + integral from r to R of x^K g(x) dx) ,

with the elastic strains g of the plastic zone, which is smooth in ln x: Gauss's rule gives it to
rounding. Where sigma_z meets sigma_t both flow, as in Mohr-Coulomb's ground.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from geoident.forward.openings.closed_forms import (
    OUT_OF_PLANE,
    BeyondClosedForm,
    Opening,
    YieldedState,
    flow_slope,
    lame,
)
from geoident.model.arrays import Floats
from geoident.model.dual import Dual

EXPANDS = "the wall is pressed outwards beyond its strength, for which there is no closed form"
TORN = "the wall is torn by tension, for which there is no closed form"

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)


@dataclass(frozen=True)
class HoekBrownLimit:
    """The limit of Hoek and Brown with a constant dilation.

    Args:
        sigci: strength of intact rock, Pa.
        mb: constant of the rock mass.
        s: constant of the rock mass.
        a: exponent.
        dilation: psi, rad.
    """

    sigci: Dual
    mb: Dual
    s: Dual
    a: Dual
    dilation: Dual

    @property
    def K(self) -> Dual:  # noqa: N802
        """The slope of the flow."""
        return flow_slope(self.dilation)

    def y(self, radial: Dual) -> Dual:
        """Of sigma_r, at least the smallest positive number."""
        y = self.mb * radial / self.sigci + self.s
        return Dual(np.where(y.columns[..., :1] > _TINY, y.columns, _tiny(y)))

    def difference(self, radial: Dual) -> Dual:
        """Q = sigma_t - sigma_r at the limit."""
        return self.sigci * self.y(radial).power(self.a)

    def hoop(self, radial: Dual) -> Dual:
        """The sigma_t at the limit."""
        return radial + self.difference(radial)

    def steepness(self, radial: Dual) -> float:
        """DQ / d sigma_r."""
        a = float(self.a.value)
        return float(self.mb.value * a * self.y(radial).value ** (a - 1.0))

    @property
    def tip(self) -> Dual:
        """-s sigci / mb, the least sigma_r, Pa."""
        return -(self.s * self.sigci / self.mb)

    def bounds(self, pressure: Dual) -> tuple[Dual, Dual]:
        """Inner pressures below and above which the wall yields, Pa.

        Raises:
            BeyondClosedForm: the ground is torn before there is an opening.
        """
        if pressure.value < self.tip.value:
            raise BeyondClosedForm(TORN)
        twice = 2.0 * pressure

        def left(radial: Dual) -> Dual:
            return twice - 2.0 * radial - self.difference(radial)

        below = _root(left, self.tip, pressure, lambda x: -2.0 - self.steepness(x))
        return below, twice - below  # expansion: sigma_t takes the place of sigma_r

    def yielded(self, opening: Opening, pressure: Dual, *, expands: bool) -> YieldedState:
        """The ground beyond a bound.

        Args:
            opening: the opening.
            pressure: inside, Pa.
            expands: whether it is the upper bound, where there is no closed form.

        Raises:
            BeyondClosedForm: it expands, is torn, or yields out of the plane.
        """
        if expands:
            raise BeyondClosedForm(EXPANDS)
        return HoekBrownState(opening, pressure, self)


_TINY = 1e-200


def _tiny(like: Dual) -> Floats:
    columns = np.zeros_like(like.columns)
    columns[..., 0] = _TINY
    return columns


def _root(
    function: Callable[[Dual], Dual], low: Dual, high: Dual, slope: Callable[[Dual], float]
) -> Dual:
    """The root between two ends, with the derivatives of an implicit function."""
    from scipy.optimize import brentq  # 0.4 s to import  # noqa: PLC0415

    def value(x: float) -> float:
        return float(function(low * 0.0 + x).value)

    ends = float(low.value), float(high.value)
    x = float(brentq(value, *ends, xtol=1e-14 * max(map(abs, ends)), rtol=1e-15))
    at = low * 0.0 + x
    columns = -function(at).columns / slope(at)
    columns[0] += x
    return Dual(columns)


class HoekBrownState(YieldedState):
    """The ground around a wall that yields inwards.

    Args:
        opening: radius and ground.
        pressure: inside, Pa.
        limit: of the ground.

    Raises:
        BeyondClosedForm: the wall is torn, or the ground yields out of the plane.
    """

    def __init__(self, opening: Opening, pressure: Dual, limit: HoekBrownLimit) -> None:
        super().__init__(opening, pressure)
        if pressure.value < limit.tip.value:
            raise BeyondClosedForm(TORN)
        self._limit, self._rock = limit, opening.rock
        self._critical, _ = limit.bounds(opening.rock.pressure)
        self._rate = (1.0 - limit.a) * limit.mb
        self._wall = self._w(pressure)
        self.plastic_radius = self._radius(self._critical)
        self._find_edge()

    def bears(self, pressure: Dual) -> bool:
        """Whether the wall stays elastic on the way back to a pressure."""
        change = abs(float(pressure.value) - float(self.pressure.value))
        hoop = self._limit.hoop(self.pressure) - change
        if hoop.value < self._limit.tip.value:
            return False
        apart = 2.0 * change - float(self._limit.difference(self.pressure).value)
        return bool(apart <= self._limit.difference(hoop).value)

    def displacement(self, r: Floats) -> Dual:
        """u_r (m,) at radii r (m,) >= a, m."""
        R = self.plastic_radius
        assert R is not None
        outside, _ = lame(self._rock, self._critical, R, r)
        columns = outside.columns.copy()
        moved = (self._critical - self._rock.pressure) * R / (2.0 * self._rock.shear)
        if self.edge_radius is not None:
            within = r < self.edge_radius.value
            at_edge = self._flowing(R, moved, self.edge_radius[None], edge=False)[0]
            inner = self._flowing(self.edge_radius, at_edge, _plain(r[within], R), edge=True)
            columns[within] = inner.columns
        else:
            within = np.zeros(len(r), dtype=np.bool_)
        between = ~within & (r < R.value)
        columns[between] = self._flowing(R, moved, _plain(r[between], R), edge=False).columns
        return Dual(columns)

    def stresses(self, r: Floats) -> tuple[Dual, Dual, Dual]:
        """sigma_r, sigma_t, sigma_z, each (m,), Pa."""
        rock, limit, R = self._rock, self._limit, self.plastic_radius
        assert R is not None
        _, change = lame(rock, self._critical, R, r)
        far = [rock.pressure + change, rock.pressure - change, rock.out_of_plane + 0.0 * change]
        columns = [dual.columns.copy() for dual in far]
        inside = r < R.value
        radial = self._radial(_plain(r[inside], R))
        hoop = limit.hoop(radial)
        axial = self._axial(radial, hoop)
        if self.edge_radius is not None:
            edge = (r[inside] < self.edge_radius.value)[:, None]
            axial = Dual(np.where(edge, hoop.columns, axial.columns))
        for part, dual in zip(columns, (radial, hoop, axial), strict=True):
            part[inside] = dual.columns
        return Dual(columns[0]), Dual(columns[1]), Dual(columns[2])

    def _w(self, radial: Dual) -> Dual:
        return self._limit.y(radial).power(1.0 - self._limit.a)

    def _radius(self, radial: Dual) -> Dual:
        """Where sigma_r has a value."""
        return self.opening.radius * ((self._w(radial) - self._wall) / self._rate).exp()

    def _radial(self, r: Dual) -> Dual:
        """sigma_r (...) at radii (...) of the plastic zone."""
        limit = self._limit
        w = self._wall + self._rate * (r / self.opening.radius).log()
        w = Dual(np.where(w.columns[..., :1] > _TINY, w.columns, _tiny(w)))
        y = w.power(1.0 / (1.0 - limit.a))
        return (y - limit.s) * limit.sigci / limit.mb

    def _axial(self, radial: Dual, hoop: Dual) -> Dual:
        rock = self._rock
        return rock.out_of_plane + rock.nu * (radial + hoop - 2.0 * rock.pressure)

    def _flowing(self, outer: Dual, moved: Dual, r: Dual, *, edge: bool) -> Dual:
        """U (m,) inside a radius that moved, in a zone with or without flow out of the plane.

        Args:
            outer: radius of the zone, m.
            moved: u there, m.
            r: (m,) radii, m.
            edge: whether sigma_z = sigma_t.
        """
        rock, K = self._rock, self._limit.K
        way = (outer / r).log()  # (m,)
        half = 0.5 * way[:, None]
        x = r[:, None] * (half * (_NODES + 1.0)).exp()  # (m, nodes)
        radial = self._radial(x)
        hoop = self._limit.hoop(radial)
        axial = hoop if edge else self._axial(radial, hoop)
        across = hoop - rock.pressure + axial - rock.out_of_plane
        along = (1.0 - 2.0 * rock.nu * K) * (radial - rock.pressure)
        g = (along + (K * (1.0 - rock.nu) - rock.nu) * across) / rock.E
        weighed = (K * (x / r[:, None]).log()).exp() * x * g * half * _WEIGHTS
        return (K * way).exp() * moved + Dual(weighed.columns.sum(axis=1))

    def _find_edge(self) -> None:
        """Where sigma_z meets sigma_t, if it does.

        Raises:
            BeyondClosedForm: sigma_z is not the middle stress outside that zone.
        """
        rock, limit = self._rock, self._limit

        def above(radial: Dual) -> Dual:
            hoop = limit.hoop(radial)
            return self._axial(radial, hoop) - hoop

        inner = self.pressure
        if above(self.pressure).value > 0.0 >= above(self._critical).value:
            nu = float(rock.nu.value)
            inner = _root(
                above,
                self.pressure,
                self._critical,
                lambda x: 2.0 * nu - 1.0 - (1.0 - nu) * limit.steepness(x),
            )
            self.edge_radius = self._radius(inner)
        for radial in (self._critical, inner):
            hoop = limit.hoop(radial)
            axial, slack = self._axial(radial, hoop).value, 1e-9 * abs(hoop.value)
            if not radial.value - slack <= axial <= hoop.value + slack:
                raise BeyondClosedForm(OUT_OF_PLANE)


def _plain(r: Floats, like: Dual) -> Dual:
    """Given radii (m,) as numbers that depend on nothing."""
    return Dual.constant(r, like.n)

"""Closed forms of a deep circular opening in plane strain (theory 4.6).

Here pressures and stresses are positive in compression, unlike elsewhere; displacements u_r are
positive outwards, away from the axis. Far stress p0, all round; inside acts the pressure p.

*Elastic ground* (Lame; Kirsch for unequal far stresses): u_r = (p - p0) a^2 / (2 G r).

*Mohr-Coulomb*, elastic, perfectly plastic (J. Salencon, Contraction quasi-statique d'une cavite a
symetrie spherique ou cylindrique dans un milieu elastoplastique, Annales des Ponts et Chaussees 4,
1969). With N = (1 + sin phi) / (1 - sin phi), Y = 2 c cos phi / (1 - sin phi) and K as N of the
dilation psi, contraction (p < p0, sigma_t the largest stress) yields where sigma_t = N sigma_r + Y.
Expansion (p > p0, sigma_r the largest) is the same with 1/N, -Y/N and 1/K in place of N, Y and K,
so one set of formulas serves both.

1. Elastic ground: sigma_r + sigma_t = 2 p0, so at the edge R of the plastic zone
   sigma_R = (2 p0 - Y) / (N + 1), the critical pressure.
2. Equilibrium d sigma_r / d ln r = sigma_t - sigma_r = (N - 1) sigma_r + Y =: Q, so Q grows as
   r^(N-1): ln(R / a) = ln(Q_R / Q_a) / (N - 1).
3. Flow: ln increments eps_r^p + K (eps_t^p + eps_z^p) = 0, which integrates as it stands since
   no direction changes along the way. Together with compatibility

       u' + K u / r = -g,    g = e_r + K (e_t + e_z)

   where e are the elastic strains from the virgin state, affine in sigma_r. They are not neglected.
   - *Face*: sigma_z is the middle stress, eps_z^p = 0 and
     sigma_z = z0 + nu (sigma_r + sigma_t - 2 p0).
   - *Edge*: as p falls, sigma_z may meet sigma_t. From then on both planes are active, sigma_z =
     sigma_t and eps_z^p = -e_z (D. J. Reed, The influence of out-of-plane stress on a plane strain
     problem in rock mechanics, Int. J. Numer. Anal. Methods Geomech. 12, 1988). That zone is the
     inner one, where sigma_r is below sigma_E, where both expressions of sigma_z agree. Salencon's
     formula for u takes the face everywhere; the stresses sigma_r, sigma_t do not depend on it.
4. In each zone sigma_r is an exponential of l = ln(outer radius / r), so u has a closed form.

*Unloading* (p rises again after contraction has yielded) is elastic until the wall yields the other
way, after a change of Q_a; what lies beyond is refused.

All are written with dual numbers, so derivatives by every parameter are exact.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from geoident.forward.openings.divided_differences import exp_divided, log_divided
from geoident.model.arrays import Floats
from geoident.model.dual import Dual, Number

NO_EQUILIBRIUM = "its strength cannot carry the stress at the wall, however far it yields"
OUT_OF_PLANE = "it yields by the stress out of the plane, for which there is no closed form"
BOTH_WAYS = "the wall yields in contraction and in expansion, for which there is no closed form"

_ROUNDING = 1e-9
"""Excess of sigma_z over the larger stress in the plane, in parts of their difference, that does
not count: where sigma_z = sigma_t in the ground before the opening it is rounding."""


class BeyondClosedForm(Exception):
    """The closed form does not cover what happens, or there is no equilibrium.

    Args:
        reason: why, a clause about the ground.
    """

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(reason)


@dataclass(frozen=True)
class Rock:
    """Elastic ground under an all-round far stress.

    Args:
        E: Young's modulus, Pa.
        nu: Poisson's ratio.
        pressure: p0, far stress in the plane, Pa.
        out_of_plane: z0, the normal stress out of the plane before the opening, Pa.
    """

    E: Dual
    nu: Dual
    pressure: Dual
    out_of_plane: Dual

    @property
    def shear(self) -> Dual:
        """Shear modulus G, Pa."""
        return self.E / (2.0 * (1.0 + self.nu))


class WallLimit(ABC):
    """A limit sigma_t = sigma_r + Q(sigma_r) of contraction, and the flow there.

    Attributes:
        K: slope of the flow.
    """

    K: Dual

    @property
    @abstractmethod
    def reversed(self) -> WallLimit:
        """The same limit for expansion, solved for sigma_t.

        Raises:
            BeyondClosedForm: expansion has no closed form.
        """

    @abstractmethod
    def difference(self, radial: Dual) -> Dual:
        """Q = sigma_t - sigma_r, Pa."""

    @abstractmethod
    def critical(self, pressure: Dual) -> Dual:
        """Pressure inside, Pa, at which the wall begins to yield in contraction from p0."""

    @abstractmethod
    def way(self, inner: Dual, outer: Dual) -> Dual:
        """ln(r_o / r_i) of the radii at which sigma_r has two values."""

    @abstractmethod
    def inwards(self, radial: Dual, way: Dual) -> Dual:
        """sigma_r at the distance l = ln(r_o / r), the way, inwards from where it is given, Pa."""

    @abstractmethod
    def integral(self, zone: PlasticZone, way: Dual) -> Dual:
        """Integral over t = 0..l of e^(-(K+1) t) g(t), inwards from the edge of a zone."""

    @abstractmethod
    def meets_axial(self, rock: Rock, pressure: Dual, edge: Dual) -> Dual | None:
        """sigma_E, at which sigma_z of the face meets sigma_t; None if not in the plastic zone.

        Args:
            rock: the ground.
            pressure: sigma_r at the wall, Pa.
            edge: sigma_r at the edge of the plastic zone, Pa.
        """

    def hoop(self, radial: Dual) -> Dual:
        """sigma_t, Pa."""
        return radial + self.difference(radial)


@dataclass(frozen=True)
class Strength(WallLimit):
    """Mohr-Coulomb's limit, sigma_t = N sigma_r + Y.

    Args:
        N: slope.
        Y: strength at sigma_r = 0, Pa.
        K: slope of the flow.
    """

    N: Dual
    Y: Dual
    K: Dual

    @property
    def reversed(self) -> Strength:
        """sigma_r = N sigma_t + Y, solved for sigma_t."""
        return Strength(1.0 / self.N, -self.Y / self.N, 1.0 / self.K)

    def difference(self, radial: Dual) -> Dual:
        """Q = (N - 1) sigma_r + Y."""
        return (self.N - 1.0) * radial + self.Y

    def critical(self, pressure: Dual) -> Dual:
        """sigma_R = (2 p0 - Y) / (N + 1)."""
        return (2.0 * pressure - self.Y) / (self.N + 1.0)

    def way(self, inner: Dual, outer: Dual) -> Dual:
        """ln(Q_o / Q_i) / (N - 1), which is (sigma_o - sigma_i) / Q_i of Tresca."""
        wall, rise = self.difference(inner), outer - inner
        return rise / wall * log_divided((self.N - 1.0) * rise / wall)

    def inwards(self, radial: Dual, way: Dual) -> Dual:
        """sigma_r - Q (1 - e^(-(N-1) l)) / (N - 1)."""
        return radial - self.difference(radial) * way * exp_divided((1.0 - self.N) * way)

    def integral(self, zone: PlasticZone, way: Dual) -> Dual:
        """By divided differences, since the source g is affine in sigma_r."""
        nu, N = zone.rock.nu, self.N
        slope = zone.strain(1.0, N + N if zone.edge else N + nu * (1.0 + N))  # dg / d sigma_r
        first, second = -(self.K + 1.0) * way, -(self.K + N) * way
        fall = self.difference(zone.radial) * way * exp_divided(first, second)
        return way * (zone.source(zone.radial) * exp_divided(first) - slope * fall)

    def meets_axial(self, rock: Rock, pressure: Dual, edge: Dual) -> Dual | None:
        """sigma_E = (z0 - 2 nu p0 - (1 - nu) Y) / (N - nu (1 + N)).

        Where the divisor is zero, sigma_z - sigma_t is the same everywhere.
        """
        nu, N = rock.nu, self.N
        divisor = N - nu * (1.0 + N)
        if divisor.value == 0.0:
            return None
        excess = rock.out_of_plane - 2.0 * nu * rock.pressure - (1.0 - nu) * self.Y
        radial = excess / divisor
        low, high = sorted(float(end.value) for end in (pressure, edge))
        return radial if low < radial.value < high else None


def mohr_coulomb(cohesion: Dual, friction: Dual, dilation: Dual) -> Strength:
    """The limit of Mohr-Coulomb; of Tresca where both angles are zero.

    Args:
        cohesion: c, Pa.
        friction: angle phi, rad.
        dilation: angle psi, rad.
    """
    strength = 2.0 * cohesion * friction.cosine() / (1.0 - friction.sine())
    return Strength(flow_slope(friction), strength, flow_slope(dilation))


def flow_slope(angle: Dual) -> Dual:
    """(1 + sin) / (1 - sin) of an angle, rad: K of a dilation, N of a friction."""
    sine = angle.sine()
    return (1.0 + sine) / (1.0 - sine)


@dataclass(frozen=True)
class PlasticZone:
    """A plastic ring from its outer radius inwards.

    Args:
        rock: the ground.
        limit: what it obeys.
        outer: its outer radius, m.
        radial: sigma_r there, Pa.
        moved: u_r there, m.
        edge: whether sigma_z = sigma_t (step 3 of the module).
    """

    rock: Rock
    limit: WallLimit
    outer: Dual
    radial: Dual
    moved: Dual
    edge: bool

    def stress(self, r: Number) -> Dual:
        """sigma_r at r, inside the zone."""
        return self.limit.inwards(self.radial, (self.outer / r).log())

    def displacement(self, r: Number) -> Dual:
        """At r: e^(K l) (moved + outer * integral over 0..l of e^(-(K+1) t) g(t) dt)."""
        way = (self.outer / r).log()
        integral = self.limit.integral(self, way)
        return (self.limit.K * way).exp() * (self.moved + self.outer * integral)

    def axial(self, radial: Dual) -> Dual:
        """sigma_z where sigma_r is given."""
        rock, hoop = self.rock, self.limit.hoop(radial)
        if self.edge:
            return hoop
        return rock.out_of_plane + rock.nu * (radial + hoop - 2.0 * rock.pressure)

    def source(self, radial: Dual) -> Dual:
        """The source g where sigma_r is given."""
        rock, hoop = self.rock, self.limit.hoop(radial)
        across = hoop - rock.pressure + self.axial(radial) - rock.out_of_plane
        return self.strain(radial - rock.pressure, across)

    def strain(self, radial: Number, across: Dual) -> Dual:
        """e_r + K (e_t + e_z) of changes of sigma_r and of sigma_t + sigma_z."""
        nu, K = self.rock.nu, self.limit.K
        return ((1.0 - 2.0 * nu * K) * radial + (K * (1.0 - nu) - nu) * across) / self.rock.E

    def check_axial(self, inner: Dual) -> None:
        """Refuse a face whose sigma_z is not the middle stress, from its edge to a sigma_r.

        Raises:
            BeyondClosedForm: it is not.
        """
        for radial in (self.radial, inner):
            ends = sorted((float(radial.value), float(self.limit.hoop(radial).value)))
            tolerance = _ROUNDING * (ends[1] - ends[0])
            if not ends[0] - tolerance <= self.axial(radial).value <= ends[1] + tolerance:
                raise BeyondClosedForm(OUT_OF_PLANE)


class Opening:
    """A circular opening and what an inner pressure does to the ground around it.

    Args:
        radius: a, m.
        rock: the ground.
        strength: its limit, or None for elastic ground.
    """

    def __init__(self, radius: float, rock: Rock, strength: WallLimit | None = None) -> None:
        self.radius = radius
        self.rock = rock
        self.strength = strength

    @cached_property
    def critical(self) -> tuple[Dual, Dual] | None:
        """Pressures below and above which the wall yields, Pa; None where it never does.

        Elastic ground has sigma_r + sigma_t = 2 p0: in expansion the two change places.
        """
        if self.strength is None:
            return None
        below = self.strength.critical(self.rock.pressure)
        return below, 2.0 * self.rock.pressure - below

    def under(self, pressure: Dual) -> GroundState:
        """The ground when the pressure inside went from p0 to this, Pa, in one direction.

        Raises:
            BeyondClosedForm: the limit cannot carry it, or the ground yields out of the plane.
        """
        if self.strength is None or self.critical is None:
            return GroundState(self, pressure, pressure)
        below, above = self.critical
        if pressure.value < below.value:
            return self._yielding(pressure, below, self.strength)
        if pressure.value > above.value:
            return self._yielding(pressure, above, self.strength.reversed)
        hoop = 2.0 * self.rock.pressure - pressure
        wall = [float(dual.value) for dual in (pressure, hoop, self.rock.out_of_plane)]
        if max(wall) > self.strength.hoop(self.rock.pressure * 0.0 + min(wall)).value:
            raise BeyondClosedForm(OUT_OF_PLANE)
        return GroundState(self, pressure, pressure)

    def _yielding(self, pressure: Dual, critical: Dual, limit: WallLimit) -> GroundState:
        """The ground around a wall that yields, with a zone for each expression of sigma_z.

        Args:
            pressure: inside, Pa.
            critical: at which it begins to yield, Pa.
            limit: in the direction of loading.
        """
        rock = self.rock
        if limit.difference(pressure).value * limit.difference(critical).value <= 0.0:
            raise BeyondClosedForm(NO_EQUILIBRIUM)
        outer = self.radius * limit.way(pressure, critical).exp()
        moved = (critical - rock.pressure) * outer / (2.0 * rock.shear)
        face = PlasticZone(rock, limit, outer, critical, moved, edge=False)
        radial = limit.meets_axial(rock, pressure, critical)
        face.check_axial(pressure if radial is None else radial)
        zones = [face]
        if radial is not None:
            inner = self.radius * limit.way(pressure, radial).exp()
            moved = face.displacement(inner)
            zones.append(PlasticZone(rock, limit, inner, radial, moved, edge=True))
        return GroundState(self, pressure, pressure, tuple(zones))


@dataclass(frozen=True)
class GroundState:
    """The ground under an inner pressure.

    Args:
        opening: with the ground around it.
        pressure: inside, Pa.
        turned: pressure at which the wall had yielded most, Pa, from where on all is elastic;
            ``pressure`` while loading goes on.
        zones: plastic rings, from outside inwards; none where nothing yields.
    """

    opening: Opening
    pressure: Dual
    turned: Dual
    zones: tuple[PlasticZone, ...] = ()

    @property
    def plastic_radius(self) -> Dual | None:
        """R, m; None where nothing yields."""
        return self.zones[0].outer if self.zones else None

    @property
    def edge_radius(self) -> Dual | None:
        """The radius inside which sigma_z = sigma_t, m; None where that is nowhere."""
        return self.zones[1].outer if len(self.zones) > 1 else None

    def onward(self, pressure: Dual) -> GroundState:
        """The ground when the pressure inside goes on from here to another, Pa.

        On the way back a change d adds to sigma_r what it takes from sigma_t: the wall meets the
        other limit at |d| = |Q|.

        Raises:
            BeyondClosedForm: see `Opening.under`; or the wall yields in contraction and expansion.
        """
        loaded = self.turned.value - self.opening.rock.pressure.value
        change = pressure.value - self.turned.value
        if not self.zones or change * loaded >= 0.0:
            return self.opening.under(pressure)
        if abs(change) <= abs(self.zones[0].limit.difference(self.turned).value):
            return replace(self, pressure=pressure)
        raise BeyondClosedForm(BOTH_WAYS)

    @property
    def wall_inwards(self) -> Dual:
        """Motion of the wall inwards from the virgin state, m."""
        return -self.displacement(np.array([self.opening.radius]))[0]

    def displacement(self, r: Floats) -> Dual:
        """u_r (m,) at radii r (m,) >= a from the virgin state, m, outwards."""
        loading, back = self._changes(r)
        flexible = r / (2.0 * self.opening.rock.shear)
        return self._with_zones(loading * flexible, r, PlasticZone.displacement) + back * flexible

    def stresses(self, r: Floats) -> tuple[Dual, Dual, Dual]:
        """sigma_r, sigma_t, sigma_z, each (m,), Pa."""
        rock, (loading, back) = self.opening.rock, self._changes(r)
        radial = self._with_zones(rock.pressure + loading, r, PlasticZone.stress)
        hoop = self._with_zones(
            rock.pressure - loading, r, lambda zone, at: zone.limit.hoop(zone.stress(at))
        )
        far = rock.out_of_plane + 0.0 * loading
        axial = self._with_zones(far, r, lambda zone, at: zone.axial(zone.stress(at)))
        return radial + back, hoop - back, axial

    def _changes(self, r: Floats) -> tuple[Dual, Dual]:
        """Elastic changes of sigma_r (m,): around what yields by loading, and since it turned."""
        a, p0 = self.opening.radius, self.opening.rock.pressure
        edge, outer = self.turned, p0 * 0.0 + a
        if self.zones:
            edge, outer = self.zones[0].radial, self.zones[0].outer
        return (edge - p0) * outer * outer / r**2, (self.pressure - self.turned) * (a / r) ** 2

    def _with_zones(
        self, far: Dual, r: Floats, formula: Callable[[PlasticZone, Floats], Dual]
    ) -> Dual:
        """Values (m,) of elastic ground, replaced by those of the zones inside these."""
        columns = far.columns.copy()
        for zone in self.zones:
            inside = r < zone.outer.value
            columns[inside] = formula(zone, r[inside]).columns
        return Dual(columns)

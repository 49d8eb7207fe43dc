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

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from geoident.forward.openings.divided_differences import exp_divided, log_divided
from geoident.model.arrays import Floats
from geoident.model.dual import Dual, Number


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


@dataclass(frozen=True)
class Strength:
    """Mohr-Coulomb's limit in the direction of contraction, sigma_t = N sigma_r + Y.

    Args:
        N: slope.
        Y: strength at sigma_r = 0, Pa.
        K: the slope of the flow.
    """

    N: Dual
    Y: Dual
    K: Dual

    def hoop(self, radial: Dual) -> Dual:
        """sigma_t at the limit."""
        return self.N * radial + self.Y

    @property
    def reversed(self) -> Strength:
        """The same limit for expansion: sigma_r = N sigma_t + Y solved for sigma_t."""
        return Strength(1.0 / self.N, -self.Y / self.N, 1.0 / self.K)

    def difference(self, radial: Dual) -> Dual:
        """Q = sigma_t - sigma_r at the limit."""
        return (self.N - 1.0) * radial + self.Y

    def critical(self, pressure: Dual) -> Dual:
        """sigma_R, the inner pressure at which the wall begins to yield."""
        return (2.0 * pressure - self.Y) / (self.N + 1.0)

    def way(self, inner: Dual, outer: Dual) -> Dual:
        """Logarithm of the ratio of the radii at which sigma_r has two values."""
        wall, rise = self.difference(inner), outer - inner
        return rise / wall * log_divided((self.N - 1.0) * rise / wall)

    def inwards(self, radial: Dual, way: Dual) -> Dual:
        """sigma_r further in: radial - Q (1 - e^(-(N-1) l)) / (N - 1), with l the ``way``."""
        return radial - self.difference(radial) * way * exp_divided((1.0 - self.N) * way)

    def integral(self, zone: PlasticZone, way: Dual) -> Dual:
        """Integral over t = 0..l of e^(-(K+1) t) g(t), inwards from the edge of a zone."""
        first, second = -(self.K + 1.0) * way, -(self.K + self.N) * way
        fall = self.difference(zone.radial) * way * exp_divided(first, second)
        return way * (zone.source(zone.radial) * exp_divided(first) - self._slope_in(zone) * fall)

    def _slope_in(self, zone: PlasticZone) -> Dual:
        """Change dg / d sigma_r of the source g, which is affine in sigma_r, 1/Pa."""
        nu, N = zone.rock.nu, self.N
        return zone.strain(1.0, N + N if zone.edge else N + nu * (1.0 + N))

    def meets_axial(self, rock: Rock, pressure: Dual, critical: Dual) -> Dual | None:
        """sigma_r between two at which sigma_z meets sigma_t, or None.

        In the face zone sigma_z - sigma_t is affine in sigma_r and vanishes at
        sigma_E = (z0 - 2 nu p0 - (1 - nu) Y) / (N - nu (1 + N)); where the divisor is zero, the
        difference is the same everywhere and there is no edge.

        Args:
            rock: the ground.
            pressure: at the wall.
            critical: at the edge of the plastic zone.
        """
        nu, N, Y = rock.nu, self.N, self.Y
        excess = rock.out_of_plane - 2.0 * nu * rock.pressure - (1.0 - nu) * Y
        divisor = N - nu * (1.0 + N)
        radial = excess / divisor if divisor.value != 0.0 else None
        low, high = sorted(float(dual.value) for dual in (pressure, critical))
        return radial if radial is not None and low < radial.value < high else None


class WallLimit(Protocol):
    """What a limit sigma_t = f(sigma_r) of contraction says; see `Strength` for each of these."""

    @property
    def K(self) -> Dual:  # noqa: N802  (as in the formulas)
        """The slope of the flow."""

    @property
    def reversed(self) -> WallLimit:
        """The same limit for expansion."""

    def hoop(self, radial: Dual) -> Dual:
        """sigma_t at the limit."""

    def difference(self, radial: Dual) -> Dual:
        """Q = sigma_t - sigma_r at the limit."""

    def critical(self, pressure: Dual) -> Dual:
        """The inner pressure at which the wall begins to yield."""

    def way(self, inner: Dual, outer: Dual) -> Dual:
        """Logarithm of the ratio of the radii at which sigma_r has two values."""

    def inwards(self, radial: Dual, way: Dual) -> Dual:
        """sigma_r further in."""

    def integral(self, zone: PlasticZone, way: Dual) -> Dual:
        """Integral of what moves the ground, inwards from the edge of a zone."""

    def meets_axial(self, rock: Rock, pressure: Dual, critical: Dual) -> Dual | None:
        """sigma_r between two at which sigma_z meets sigma_t, or None.

        Args:
            rock: the ground.
            pressure: at the wall.
            critical: at the edge of the plastic zone.
        """


def mohr_coulomb(cohesion: Dual, friction: Dual, dilation: Dual) -> Strength:
    """The limit of Mohr-Coulomb.

    Tresca where both angles are zero.

    Args:
        cohesion: c, Pa.
        friction: angle phi, rad.
        dilation: angle psi, rad.
    """
    sine, N = friction.through(np.sin, np.cos), flow_slope(friction)
    cosine = friction.through(np.cos, lambda x: -np.sin(x))
    return Strength(N, 2.0 * cohesion * cosine / (1.0 - sine), flow_slope(dilation))


def flow_slope(angle: Dual) -> Dual:
    """(1 + sin) / (1 - sin) of an angle, rad: K of a dilation, N of a friction."""
    sine = angle.through(np.sin, np.cos)
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

    @property
    def critical(self) -> tuple[Dual, Dual] | None:
        """Pressures below and above which the wall yields, Pa; None where it never does."""
        return None if self.strength is None else self._yields_at(self.strength)

    def _yields_at(self, strength: WallLimit) -> tuple[Dual, Dual]:
        p0 = self.rock.pressure
        return strength.critical(p0), strength.reversed.critical(p0)

    def under(self, pressure: Dual) -> GroundState:
        """The ground when the pressure inside went from p0 to this, Pa, in one direction.

        Raises:
            BeyondClosedForm: the limit cannot carry it, or the ground yields out of the plane.
        """
        if self.strength is None:
            return GroundState(self, pressure)
        below, above = self._yields_at(self.strength)
        if pressure.value < below.value:
            return PlasticState(self, pressure, self.strength)
        if pressure.value > above.value:
            return PlasticState(self, pressure, self.strength.reversed)
        hoop = 2.0 * self.rock.pressure - pressure
        wall = [float(dual.value) for dual in (pressure, hoop, self.rock.out_of_plane)]
        if max(wall) > self.strength.hoop(self.rock.pressure * 0.0 + min(wall)).value:
            raise BeyondClosedForm(OUT_OF_PLANE)
        return GroundState(self, pressure)

    def history(self, pressures: Iterable[Dual]) -> Iterator[GroundState]:
        """The ground under pressures that follow each other, p0 before the first.

        Raises:
            BeyondClosedForm: see `under`; or the wall yields in contraction and in expansion.
        """
        state: GroundState | None = None
        for pressure in pressures:
            state = self.onward(state, pressure)
            yield state

    def onward(self, before: GroundState | None, pressure: Dual) -> GroundState:
        """The ground when the pressure inside goes on from a state to this, Pa.

        Args:
            before: under the last pressure; None: at p0.
            pressure: inside.

        Raises:
            BeyondClosedForm: see `under`; or the wall yields in contraction and in expansion.
        """
        turned = before.turned if isinstance(before, Unloaded) else before
        if not isinstance(turned, PlasticState) or turned.goes_on(pressure):
            return self.under(pressure)
        if turned.bears(pressure):  # first loading ended there, and all since is elastic
            return Unloaded(turned, pressure)
        raise BeyondClosedForm(BOTH_WAYS)


NO_EQUILIBRIUM = "its strength cannot carry the stress at the wall, however far it yields"
OUT_OF_PLANE = "it yields by the stress out of the plane, for which there is no closed form"
BOTH_WAYS = "the wall yields in contraction and in expansion, for which there is no closed form"


class BeyondClosedForm(Exception):
    """What the closed form does not cover, or what has no equilibrium; says it of the ground."""

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(reason)


class GroundState:
    """The ground under an inner pressure: elastic here, see `PlasticState` and `Unloaded`.

    Attributes:
        plastic_radius: R, m; None where nothing yields.
        edge_radius: the radius inside which sigma_z = sigma_t, m; None where that is nowhere.
    """

    plastic_radius: Dual | None = None
    edge_radius: Dual | None = None

    def __init__(self, opening: Opening, pressure: Dual) -> None:
        self.opening = opening
        self.pressure = pressure

    def displacement(self, r: Floats) -> Dual:
        """u_r (m,) at radii r (m,) >= a from the virgin state, m, outwards."""
        return _lame(self.opening.rock, self.pressure, self.opening.radius, r)[0]

    def stresses(self, r: Floats) -> tuple[Dual, Dual, Dual]:
        """sigma_r, sigma_t, sigma_z, each (m,), Pa."""
        rock = self.opening.rock
        _, change = _lame(rock, self.pressure, self.opening.radius, r)
        return rock.pressure + change, rock.pressure - change, rock.out_of_plane + 0.0 * change


def _lame(rock: Rock, pressure: Dual, radius: Number, r: Floats) -> tuple[Dual, Dual]:
    """u_r and the change of sigma_r at radii r (m,) around a pressure at a radius."""
    change = (pressure - rock.pressure) * radius * radius / r**2
    return change * r / (2.0 * rock.shear), change


class PlasticState(GroundState):
    """The ground around a wall that yields, loaded in one direction.

    Args:
        opening: radius, ground and strength.
        pressure: inside, Pa.
        limit: in the direction of loading.

    Raises:
        BeyondClosedForm: the limit cannot carry it, or the ground yields out of the plane.
    """

    def __init__(self, opening: Opening, pressure: Dual, limit: WallLimit) -> None:
        super().__init__(opening, pressure)
        self._limit = limit
        rock = opening.rock
        critical = limit.critical(rock.pressure)
        if limit.difference(pressure).value * limit.difference(critical).value <= 0.0:
            raise BeyondClosedForm(NO_EQUILIBRIUM)
        self._critical, self._outer = critical, self._radius(critical)
        moved = (critical - rock.pressure) * self._outer / (2.0 * rock.shear)
        self._zones = [PlasticZone(rock, limit, self._outer, critical, moved, edge=False)]
        self.plastic_radius = self._outer
        self._find_edge()

    def goes_on(self, pressure: Dual) -> bool:
        """Whether a next pressure loads further in the same direction."""
        onward = self.pressure.value - self.opening.rock.pressure.value
        return bool((pressure.value - self.pressure.value) * onward >= 0.0)

    def bears(self, pressure: Dual) -> bool:
        """Whether the wall stays elastic on the way back to a pressure.

        A change d adds to sigma_r what it takes from sigma_t: the other limit is met at d = Q.
        """
        change = pressure.value - self.pressure.value
        return bool(abs(change) <= abs(self._limit.difference(self.pressure).value))

    def displacement(self, r: Floats) -> Dual:
        """u_r (m,) at radii r (m,) >= a, m."""
        outside, _ = _lame(self.opening.rock, self._critical, self._outer, r)
        return self._replaced(outside, r, lambda zone, inner: zone.displacement(inner))

    def stresses(self, r: Floats) -> tuple[Dual, Dual, Dual]:
        """sigma_r, sigma_t, sigma_z, each (m,), Pa."""
        rock, limit = self.opening.rock, self._limit
        _, change = _lame(rock, self._critical, self._outer, r)
        far = rock.pressure + change, rock.pressure - change, rock.out_of_plane + 0.0 * change
        return (
            self._replaced(far[0], r, lambda zone, inner: zone.stress(inner)),
            self._replaced(far[1], r, lambda zone, inner: limit.hoop(zone.stress(inner))),
            self._replaced(far[2], r, lambda zone, inner: zone.axial(zone.stress(inner))),
        )

    def _replaced(
        self, far: Dual, r: Floats, formula: Callable[[PlasticZone, Floats], Dual]
    ) -> Dual:
        """What holds far away, (m,), with what the zones say inside them."""
        columns = far.columns.copy()
        for zone in self._zones:
            inside = r < zone.outer.value
            columns[inside] = formula(zone, r[inside]).columns
        return Dual(columns)

    def _radius(self, radial: Dual) -> Dual:
        """The radius at which sigma_r has a value."""
        return self.opening.radius * self._limit.way(self.pressure, radial).exp()

    def _find_edge(self) -> None:
        """Split off the zone in which sigma_z = sigma_t, where there is one.

        Raises:
            BeyondClosedForm: sigma_z is not the middle stress outside that zone.
        """
        rock, limit, face = self.opening.rock, self._limit, self._zones[0]
        radial = limit.meets_axial(rock, self.pressure, self._critical)
        inner = self.pressure
        if radial is not None:
            inner = radial
            self.edge_radius = self._radius(radial)
            moved = face.displacement(self.edge_radius)
            self._zones.append(PlasticZone(rock, limit, self.edge_radius, radial, moved, edge=True))
        if not (self._is_middle(self._critical) and self._is_middle(inner)):
            raise BeyondClosedForm(OUT_OF_PLANE)

    def _is_middle(self, radial: Dual) -> bool:
        """Whether sigma_z of the face zone lies between the others, to rounding."""
        axial, hoop = self._zones[0].axial(radial).value, self._limit.hoop(radial).value
        tolerance = 1e-9 * abs(hoop - radial.value)
        low, high = min(hoop, radial.value), max(hoop, radial.value)
        return bool(low - tolerance <= axial <= high + tolerance)


class Unloaded(GroundState):
    """The ground after the pressure went back elastically from where it had yielded.

    Attributes:
        turned: the ground there.
    """

    def __init__(self, turned: PlasticState, pressure: Dual) -> None:
        super().__init__(turned.opening, pressure)
        self.turned = turned
        self.plastic_radius, self.edge_radius = turned.plastic_radius, turned.edge_radius

    def displacement(self, r: Floats) -> Dual:
        """u_r (m,) at radii r (m,) >= a, m."""
        return self.turned.displacement(r) + self._back(r) * r / (2.0 * self.opening.rock.shear)

    def stresses(self, r: Floats) -> tuple[Dual, Dual, Dual]:
        """sigma_r, sigma_t, sigma_z, each (m,), Pa."""
        radial, hoop, axial = self.turned.stresses(r)
        return radial + self._back(r), hoop - self._back(r), axial

    def _back(self, r: Floats) -> Dual:
        """The change of sigma_r since."""
        return (self.pressure - self.turned.pressure) * (self.opening.radius / r) ** 2

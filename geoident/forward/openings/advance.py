"""What a tunnel's face releases as it goes on: longitudinal displacement profiles (theory 2.9).

With R the radius of the tunnel and x how far the face has gone beyond the section, the profile
gives the part s of its final motion that the wall has made, u(x) = s u_max:

- N. Vlachopoulos & M. S. Diederichs, Improved longitudinal displacement profiles for convergence
  confinement analysis of deep tunnels, Rock Mech. Rock Eng. 42, 2009. With R* = R_p / R, the
  plastic radius of the tunnel far from its face without support,
  s_0 = exp(-0.15 R*) / 3, ahead of the face s = s_0 exp(x / R), behind it
  s = 1 - (1 - s_0) exp(-3 x / (2 R_p)).
- M. Panet, Le calcul des tunnels par la methode convergence-confinement, 1995:
  s = alpha + (1 - alpha) (1 - (m / (m + x / R))^2), alpha 0.25 (to 0.27) and m 0.75, behind the
  face only.
- J. C. Chern, F. Y. Shiao & C. W. Yu, An empirical safety criterion for tunnel construction, 1998:
  s = (1 + exp(-(x / R) / 1.10))^-1.7.

In elastic ground the wall moves in proportion to the stress that is released: lambda = s. Where the
ground at the wall yields, lambda is found on its reaction curve (`closed_forms`) so that the wall
without support has made that part of its motion, u(lambda) = s u(1): ground that yields moves most
at the end, so that lambda is larger than s. The conversion *mesh* asks the same of the wall of a
mesh (`mesh_reaction`); the *direct* conversion takes lambda = s where the ground yields, too.

u(lambda) is convex, so Newton's method from lambda = 1 comes down on its root; its derivatives
follow from those of the closed form by the theorem of implicit functions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np

from geoident.errors import CollapseError, ModelError
from geoident.forward.openings.closed_forms import NO_EQUILIBRIUM, BeyondClosedForm, Opening
from geoident.model.actions import FaceDistance, FaceProfile, Release
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.parameter import Scalar

AT_FACE, BY_PLASTIC, BEHIND = 1.0 / 3.0, 0.15, 1.5
"""Constants of Vlachopoulos and Diederichs: s_0 = AT_FACE exp(-BY_PLASTIC R*), 3/2 behind it."""

PANET = (Scalar(0.25), Scalar(0.75))
"""Panet's alpha, the part at the face, and m, the length of its influence in radii."""

CHERN = (Scalar(1.10), Scalar(1.7))
"""Chern's reach of the face, in radii, and exponent."""

_PART = "released part"
"""Name of lambda among those to differentiate by; no parameter can have it, with its blank."""

_SMALL = 1e-8
"""Step of the part after which the next one is below rounding: steps are squared."""

_MOST_STEPS = 60

INSTEAD = (
    "write 'conversion: direct' in 'face', with the plastic radius where the profile needs it, or "
    "give the parts by 'release', stage by stage"
)
"""What helps where the ground has no final motion without support."""

BY_MESH = f"write 'conversion: mesh' in 'face', or {INSTEAD[len('write ') :]}"
"""What helps where there is no reaction curve in closed form."""

OpeningAt = Callable[[ParameterPoint], Opening]
"""The opening of radius 1 m in the ground of a case, at some parameters."""


class NoFinalMotion(Exception):
    """Without support the ground has no motion of which a part would be known.

    Args:
        reason: why, a clause.
        collapse: whether it comes to no rest.
    """

    def __init__(self, reason: str, *, collapse: bool = False) -> None:
        self.reason, self.collapse = reason, collapse
        super().__init__(reason)


class ReactionCurve:
    """How far the wall of an opening moves, by the part of the stress that is released.

    Args:
        opening: of radius 1 m, its numbers differentiated by n parameters and, at last, by the
            part that is released.
    """

    def __init__(self, opening: Opening) -> None:
        self._opening = opening

    @cached_property
    def final(self) -> tuple[Dual, Dual]:
        """Motion inwards and plastic radius, as multiples of the radius, of all that is released.

        Raises:
            NoFinalMotion: the ground has no equilibrium without support, or none in closed form.
        """
        return self._at(Dual.constant(1.0, self._opening.rock.pressure.n))

    def part_for(self, share: Dual) -> Dual:
        """The part of the stress that is released when the wall has made a share of its motion.

        Args:
            share: () of the final motion, with derivatives by the n parameters.

        Returns:
            (), likewise.

        Raises:
            NoFinalMotion: see `final`.
        """
        aim = _widened(share) * self.final[0]
        low, high, part = 0.0, 1.0, 1.0
        for _ in range(_MOST_STEPS):
            off = self._wall(part) - aim
            low, high = (low, part) if off.value > 0.0 else (part, high)
            step = float(off.value / off.columns[-1])
            after = part - step
            after = after if low <= after <= high else 0.5 * (low + high)
            if abs(after - part) <= _SMALL:
                break
            part = after
        off = self._wall(after) - aim
        return Dual(np.append(after, -off.columns[1:-1] / off.columns[-1]))

    def _wall(self, part: float) -> Dual:
        """The motion inwards (), differentiated by the part, too."""
        released = Dual.constant(part, self._opening.rock.pressure.n)
        released.columns[-1] = 1.0
        return self._at(released)[0]

    def _at(self, released: Dual) -> tuple[Dual, Dual]:
        try:
            state = self._opening.under((1.0 - released) * self._opening.rock.pressure)
        except BeyondClosedForm as beyond:
            collapse = beyond.reason == NO_EQUILIBRIUM
            raise NoFinalMotion(beyond.reason, collapse=collapse) from beyond
        radius = np.array([self._opening.radius])
        plastic = state.plastic_radius
        n = self._opening.rock.pressure.n
        reach = Dual.constant(1.0, n) if plastic is None else plastic / self._opening.radius
        return -state.displacement(radius)[0], reach


def _widened(number: Dual) -> Dual:
    """The same with a last derivative, zero."""
    return Dual(np.append(number.columns, 0.0))


class WallReaction(Protocol):
    """The reaction of an opening that need not be round; see `mesh_reaction`."""

    @property
    def releases(self) -> Sequence[FaceDistance]:
        """The distances that say a part each."""

    def parts(self, shares: Sequence[Dual], point: ParameterPoint) -> Mapping[FaceDistance, Dual]:
        """The parts of the stress (), 0 to 1, that are released, by distance.

        Args:
            shares: () of its final motion that the wall has made, for every release.
            point: the parameters.

        Raises:
            NoFinalMotion: without support the opening has none, or no part of it is found.
            ModelError: the analysis has no solution otherwise.
        """

    def forget(self) -> None:
        """Begin the next solution as a new model does."""


@dataclass
class _AtPoint:
    """What is known at a parameter point."""

    point: ParameterPoint
    curve: ReactionCurve | None
    parts: dict[FaceDistance, Dual] = field(default_factory=dict)


@contextmanager
def _said_of(stage: str) -> Iterator[None]:
    """Say of a stage that its part is not known."""
    try:
        yield
    except NoFinalMotion as none:
        where = f" at stage '{stage}'" if stage else ""
        text = f"the part of its final motion that the wall has made{where} is not known, since "
        text += f"the ground has none without support: {none.reason}"
        if none.collapse:
            raise CollapseError(text, INSTEAD, stage=stage, fraction=float("nan")) from none
        raise ModelError(text, INSTEAD) from none


class AdvancingFace:
    """The released parts of a case, whether it gives them or the distance to a face.

    Args:
        profile: of the case, or None for one that gives all parts.
        opening: the ground around the tunnel where a closed form is needed, else None.
        wall: the reaction of the opening itself where that is asked for and something yields, else
            None.
    """

    def __init__(
        self,
        profile: FaceProfile | None,
        opening: OpeningAt | None,
        wall: WallReaction | None = None,
    ) -> None:
        self._profile, self._opening, self._wall = profile, opening, wall
        self._known: _AtPoint | None = None

    @property
    def by_reaction(self) -> bool:
        """Whether distances become parts by the reaction curve of round ground that yields."""
        if self._profile is None or self._opening is None:
            return False
        return self._profile.conversion in (None, "reaction-curve")

    @property
    def by_wall(self) -> bool:
        """Whether they do so by the reaction of the opening itself."""
        return self._wall is not None

    def forget(self) -> None:
        """Begin the next answer as a new model does."""
        self._known = None
        if self._wall is not None:
            self._wall.forget()

    def part(self, release: Release, point: ParameterPoint, stage: str) -> Dual:
        """The part of the stress (), 0 to 1, that is released.

        Args:
            release: what the case says of it.
            point: the parameters.
            stage: at which, for messages.

        Raises:
            ModelError: the ground has no reaction curve that would tell.
        """
        if isinstance(release, Scalar):
            return point.number(release)
        known = self._at(point)
        if release not in known.parts:
            with _said_of(stage):
                known.parts |= self._found(release, point, known.curve)
        return known.parts[release]

    def _found(
        self, release: FaceDistance, point: ParameterPoint, curve: ReactionCurve | None
    ) -> Mapping[FaceDistance, Dual]:
        """The part of a distance, and those that are found with it."""
        if self._wall is not None:
            every = self._wall.releases
            return self._wall.parts([self._share(r.distance, point, curve) for r in every], point)
        share = self._share(release.distance, point, curve)
        by_curve = curve is not None and self.by_reaction
        return {release: curve.part_for(share) if curve is not None and by_curve else share}

    def share(self, distance: Scalar, point: ParameterPoint, stage: str) -> Dual:
        """The part of its final motion () that the wall has made.

        Args:
            distance: of the section behind the face, m.
            point: the parameters.
            stage: for messages.

        Raises:
            ModelError: the plastic radius is not known, see `ReactionCurve.final`.
        """
        with _said_of(stage):
            return self._share(distance, point, self._at(point).curve)

    def _at(self, point: ParameterPoint) -> _AtPoint:
        """What is known at a parameter point; that of the last one is kept."""
        known = self._known
        if known is None or known.point is not point:
            curve = None
            if self._opening is not None:
                wider = ParameterPoint(point.values, (*point.names, _PART))
                curve = ReactionCurve(self._opening(wider))
            known = self._known = _AtPoint(point, curve)
        return known

    def _share(self, distance: Scalar, point: ParameterPoint, curve: ReactionCurve | None) -> Dual:
        profile = self._profile
        assert profile is not None
        away = point.number(distance) / point.number(profile.radius)
        if profile.law == "vlachopoulos-diederichs":
            return vlachopoulos_diederichs(away, self._ratio(point, curve))
        first, second = (point.number(constant) for constant in profile.constants)
        return (panet if profile.law == "panet" else chern)(away, first, second)

    def plastic_ratio(self, point: ParameterPoint) -> Dual:
        """R* = R_p / R (); 1 where nothing yields.

        Args:
            point: the parameters.

        Raises:
            ModelError: see `ReactionCurve.final`.
        """
        with _said_of(""):
            return self._ratio(point, self._at(point).curve)

    def _ratio(self, point: ParameterPoint, curve: ReactionCurve | None) -> Dual:
        profile = self._profile
        if profile is not None and profile.plastic_radius is not None:
            return point.number(profile.plastic_radius) / point.number(profile.radius)
        return point.constant(1.0) if curve is None else Dual(curve.final[1].columns[:-1])


def vlachopoulos_diederichs(away: Dual, ratio: Dual) -> Dual:
    """Part of its final motion that a wall has made.

    Args:
        away: () x / R, negative ahead of the face. At the face the slope is that behind it.
        ratio: () R* = R_p / R.
    """
    at_face = AT_FACE * (-BY_PLASTIC * ratio).exp()
    if away.value < 0.0:
        return at_face * away.exp()
    return 1.0 - (1.0 - at_face) * (-BEHIND * away / ratio).exp()


def panet(away: Dual, alpha: Dual, m: Dual) -> Dual:
    """The same behind a face.

    Args:
        away: () x / R, 0 or more.
        alpha: () at the face.
        m: () how far it reaches, in radii.
    """
    left = m / (m + away)
    return alpha + (1.0 - alpha) * (1.0 - left * left)


def chern(away: Dual, reach: Dual, exponent: Dual) -> Dual:
    """The same.

    Args:
        away: () x / R, negative ahead of the face.
        reach: () of the face, in radii.
        exponent: () of the profile.
    """
    return (1.0 + (-away / reach).exp()).power(-exponent)

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

A case may average one with others, s = s_0 + sum w_k (s_k - s_0). Weights that are parameters with
a prior let intervals contain the choice between the profiles. They may be less than 0 and more than
1, so that no bound cuts their distribution; s stays from 0 to 1.

In elastic ground the wall moves in proportion to the stress that is released: lambda = s. Where the
ground at the wall yields, lambda is found on its reaction curve (`closed_forms`) so that the wall
without support has made that part of its motion, u(lambda) = s u(1): ground that yields moves most
at the end, so that lambda is larger than s. The conversion *mesh* asks the same of the wall of a
mesh (`mesh_reaction`); the *direct* conversion takes lambda = s where the ground yields, too.

u(lambda) is convex, so Newton's method from lambda = 1 comes down on its root; its derivatives
follow from those of the closed form by the theorem of implicit functions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property

import numpy as np

from geoident.errors import CollapseError, ModelError
from geoident.forward.analysis.plastic_step import WarmStart
from geoident.forward.openings.closed_forms import NO_EQUILIBRIUM, BeyondClosedForm, Opening
from geoident.forward.openings.mesh_reaction import MeshReaction, NoFinalMotion
from geoident.model.actions import FaceDistance, FaceProfile, Release
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.parameter import Scalar

AT_FACE, BY_PLASTIC, BEHIND = 1.0 / 3.0, 0.15, 1.5
"""Constants of Vlachopoulos and Diederichs: s_0 = AT_FACE exp(-BY_PLASTIC R*), 3/2 behind it."""

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


@contextmanager
def _at_stage(stage: str) -> Iterator[None]:
    """Turn a missing final motion into an error of a stage; "" for none."""
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
        profile: FaceProfile | None = None,
        opening: OpeningAt | None = None,
        wall: MeshReaction | None = None,
    ) -> None:
        self.profile, self.opening, self.wall = profile, opening, wall
        self._last: FaceAtPoint | None = None

    @property
    def by_reaction(self) -> bool:
        """Whether distances become parts by the reaction curve of round ground that yields."""
        if self.profile is None or self.opening is None:
            return False
        return self.profile.conversion in (None, "reaction-curve")

    @property
    def warm(self) -> WarmStart | None:
        """Where the analyses of the opening in the mesh may start; None without them."""
        return None if self.wall is None else self.wall.warm

    def forget(self) -> None:
        """Begin the next answer as a new model does."""
        self._last = None
        if self.wall is not None:
            self.wall.forget()

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
        return self.at(point).part(release, stage)

    def at(self, point: ParameterPoint) -> FaceAtPoint:
        """What distances say at some parameters; the stages of one analysis share it."""
        if self._last is None or self._last.point is not point:
            self._last = FaceAtPoint(self, point)
        return self._last


class FaceAtPoint:
    """What the distances to a face say at one parameter point.

    Args:
        face: of the case, with a profile.
        point: the parameters.
    """

    def __init__(self, face: AdvancingFace, point: ParameterPoint) -> None:
        self.point = point
        self._face = face
        self._parts: dict[FaceDistance, Dual] = {}

    def share(self, distance: Scalar | Dual, stage: str) -> Dual:
        """The part of its final motion () that the wall without support has made.

        Args:
            distance: of the section behind the face, m.
            stage: for messages.

        Raises:
            ModelError: the plastic radius is not known.
        """
        with _at_stage(stage):
            return self._share(distance)

    def part(self, release: FaceDistance, stage: str) -> Dual:
        """The part of the stress () that is released; see `AdvancingFace.part`."""
        if release not in self._parts:
            with _at_stage(stage):
                self._parts |= self._convert(release)
        return self._parts[release]

    def _convert(self, release: FaceDistance) -> Mapping[FaceDistance, Dual]:
        """The part of a distance, and those that are known with it."""
        if (wall := self._face.wall) is not None:
            return wall.parts([self._share(r.distance) for r in wall.releases], self.point)
        share = self._share(release.distance)
        return {release: self._part_for(share) if self._face.by_reaction else share}

    def _share(self, distance: Scalar | Dual) -> Dual:
        profile = self._face.profile
        assert profile is not None
        metres = distance if isinstance(distance, Dual) else self.point.number(distance)
        away = metres / self.point.number(profile.radius)
        own = self._share_by(profile, away)
        share = own
        for one, weight in profile.averaged:
            share = share + self.point.number(weight) * (self._share_by(one, away) - own)
        return (
            share
            if 0.0 <= share.value <= 1.0
            else self.point.constant(np.clip(share.value, 0.0, 1.0))
        )

    def _share_by(self, profile: FaceProfile, away: Dual) -> Dual:
        """The part of its final motion by one profile at x / R."""
        if profile.law == "vlachopoulos-diederichs":
            return vlachopoulos_diederichs(away, self.plastic_ratio)
        first, second = (self.point.number(constant) for constant in profile.constants)
        return (panet if profile.law == "panet" else chern)(away, first, second)

    @property
    def plastic_ratio(self) -> Dual:
        """R* = R_p / R (); 1 where nothing yields.

        Raises:
            NoFinalMotion: it is not known.
        """
        profile = self._face.profile
        if profile is not None and profile.plastic_radius is not None:
            return self.point.number(profile.plastic_radius) / self.point.number(profile.radius)
        if self._face.opening is None or (radius := self._final[1]) is None:
            return self.point.constant(1.0)
        return Dual(radius.columns[:-1])

    def _part_for(self, share: Dual) -> Dual:
        """The part of the stress that is released when the wall has made a share of its motion."""
        moved, part, low, high = self._final[0], 1.0, 0.0, 1.0
        aim = share * Dual(moved.columns[:-1])
        for _ in range(_MOST_STEPS):
            off = float(moved.value - aim.value)
            low, high = (low, part) if off > 0.0 else (part, high)
            after = part - off / float(moved.columns[-1])
            after = after if low <= after <= high else 0.5 * (low + high)
            step, part = abs(after - part), after
            moved, _ = self._moved(part)
            if step <= _SMALL:
                break
        by_point = Dual(moved.columns[:-1]) - aim
        return Dual(np.append(part, -by_point.columns[1:] / moved.columns[-1]))

    @cached_property
    def _final(self) -> tuple[Dual, Dual | None]:
        """Motion and plastic radius of all that is released."""
        return self._moved(1.0)

    @cached_property
    def _opening(self) -> Opening:
        """The opening of radius 1 m, differentiated by the released part, too."""
        assert self._face.opening is not None
        return self._face.opening(ParameterPoint(self.point.values, (*self.point.names, _PART)))

    def _moved(self, part: float) -> tuple[Dual, Dual | None]:
        """Motion of the wall inwards and plastic radius (None: elastic), as multiples of R.

        Their last derivative is that by the part of the stress that is released.

        Raises:
            NoFinalMotion: the ground has no equilibrium, or none in closed form.
        """
        far = self._opening.rock.pressure
        released = Dual.constant(part, far.n)
        released.columns[-1] = 1.0
        try:
            state = self._opening.under((1.0 - released) * far)
        except BeyondClosedForm as beyond:
            collapse = beyond.reason == NO_EQUILIBRIUM
            raise NoFinalMotion(beyond.reason, collapse=collapse) from beyond
        return state.wall_inwards, state.plastic_radius


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

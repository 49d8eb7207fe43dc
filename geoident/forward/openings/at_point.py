"""The ground around an opening at one parameter vector, from stage to stage.

Of a case this needs the ground at the wall with its elastic constants and strength, the in-situ
stress at the centre, whose mean in the plane is p0, and the pressure inside at every state,

    p = (1 - released part) p0 + pressures on the wall + pressures of supports.

All numbers have one derivative more than the point has parameters, the last one: that by p.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise

import numpy as np

from geoident.errors import CollapseError, ModelError
from geoident.forward.in_situ.stress import InSituStress
from geoident.forward.openings.advance import AdvancingFace
from geoident.forward.openings.closed_forms import (
    NO_EQUILIBRIUM,
    BeyondClosedForm,
    GroundState,
    Opening,
    Rock,
    WallLimit,
    flow_slope,
    mohr_coulomb,
)
from geoident.forward.openings.hoek_brown import HoekBrownLimit
from geoident.forward.openings.site import OpeningSite
from geoident.forward.openings.supports import PRESSURE, Support, equilibrium, support_line
from geoident.forward.stages import CaseOnMesh
from geoident.model.actions import FaceDistance, Pressure
from geoident.model.case import Material
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.ground import Isotropic
from geoident.model.parameter import Scalar
from geoident.model.structures import Ring, Structure
from geoident.model.yielding import HoekBrown, MohrCoulomb

_STEPS = np.linspace(0.0, 1.0, 9) ** 2
"""Parts of a stage in which concrete that hardens has one age: shorter where the face is near."""


class OpeningAtPoint:
    """An opening of a case; pressures and stresses are positive in compression.

    Args:
        on_mesh: the case.
        site: where the opening is.
        in_situ: stress at the centre and around it; see `stress`.
        point: the parameters.
        face: what turns distances to it into released parts.

    Attributes:
        stress: (4, k) in-situ stress xx, yy, zz, xy, the first at the centre; tension positive, Pa.
        opening: with the ground around it.
        deviation: (xx - yy) / 2 at the centre, positive where x is pressed more, Pa.
        shear: xy at the centre, of the same sign.
    """

    def __init__(
        self,
        on_mesh: CaseOnMesh,
        site: OpeningSite,
        in_situ: InSituStress,
        point: ParameterPoint,
        face: AdvancingFace,
    ) -> None:
        self._case, self._states, self._site = on_mesh.case, on_mesh.sequence.states, site
        self._material = self._case.materials[self._states[0].materials[site.ground]]
        self._point = ParameterPoint(point.values, (*point.names, PRESSURE))
        self._face = face
        self._reached: dict[int, GroundState] = {}
        self._supports: dict[int, dict[str, Dual]] = {}
        self._limits: dict[int, dict[str, float]] = {}
        self.stress = stress = Dual(in_situ.columns(self._point))
        xx, yy, _, xy = (-stress[row][0] for row in range(4))
        self.deviation, self.shear = 0.5 * (xx - yy), xy
        self.opening = opening_in(self._material, stress, site.radius, self._point)

    def state(self, n: int) -> GroundState:
        """The ground at a state in which the opening is there.

        Raises:
            ModelError: it has no equilibrium, or none in closed form.
        """
        state, name = self._follow(n), self._states[n].name
        wall = state.stresses(np.array([self._site.radius]))
        least = min(float(stress.value[0]) for stress in wall)
        for surface in self._material.yields:
            tension = surface.tension if isinstance(surface, MohrCoulomb | HoekBrown) else None
            if tension is not None and least < -float(self._point.number(tension).value):
                raise ModelError(
                    f"at stage '{name}' the wall of the opening is torn by tension, for which "
                    "there is no closed form"
                )
        return state

    def released(self, n: int) -> Dual:
        """The part of the stress () that is released at a state with the opening."""
        state = self._states[n]
        (part,) = {state.release.get(g, Scalar(1.0)) for g in self._site.groups}
        return self._face.part(part, self._point, state.name)

    def supports(self, n: int) -> dict[str, tuple[float, float]]:
        """Pressure of each support at a state with the opening, and its capacity (or inf), Pa."""
        self.state(n)
        pressures = self._supports[n]
        return {name: (float(p.value), self._limits[n][name]) for name, p in pressures.items()}

    def _follow(self, n: int) -> GroundState:
        """The ground at a state, from the one on which it builds; none is computed twice."""
        if n not in self._reached:
            at, carried = self._states[n], dict[str, Dual]()
            ground, pressure = self.opening.under, self.opening.rock.pressure
            moved = 0.0 * pressure
            if self._opened(at.base):
                state = self._follow(at.base)
                ground, pressure, moved = state.onward, state.pressure, state.wall_inwards
                carried = self._supports[at.base]
            hardens = any(_time_scale(self._case.structures[name]) for name in at.structures)
            steps = _STEPS if hardens else _STEPS[[0, -1]]
            try:
                for first, last in pairwise(steps):
                    outside = self._outside(n, last)
                    supports = self._standing(n, first, last, carried)
                    state, carried = (
                        equilibrium(ground, (pressure, moved), outside, supports)
                        if supports
                        else (ground(outside), {})
                    )
                    ground, pressure, moved = state.onward, state.pressure, state.wall_inwards
            except BeyondClosedForm as beyond:
                reason = beyond.reason
                text = f"at stage '{at.name}' the ground around the opening fails: {reason}"
                if reason == NO_EQUILIBRIUM:
                    raise CollapseError(text, stage=at.name, fraction=float("nan")) from beyond
                raise ModelError(text) from beyond
            self._reached[n], self._supports[n] = state, carried
            self._limits[n] = {
                support.name: np.inf if support.capacity is None else float(support.capacity.value)
                for support in supports
            }
        return self._reached[n]

    def _opened(self, n: int) -> bool:
        """Whether the opening is there at a state."""
        return not self._site.groups & self._states[n].materials.keys()

    def _outside(self, n: int, part: float) -> Dual:
        """What presses on the wall beside supports when a part of a stage is over, Pa."""
        base, p0 = self._states[n].base, self.opening.rock.pressure
        if part == 1.0:
            return (1.0 - self.released(n)) * p0 + self._loads(n)
        released, loads = self._point.constant(0.0), 0.0 * p0
        if self._opened(base):
            released, loads = self.released(base), self._loads(base)
        over = self._point.constant(part)  # of the motion of the stage, by the profile
        if (distance := self._between(self._distance, n, part)) is not None:
            face, name = self._face.at(self._point), self._states[n].name
            ends = [self._distance(state) for state in (base, n)]
            first, now, last = (
                face.share(x, name) for x in (ends[0], distance, ends[1]) if x is not None
            )
            if last.value > first.value:
                over = (now - first) / (last - first)
        released = released + (self.released(n) - released) * over
        return (1.0 - released) * p0 + loads + (self._loads(n) - loads) * over

    def _loads(self, n: int) -> Dual:
        """Pressures on the wall that the case gives, Pa."""
        total = self._point.constant(0.0)
        for load in self._states[n].loads.values():
            assert isinstance(load, Pressure)
            total = total + self._point.number(load.value)
        return total

    def _standing(
        self, n: int, first: float, last: float, carried: Mapping[str, Dual]
    ) -> list[Support]:
        """The supports of a stage between two parts of it, with what they carried before."""
        at, standing = self._states[n], []
        for name in sorted(at.structures):
            structure, none = self._case.structures[name], self._point.constant(0.0)
            stiffness, limit = support_line(structure, self._site.radius, self._point)
            if (scale := _time_scale(structure)) is not None:
                T = self._point.number(scale)
                young, old = (
                    1.0 - (-self._age(n, name, part) / T).exp()
                    for part in (0.25 * (first**0.5 + last**0.5) ** 2, last)
                )
                stiffness, limit = stiffness * young, None if limit is None else limit * old
            before = none if name in at.built and first == 0.0 else carried[name]
            standing.append(Support(name, stiffness, limit, before))
        return standing

    def _age(self, n: int, name: str, part: float) -> Dual:
        """Age of a ring when a part of a stage is over, s, or the way of the face since then, m."""
        ring, born = self._case.structures[name], n
        assert isinstance(ring, Ring)
        while name not in self._states[born].built:
            born = self._states[born].base
        clock = self._distance if ring.hardening_time is None else self._date
        now, then = self._between(clock, n, part), clock(self._states[born].base)
        assert now is not None
        assert then is not None
        return now - then

    def _between(self, clock: Callable[[int], Dual | None], n: int, part: float) -> Dual | None:
        """What a clock shows when a part of a stage is over; None where it does not go."""
        before, after = clock(self._states[n].base), clock(n)
        if before is None or after is None:
            return None
        return before + (after - before).times(part)

    def _date(self, n: int) -> Dual | None:
        """Date of the end of a state, s; None where none is given."""
        date = self._case.times.get(self._states[n].name)
        return None if date is None else self._point.constant(date)

    def _distance(self, n: int) -> Dual | None:
        """Distance of the section behind the face at a state, m; None where none is given."""
        releases = {self._states[n].release.get(g) for g in self._site.groups}
        distances = [r.distance for r in releases if isinstance(r, FaceDistance)]
        return self._point.number(distances[0]) if distances else None


def _time_scale(structure: Structure) -> Scalar | None:
    """The time, s, or the way of the face, m, in which a ring hardens; None: it does not."""
    if not isinstance(structure, Ring):
        return None
    return structure.hardening_time or structure.hardening_distance


def opening_in(material: Material, stress: Dual, radius: float, point: ParameterPoint) -> Opening:
    """A circular opening in ground under a far stress of which the mean counts.

    Args:
        material: the ground, with at most one yield limit.
        stress: (4, k) in-situ stress xx, yy, zz, xy, the first at the centre; tension positive, Pa.
        radius: of the opening, m.
        point: the parameters.
    """
    elastic, number = material.elastic, point.number
    assert isinstance(elastic, Isotropic)
    if elastic.E is not None and elastic.nu is not None:
        E, nu = number(elastic.E), number(elastic.nu)
    else:
        assert elastic.K is not None
        assert elastic.G is not None
        K, G = number(elastic.K), number(elastic.G)
        E, nu = 9.0 * K * G / (3.0 * K + G), (3.0 * K - 2.0 * G) / (6.0 * K + 2.0 * G)
    xx, yy, zz = (-stress[row][0] for row in range(3))
    limit: WallLimit | None = None
    for surface in material.yields:
        if isinstance(surface, HoekBrown):
            assert surface.dilation is not None
            flow = flow_slope(number(surface.dilation))
            limit = HoekBrownLimit(number(surface.sigci), *surface.rock_mass(number), flow)
        else:
            assert isinstance(surface, MohrCoulomb)
            dilation = surface.friction if surface.dilation is None else surface.dilation
            limit = mohr_coulomb(*map(number, (surface.cohesion, surface.friction, dilation)))
    return Opening(radius, Rock(E, nu, 0.5 * (xx + yy), zz), limit)

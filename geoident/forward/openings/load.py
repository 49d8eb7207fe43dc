"""The ground around an opening at one parameter vector, and its state at every stage."""

from __future__ import annotations

import numpy as np

from geoident.errors import CollapseError, ModelError
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
from geoident.forward.stages import ConstructionSequence
from geoident.model.actions import Pressure
from geoident.model.case import Material
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.ground import Isotropic
from geoident.model.parameter import Scalar
from geoident.model.yielding import HoekBrown, MohrCoulomb

_WHOLE = Scalar(1.0)


class OpeningLoad:
    """Numbers of a case as dual numbers, pressures positive in compression.

    Args:
        sequence: the states of the case.
        site: where the opening is.
        material: of the ground around it.
        stress: (4, k) in-situ stress xx, yy, zz, xy, the first at the centre; tension positive, Pa.
        point: the parameters.
        face: what turns distances to it into released parts.

    Attributes:
        stress: see above.
        rock: the ground.
        opening: in it.
        deviation: (xx - yy) / 2 at the centre, positive where x is pressed more, Pa.
        shear: xy at the centre, of the same sign.
    """

    def __init__(
        self,
        sequence: ConstructionSequence,
        site: OpeningSite,
        material: Material,
        stress: Dual,
        point: ParameterPoint,
        face: AdvancingFace,
    ) -> None:
        self._sequence, self._site, self._point = sequence, site, point
        self._face = face
        self._reached: dict[int, GroundState] = {}
        surfaces = [s for s in material.yields if isinstance(s, MohrCoulomb | HoekBrown)]
        self._limits = [s.tension for s in surfaces if s.tension is not None]
        self.stress = stress
        xx, yy, _, xy = (-stress[row][0] for row in range(4))
        self.deviation, self.shear = 0.5 * (xx - yy), xy
        self.opening = opening_in(material, stress, site.radius, point)
        self.rock = self.opening.rock

    def at(self, n: int) -> tuple[GroundState, Dual]:
        """The ground at a state in which the opening is there, and the released part of stress.

        Raises:
            ModelError: it has no equilibrium, or none in closed form.
        """
        if n not in self._reached:
            self._follow(n)
        state = self._reached[n]
        self._refuse_tension(state, self._sequence.states[n].name)
        return state, self._released(n)

    def _follow(self, n: int) -> None:
        """Go the way to a state, from the last that is known on it.

        Raises:
            ModelError: the ground has no equilibrium on it, or none in closed form.
        """
        way = [int(k) for k in self._sequence.built_on[:, n].nonzero()[0] if self._is_open(int(k))]
        before: GroundState | None = None
        for k in way:
            try:
                before = self._reached.get(k) or self.opening.onward(before, self._pressure(k))
            except BeyondClosedForm as beyond:
                raise _failure(self._sequence.states[k].name, beyond.reason) from beyond
            self._reached[k] = before

    def _refuse_tension(self, state: GroundState, name: str) -> None:
        """The cut-off of tension is no part of the closed form: the wall must not meet it."""
        least = min(float(dual.value[0]) for dual in state.stresses(np.array([self._site.radius])))
        if any(least < -float(self._point.number(limit).value) for limit in self._limits):
            text = f"at stage '{name}' the wall of the opening is torn by tension, for which there "
            raise ModelError(text + "is no closed form")

    def _is_open(self, n: int) -> bool:
        return not self._site.groups & self._sequence.states[n].materials.keys()

    def _released(self, n: int) -> Dual:
        state = self._sequence.states[n]
        (part,) = {state.release.get(g, _WHOLE) for g in self._site.groups}
        return self._face.part(part, self._point, state.name)

    def _pressure(self, n: int) -> Dual:
        """What presses on the wall from inside, Pa."""
        total = (1.0 - self._released(n)) * self.rock.pressure
        for load in self._sequence.states[n].loads.values():
            assert isinstance(load, Pressure)
            total = total + self._point.number(load.value)
        return total


def opening_in(material: Material, stress: Dual, radius: float, point: ParameterPoint) -> Opening:
    """A circular opening in ground under a far stress of which the mean counts.

    Args:
        material: the ground.
        stress: (4, k) in-situ stress xx, yy, zz, xy, the first at the centre; tension positive, Pa.
        radius: of the opening, m.
        point: the parameters.
    """
    xx, yy, zz = (-stress[row][0] for row in range(3))
    E, nu = young_and_poisson(material, point)
    return Opening(radius, Rock(E, nu, 0.5 * (xx + yy), zz), _strength(material, point))


def _failure(stage: str, reason: str) -> ModelError:
    text = f"at stage '{stage}' the ground around the opening fails: {reason}"
    if reason == NO_EQUILIBRIUM:
        return CollapseError(text, stage=stage, fraction=float("nan"))
    return ModelError(text)


def young_and_poisson(material: Material, point: ParameterPoint) -> tuple[Dual, Dual]:
    """E (Pa) and nu of an isotropic material."""
    elastic = material.elastic
    assert isinstance(elastic, Isotropic)
    if elastic.E is not None and elastic.nu is not None:
        return point.number(elastic.E), point.number(elastic.nu)
    assert elastic.K is not None
    assert elastic.G is not None
    K, G = point.number(elastic.K), point.number(elastic.G)
    return 9.0 * K * G / (3.0 * K + G), (3.0 * K - 2.0 * G) / (6.0 * K + 2.0 * G)


def _strength(material: Material, point: ParameterPoint) -> WallLimit | None:
    for surface in material.yields:
        assert isinstance(surface, MohrCoulomb | HoekBrown)
        dilation = None if surface.dilation is None else point.number(surface.dilation)
        if isinstance(surface, HoekBrown):
            assert dilation is not None
            constants = surface.rock_mass(point.number)
            return HoekBrownLimit(point.number(surface.sigci), *constants, flow_slope(dilation))
        cohesion, friction = point.number(surface.cohesion), point.number(surface.friction)
        return mohr_coulomb(cohesion, friction, friction if dilation is None else dilation)
    return None

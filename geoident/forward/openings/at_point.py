"""The ground around an opening at one parameter vector, from stage to stage.

Of a case this needs the ground at the wall with its elastic constants and strength, the in-situ
stress at the centre, whose mean in the plane is p0, and the pressure inside at every state,

    p = (1 - released part) p0 + pressures on the wall.
"""

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


class OpeningAtPoint:
    """An opening of a case; pressures and stresses are positive in compression.

    Args:
        sequence: the states of the case.
        site: where the opening is.
        material: of the ground around it.
        stress: (4, k) in-situ stress xx, yy, zz, xy, the first at the centre; tension positive, Pa.
        point: the parameters.
        face: what turns distances to it into released parts.

    Attributes:
        stress: see above.
        opening: with the ground around it.
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
        self._sequence, self._site, self._material = sequence, site, material
        self._point, self._face = point, face
        self._reached: dict[int, GroundState] = {}
        self.stress = stress
        xx, yy, _, xy = (-stress[row][0] for row in range(4))
        self.deviation, self.shear = 0.5 * (xx - yy), xy
        self.opening = opening_in(material, stress, site.radius, point)

    def state(self, n: int) -> GroundState:
        """The ground at a state in which the opening is there.

        Raises:
            ModelError: it has no equilibrium, or none in closed form.
        """
        state, name = self._follow(n), self._sequence.states[n].name
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
        state = self._sequence.states[n]
        (part,) = {state.release.get(g, Scalar(1.0)) for g in self._site.groups}
        return self._face.part(part, self._point, state.name)

    def _follow(self, n: int) -> GroundState:
        """The ground at a state, from the one on which it builds; none is computed twice."""
        if n not in self._reached:
            at = self._sequence.states[n]
            pressure = (1.0 - self.released(n)) * self.opening.rock.pressure
            for load in at.loads.values():
                assert isinstance(load, Pressure)
                pressure = pressure + self._point.number(load.value)
            closed = self._site.groups & self._sequence.states[at.base].materials.keys()
            try:
                self._reached[n] = (
                    self.opening.under(pressure)
                    if closed
                    else self._follow(at.base).onward(pressure)
                )
            except BeyondClosedForm as beyond:
                reason = beyond.reason
                text = f"at stage '{at.name}' the ground around the opening fails: {reason}"
                if reason == NO_EQUILIBRIUM:
                    raise CollapseError(text, stage=at.name, fraction=float("nan")) from beyond
                raise ModelError(text) from beyond
        return self._reached[n]


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

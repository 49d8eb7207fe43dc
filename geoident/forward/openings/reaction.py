"""The ground reaction curve of an opening, and where the stages of a case lie on it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from geoident.errors import ModelError
from geoident.forward.openings.at_point import OpeningAtPoint
from geoident.forward.openings.closed_forms import BeyondClosedForm, GroundState
from geoident.model.arrays import Floats
from geoident.model.results.opening import GroundReaction

_PRESSURES = 81
"""Points of the curve."""

_RADII = 121
"""Places at which stresses are given."""

_FAR = 4.0
"""Distance up to which stresses are given, in radii of the opening or of what yields."""


def ground_reaction(
    at: OpeningAtPoint, centre: tuple[float, float], stages: Mapping[int, str]
) -> GroundReaction | None:
    """The reaction at some parameters; None where no stage has a closed form.

    Args:
        at: the ground around the opening at these parameters.
        centre: of the opening, m.
        stages: names of the states with the opening, by their numbers.
    """
    opening, a, reached = at.opening, at.opening.radius, dict[str, GroundState]()
    for number, name in stages.items():
        try:
            reached[name] = at.state(number)
        except ModelError:
            continue
    if not reached:
        return None
    states = list(reached.values())
    at_stages = np.array([float(state.pressure.value) for state in states])
    p0, curve = opening.rock.pressure, list[GroundState]()
    pressure = np.linspace(float(p0.value), min(0.0, at_stages.min()), _PRESSURES)
    for inside in pressure:
        try:
            curve.append(opening.under(p0 * 0.0 + float(inside)))
        except BeyondClosedForm:
            break
    standing = {stages[n]: at.supports(n) for n in stages if stages[n] in reached}
    supports = sorted({name for each in standing.values() for name in each})
    missing = (np.nan, np.nan)
    pressed = np.array([[standing[s].get(name, missing) for s in reached] for name in supports])
    pressed = pressed.reshape(len(supports), len(reached), 2)
    radii = np.geomspace(a, _FAR * np.nanmax([a, *_plastic_radii(states)]), _RADII)
    stresses = [state.stresses(radii) for state in states]
    return GroundReaction(
        centre=np.array(centre, dtype=np.float64),
        radius=a,
        in_situ=-np.asarray(at.stress.value[:, 0], dtype=np.float64),
        critical=float("nan") if opening.critical is None else float(opening.critical[0].value),
        pressure=pressure[: len(curve)],
        displacement=_wall(curve),
        plastic_radius=_plastic_radii(curve),
        stages=tuple(reached),
        stage_pressure=at_stages,
        stage_displacement=_wall(states),
        stage_plastic_radius=_plastic_radii(states),
        radii=radii,
        radial=np.stack([radial.value for radial, _, _ in stresses]),
        hoop=np.stack([hoop.value for _, hoop, _ in stresses]),
        supports=tuple(supports),
        support_pressure=pressed[..., 0] if supports else None,
        support_capacity=pressed[..., 1] if supports else None,
    )


def _wall(states: list[GroundState]) -> Floats:
    """(k,) motions of the wall inwards, m."""
    return np.array([float(state.wall_inwards.value) for state in states])


def _plastic_radii(states: list[GroundState]) -> Floats:
    """(k,) how far the ground yields, m; NaN where it is elastic."""
    radii = [state.plastic_radius for state in states]
    return np.array([np.nan if radius is None else float(radius.value) for radius in radii])

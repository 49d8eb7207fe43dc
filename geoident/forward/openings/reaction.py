"""The ground reaction curve of an opening, and where the stages of a case lie on it."""

from __future__ import annotations

import numpy as np

from geoident.errors import ModelError
from geoident.forward.openings.closed_forms import BeyondClosedForm, GroundState
from geoident.forward.openings.field import OpeningField
from geoident.model.arrays import Floats
from geoident.model.parameter import Values
from geoident.model.results.opening import GroundReaction

_POINTS = 81
_RADII = 121
_FAR = 4.0
"""Distance up to which stresses are given, in radii of the opening or of what yields."""


def ground_reaction(field: OpeningField, values: Values) -> GroundReaction | None:
    """The reaction at some parameters; None where no stage has a closed form.

    Args:
        field: the ground around the opening of a case.
        values: parameters by name, SI.
    """
    load = field.load(values)
    reached = []
    for number in field.open_stages:
        try:
            reached.append((number, load.at(number)[0]))
        except ModelError:
            continue
    if not reached:
        return None
    a, states = load.opening.radius, [state for _, state in reached]
    p0 = float(load.rock.pressure.value)
    pressure = np.linspace(p0, min([0.0, *(float(s.pressure.value) for s in states)]), _POINTS)
    curve = []
    for inside in pressure:
        try:
            curve.append(load.opening.under(load.rock.pressure * 0.0 + float(inside)))
        except BeyondClosedForm:
            break
    wide = float(np.nanmax([a, *_plastic_radii(states)]))
    radii = np.geomspace(a, _FAR * wide, _RADII)
    critical = load.opening.critical
    stresses = [state.stresses(radii) for state in states]
    return GroundReaction(
        centre=np.array(field.centre, dtype=np.float64),
        radius=a,
        in_situ=-np.asarray(load.stress.value[:, 0], dtype=np.float64),
        critical=float("nan") if critical is None else float(critical[0].value),
        pressure=pressure[: len(curve)],
        displacement=_wall(curve, a),
        plastic_radius=_plastic_radii(curve),
        stages=tuple(field.stage_name(number) for number, _ in reached),
        stage_pressure=np.array([float(state.pressure.value) for state in states]),
        stage_displacement=_wall(states, a),
        stage_plastic_radius=_plastic_radii(states),
        radii=radii,
        radial=np.stack([radial.value for radial, _, _ in stresses]),
        hoop=np.stack([hoop.value for _, hoop, _ in stresses]),
    )


def _wall(states: list[GroundState], radius: float) -> Floats:
    """(k,) motions of the wall inwards, m."""
    return np.array([-float(state.displacement(np.array([radius])).value[0]) for state in states])


def _plastic_radii(states: list[GroundState]) -> Floats:
    """(k,) how far the ground yields, m; NaN where it is elastic."""
    found = [state.plastic_radius for state in states]
    return np.array([np.nan if own is None else float(own.value) for own in found])

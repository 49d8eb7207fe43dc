"""Thermal strains: eps_0 = alpha dT in every direction, an initial strain of the ground.

The stress that a change of temperature brings is sigma = E (C u - eps_0). Each state imposes the
strain of the *change* of temperature since the state on which it builds, with the expansion of the
material that is there now, so that a change of material keeps the stress. What is placed is free of
stress at the temperature zero of its own count.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import QhullError

from geoident.forward.stages import CaseOnMesh
from geoident.model.actions import PointTemperature, TemperatureField
from geoident.model.arrays import Floats
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.parameter import Scalar


class ThermalStrains:
    """Thermal strains of all states; given temperature fields are interpolated once.

    Args:
        on_mesh: the case on its mesh.
    """

    def __init__(self, on_mesh: CaseOnMesh) -> None:
        self._case, self._sequence = on_mesh.case, on_mesh.sequence
        self._discretization = on_mesh.discretization
        self._fields: dict[tuple[int, int], Floats] = {}  # given temperatures, by field and group

    def change(self, state: int, point: ParameterPoint) -> Floats | None:
        """Normal strain (n_points, 1 + n) that a state imposes, with derivatives; None for none."""
        warmed = self.warmed(state)
        if not warmed:
            return None
        strain = np.zeros((self._discretization.points.n_points, point.n_columns))
        for group in warmed:
            at = self._discretization.points_of[group]
            strain[at] = self.strain(state, group, point).columns
        return strain

    def warmed(self, state: int) -> list[int]:
        """Groups that are there and whose temperature is not that of the state before."""
        if state == 0:
            return []
        current = self._sequence.states[state]
        now, before = current.temperature, self._sequence.states[current.base].temperature
        return sorted(
            g
            for g in now.keys() | before.keys()
            if g in current.materials and (g in current.placed or now.get(g) != before.get(g))
        )

    def strain(self, state: int, group: int, point: ParameterPoint) -> Dual:
        """Normal strain (k or 1,) that a state imposes on a group that it warms.

        Args:
            state: number of the state.
            group: index of the group.
            point: the parameters.
        """
        current = self._sequence.states[state]
        expansion = point.number(self._case.materials[current.materials[group]].expansion)
        change = self._temperature(state, group, point)
        if group not in current.placed:
            change = change - self._temperature(current.base, group, point)
        return change * expansion

    def _temperature(self, state: int, group: int, point: ParameterPoint) -> Dual:
        """Change of temperature of a state at the points of a group, (k or 1,)."""
        temperature = self._sequence.states[state].temperature.get(group)
        if temperature is None:
            return point.constant(np.zeros(1))
        if isinstance(temperature, Scalar):
            return Dual(point.number(temperature).columns[None])
        if isinstance(temperature, PointTemperature):
            at = self._discretization.points_of[group]
            return point.constant(temperature.values[at])
        key = (id(temperature), group)  # of the case, which lasts
        if key not in self._fields:
            positions = self._discretization.points.position[self._discretization.points_of[group]]
            self._fields[key] = interpolate(temperature, positions)
        return Dual(point.number(temperature.factor).columns[None]).times(self._fields[key])


def interpolate(field: TemperatureField, positions: Floats) -> Floats:
    """Values (m,) at positions (m, dim): linear between the points, the nearest beyond them."""
    from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator  # noqa: PLC0415

    points, values = np.array(field.points), np.array(field.values)
    nearest = np.asarray(NearestNDInterpolator(points, values)(positions))
    try:
        inside = np.asarray(LinearNDInterpolator(points, values)(positions))
    except QhullError:  # too few points, or all on a line
        return nearest
    return np.where(np.isnan(inside), nearest, inside)

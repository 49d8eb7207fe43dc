"""Pressure of water: in the pores below a table, and on faces below a level.

With water in the pores the stress of the analysis is the *effective* stress sigma' of the skeleton,
and the ground as a whole carries sigma = sigma' - p (Terzaghi). Equilibrium of the whole,
C^T V (sigma' - p) = f, reads for the skeleton C^T V sigma' = f + C^T V p: the pressure is a load,
and so is its change from stage to stage. Densities below the table are those of saturated ground.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoident.forward.in_situ.surfaces import Depths
from geoident.model.actions import Water, WaterPressure
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.mesh import Mesh
from geoident.model.parameter import Scalar


class PorePressure:
    """Pore pressure at fixed positions.

    Args:
        water: the table and the unit weight.
        mesh: for a table with topography.
        positions: (m, dim) m.
    """

    def __init__(self, water: Water, mesh: Mesh, positions: Floats) -> None:
        self._unit_weight = water.unit_weight
        self._depths = Depths(mesh, water.table, positions)
        self.n_outside = self._depths.n_outside
        self._falling: FacePressure | None = None
        if water.falls is not None:
            assert isinstance(water.table, Scalar)
            load = WaterPressure("", water.table, water.unit_weight, water.falls)
            self._falling = FacePressure(load, positions)

    def at(self, point: ParameterPoint) -> Dual:
        """Pressure (m,), Pa, zero above the table."""
        if self._falling is not None:
            return self._falling.at(point)
        return self._depths.at(point).positive_part() * point.number(self._unit_weight)


class FacePressure:
    """Pressure of water on faces, at fixed positions (m, dim), m."""

    def __init__(self, load: WaterPressure, positions: Floats) -> None:
        self._load = load
        self._height, line = positions[:, -1], load.falls
        if line is None:
            return
        along = line.parts(positions)
        self._left, self._by_drain = 1.0 - along, np.zeros_like(along)
        if line.drain is not None:
            at = float(line.parts(np.array([line.drain.at]))[0])
            self._left = np.interp(along, [0.0, at, 1.0], [1.0, 0.0, 0.0])
            self._by_drain = np.interp(along, [0.0, at, 1.0], [0.0, 1.0, 0.0])

    def at(self, point: ParameterPoint) -> Dual:
        """Pressure (m,), Pa, zero above the level."""
        load = self._load
        level = Dual(point.number(load.level).columns[None])
        if load.falls is not None:
            end = Dual(point.number(load.falls.level).columns[None])
            left = point.constant(self._left)
            if load.falls.drain is not None:
                drain = Dual(point.number(load.falls.drain.left).columns[None])
                left = left + drain.times(self._by_drain)
            level = end + (level - end) * left
        depth = level.plus(-self._height)
        return depth.positive_part() * point.number(load.unit_weight)


def is_wet(water: Water | None, groups: Ints, names: Sequence[str]) -> Bools:
    """Which of some groups have water in their pores where they lie below the table.

    Args:
        water: in the pores, or None for none.
        groups: (m,) group indices.
        names: names of the groups by index.
    """
    if water is None or water.groups is None:
        return np.full(len(groups), water is not None)
    return np.isin(groups, [names.index(name) for name in water.groups if name in names])

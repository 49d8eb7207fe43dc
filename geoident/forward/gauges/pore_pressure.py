"""Pressure of the water in the pores: piezometers, and what total stresses have of it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from geoident.errors import Fault
from geoident.fem.consolidation import pressure_at
from geoident.fem.location import format_point
from geoident.forward.analysis.stage import LinearRows
from geoident.forward.gauges.ground_points import GroundPoint, GroundPoints
from geoident.forward.gauges.observation import AnalysisState, Observable
from geoident.forward.gauges.placement import Placed
from geoident.forward.in_situ.water import PorePressure
from geoident.forward.stages import CaseOnMesh
from geoident.model.actions import Water
from geoident.model.arrays import Bools, Floats
from geoident.model.dual import ParameterPoint
from geoident.model.gauges import Channel


class PoreWater:
    """Pressure of the water at fixed points in the ground.

    Args:
        points: g of them.
        on_mesh: the case on its mesh.
    """

    def __init__(self, points: Sequence[GroundPoint], on_mesh: CaseOnMesh) -> None:
        self._case, self._sequence, self._mesh = on_mesh.case, on_mesh.sequence, on_mesh.mesh
        self._points = points
        self._places = np.array([point.place for point in points]).reshape(-1, on_mesh.mesh.dim)
        self._groups = np.array([self._sequence.groups[point.group] for point in points], object)
        self._pressures: dict[Water, PorePressure] = {}
        service = on_mesh.case.service  # whose uplift is in pores under every level
        uplift = () if service is None else service.uplift
        self._later = [group for one in uplift for group in one.pores]

    def at(self, state: AnalysisState) -> Floats:
        """Pressure (g, 1 + n) at a state, Pa; zero where there is no water."""
        pressure, excess = self._at_rest(state.end.number, state.point), state.end.pores
        if excess is None:
            return pressure
        seen = np.asarray(self._corners @ excess[:, : pressure.shape[1]])
        return pressure + np.where(self._filled(state.end.number)[:, None], seen, 0.0)

    def _at_rest(self, state: int, point: ParameterPoint) -> Floats:
        """Pressure (g, 1 + n) of water that stands still."""
        water, shape = self._sequence.states[state].water, (len(self._groups), point.n_columns)
        if water is None:
            return np.zeros(shape)
        if water not in self._pressures:
            self._pressures[water] = PorePressure(water, self._mesh, self._places)
        pressure = np.broadcast_to(self._pressures[water].at(point).columns, shape)
        return np.where(self.wet(state)[:, None], pressure, 0.0)

    def wet(self, state: int) -> Bools:
        """(g,) which points are in groups with water in their pores at a state, or in service."""
        water = self._sequence.states[state].water
        if water is not None and water.groups is None:
            return np.ones(len(self._groups), dtype=np.bool_)
        groups = self._later if water is None else water.groups
        wet = np.isin(self._groups, list(groups or ()))
        return wet | self._filled(state)

    def _filled(self, state: int) -> Bools:
        """(g,) which points are in ground that water takes time to leave."""
        names, materials = self._sequence.groups, self._sequence.states[state].materials
        filled = [names[g] for g, m in materials.items() if self._case.materials[m].consolidates]
        return np.isin(self._groups, filled)

    @cached_property
    def _corners(self) -> sp.csr_array:
        """(g, n_nodes) how pressures at corners of elements give those at the points."""
        rows = sp.lil_array((len(self._points), self._mesh.n_nodes))
        for row, point in enumerate(self._points):
            nodes, shapes = pressure_at(self._mesh, point.site.element, point.place)
            rows[row, nodes] = shapes
        return sp.csr_array(rows)


class PorePressures(Observable):
    """Pressure of the water in the pores, Pa, compression positive.

    Args:
        water: in the pores, at the points of the channels (g,).
    """

    def __init__(self, water: PoreWater) -> None:
        self._water = water

    def linear(self, state: AnalysisState, wanted: Bools) -> LinearRows:
        """Nothing of the state is in it."""
        return LinearRows()

    def values(self, state: AnalysisState) -> Floats:
        """Values (g, 1 + n + k) at a state, Pa."""
        pressure = self._water.at(state)
        return np.pad(pressure, ((0, 0), (0, state.end.u.shape[1] - pressure.shape[1])))


def pore_pressures(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> Placed:
    """Channels that read the pressure of the water at a point, while its ground has water."""
    placed = GroundPoints.of(channels, on_mesh)
    water = PoreWater(placed.points, on_mesh)
    readable, faults = placed.readable, placed.faults
    if not faults:
        wet = np.array([water.wet(state) for state in range(readable.shape[1])]).T
        readable = readable & wet
        dry = zip(channels, wet, strict=True)
        faults = tuple(_dry_fault(on_mesh, channel) for channel, when in dry if not when.any())
    why = "there is no water in the pores of its ground then"
    return Placed(PorePressures(water), readable, placed.snapped, faults, why)


def _dry_fault(on_mesh: CaseOnMesh, channel: Channel) -> Fault:
    """No water is ever in the pores where a gauge reads its pressure."""
    waters = [state.water for state in on_mesh.sequence.states if state.water is not None]
    named = sorted({name for water in waters for name in water.groups or ()})
    where = f"only in {', '.join(map(repr, named))}" if named else "nowhere"
    return on_mesh.case.source.fault(
        channel.key,
        "no-water-there",
        f"gauge '{channel.name}' reads the pressure of the water in the pores at "
        f"{format_point(channel.second)}, but the case has such water {where}",
        "give 'water' with the level of its table, or correct its 'groups' or the point"
        if on_mesh.case.service is None
        else "give 'service.uplift' with this group in its 'pores', or correct the point",
    )

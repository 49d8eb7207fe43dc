"""Temperature of the ground: thermometers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from geoident.errors import Fault
from geoident.fem.elements import reference_element
from geoident.fem.location import reference_coordinates
from geoident.forward.analysis.stage import LinearRows
from geoident.forward.gauges.ground_points import GONE, GroundPoint, GroundPoints
from geoident.forward.gauges.observation import AnalysisState, Observable
from geoident.forward.gauges.placement import Placed
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Bools, Floats
from geoident.model.gauges import Channel
from geoident.model.mesh import Mesh, spans


class Thermometers(Observable):
    """Temperature at fixed points in the ground, degC.

    Args:
        points: of the channels (g,).
        mesh: the mesh.
    """

    def __init__(self, points: Sequence[GroundPoint], mesh: Mesh) -> None:
        shares = sp.lil_array((len(points), mesh.n_nodes))
        for row, point in enumerate(points):
            for block, span in spans(mesh.blocks):
                if span.start <= point.site.element < span.stop:
                    nodes = block.nodes[point.site.element - span.start]
                    reference = reference_element(block.kind)
                    corners = mesh.points[nodes][None]
                    xi = reference_coordinates(reference, corners, point.place[None])[0]
                    shares[row, nodes] = reference.shapes(xi)
        self._shares = sp.csr_array(shares)

    def linear(self, state: AnalysisState, wanted: Bools) -> LinearRows:
        """Nothing of how the ground moves is in it."""
        return LinearRows()

    def values(self, state: AnalysisState) -> Floats:
        """Values (g, 1 + n + k) at a state, degC."""
        read = np.zeros((self._shares.shape[0], state.end.u.shape[1]))
        if state.end.temperatures is not None:
            seen = np.asarray(self._shares @ state.end.temperatures)
            read[:, : state.point.n_columns] = seen
        return read


def thermometers(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> Placed:
    """Channels that read the temperature at a point, while its ground is there."""
    placed = GroundPoints.of(channels, on_mesh)
    faults = placed.faults
    if not on_mesh.case.conducts:
        faults = tuple(_nothing_to_read(on_mesh, channel) for channel in channels)
    observable = Thermometers(placed.points, on_mesh.mesh)
    return Placed(observable, placed.readable, placed.snapped, faults, GONE)


def _nothing_to_read(on_mesh: CaseOnMesh, channel: Channel) -> Fault:
    """No temperature is computed."""
    served = on_mesh.case.service is not None
    hint = "Add 'initial_temperature' to the case, and how its materials conduct heat."
    return on_mesh.case.source.fault(
        channel.key,
        "no-temperature",
        f"gauge '{channel.name}' reads a temperature, and "
        + (
            "no gauge of a structure in service does yet" if served else "the case conducts no heat"
        ),
        "Remove it: temperatures in service are given by 'loads'." if served else hint,
    )

"""Motion of grouted bars, along themselves or as piles bend, against fixed or the nearby ground."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from geoident.forward.gauges.motion import RelativeDisplacements
from geoident.forward.gauges.on_structures import NOT_STANDING, standing
from geoident.forward.gauges.placement import Placed
from geoident.forward.stages import CaseOnMesh
from geoident.forward.structures.grouted import PlacedBars, place_along
from geoident.forward.structures.placing import present_throughout
from geoident.model.gauges import Channel
from geoident.model.structures import GroutedBars

_ACROSS = 1e-9
"""Of a unit vector, the part along an axis that is rounding."""


def bar_displacements(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> Placed:
    """Channels that read how bars move, while these stand since their zero."""
    readable, faults = standing(channels, on_mesh)
    read = [sp.csr_array((0, on_mesh.mesh.points.size))]
    for channel in channels:
        bars = on_mesh.case.structures[channel.structure]
        present = present_throughout(on_mesh.sequence, channel.structure)
        assert isinstance(bars, GroutedBars)
        if present is None:  # a fault of `standing`
            read.append(sp.csr_array((1, on_mesh.mesh.points.size)))
            continue
        bar, placed = channel.member, PlacedBars(on_mesh, channel.structure, bars, present)
        place = place_along(bars, bar, channel.second)
        rows, own = placed.rows, bar * bars.pieces + place.piece
        site = placed.holding(bar, np.array(place.point), around=True)
        moved = sp.csr_array((1, on_mesh.mesh.points.size))
        for axis, part in enumerate(rows.axes[bar] @ channel.direction):
            if abs(part) < _ACROSS:
                continue
            before, after = rows.ends_of_pieces(axis)
            moved = moved + part * ((1.0 - place.part) * before + place.part * after)[[own]]
            if channel.quantity == "slip":
                moved = moved - part * rows.ground([site], np.array([bar]), axis)
        read.append(sp.csr_array(moved))
    observable = RelativeDisplacements(sp.csr_array(sp.vstack(read)))
    return Placed(observable, readable, faults=faults, unreadable=NOT_STANDING)

"""Motion of grouted bars along themselves, against fixed ground or the ground around them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from geoident.forward.gauges.motion import RelativeDisplacements
from geoident.forward.gauges.on_structures import NOT_STANDING, standing
from geoident.forward.gauges.placement import Placed
from geoident.forward.stages import CaseOnMesh
from geoident.forward.structures.grouted import grouted_rows, place_along
from geoident.forward.structures.placing import present_throughout
from geoident.model.gauges import Channel
from geoident.model.structures import GroutedBars


def bar_displacements(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> Placed:
    """Channels that read how bars move, while these stand since their zero."""
    readable, faults = standing(channels, on_mesh)
    rows = [sp.csr_array((0, on_mesh.mesh.points.size))]
    for channel in channels:
        bars = on_mesh.case.structures[channel.structure]
        present = present_throughout(on_mesh.sequence, channel.structure)
        assert isinstance(bars, GroutedBars)
        if present is None:  # a fault of `standing`
            rows.append(sp.csr_array((1, on_mesh.mesh.points.size)))
            continue
        place = place_along(bars, channel.member, channel.second)
        of_bars = grouted_rows(on_mesh, channel.structure, bars)
        part = np.array([[1.0 - place.part, place.part]])
        nodes = of_bars.nodes[channel.member, place.piece : place.piece + 2]
        moved = sp.csr_array(part) @ of_bars.motion(nodes)
        if channel.quantity == "slip":
            site = on_mesh.locator.best(place.point, present)
            if site is not None:
                moved = moved - of_bars.ground([[site]], np.array([channel.member]))
        sense = float(np.dot(channel.direction, of_bars.direction[channel.member]))
        rows.append(sp.csr_array(np.sign(sense) * moved))
    observable = RelativeDisplacements(sp.csr_array(sp.vstack(rows)))
    return Placed(observable, readable, faults=faults, unreadable=NOT_STANDING)

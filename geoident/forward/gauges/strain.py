"""Strains of the ground at a point, recovered from the strain points around.

The mean strain along a line, such as the pieces of a fibre optic cable, is a sum of motions of
points divided by a length, and is placed as such (`motion`). Structures have the strain of their
forces (`member_forces`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from geoident.fem.kinematics import NORMAL_COMPONENTS
from geoident.forward.gauges.ground_points import GroundPoints
from geoident.forward.gauges.motion import RelativeDisplacements
from geoident.forward.gauges.placement import Placed, is_placed_after
from geoident.forward.gauges.stress import component_weights
from geoident.forward.stages import CaseOnMesh
from geoident.model.gauges import Channel

VOLUME = "volume"
"""The quantity of a channel that reads the sum of the normal strains."""


def strains(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> Placed:
    """Channels that read a strain at a point, while its ground stays from their zero on.

    Ground that is placed right after the zero counts from its placing on.
    """
    placed = GroundPoints.of(channels, on_mesh, as_built=True)
    rows, as_built = [sp.csr_array((0, on_mesh.mesh.points.size))], []
    for point in placed.points:
        channel = point.channel
        weights = component_weights(channel, point.signs, on_mesh.kinematics.n_strain)
        if channel.quantity == VOLUME:
            weights = np.repeat([1.0, 0.0], [NORMAL_COMPONENTS, len(weights) - NORMAL_COMPONENTS])
        elif not channel.quantity:  # n . eps n, with the shear strains gamma = 2 eps
            weights[NORMAL_COMPONENTS:] /= 2.0
        weights = -weights if channel.compression else weights
        rows.append(sp.csr_array(weights[None] @ point.recovery().gradients))
        if is_placed_after(on_mesh.sequence, on_mesh.case.zero_of(channel), point.site):
            as_built.append(channel.name)
    return Placed(
        RelativeDisplacements(sp.csr_array(sp.vstack(rows))),
        placed.readable,
        placed.snapped,
        placed.faults,
        as_built=tuple(as_built),
    )

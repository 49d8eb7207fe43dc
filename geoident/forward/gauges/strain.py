"""Strains: of the ground at a point, along a line in it, and of the fibres of structures.

Along a line, such as the pieces of a fibre optic cable, the mean strain is a sum of displacements
of points divided by a length; it is placed like any other motion. At a point it is recovered from
the strain points around, as the stress is (`fem.recovery`); both are linear in the displacements.
Structures have the strain of their forces: see `structures`.
"""

from __future__ import annotations

from collections.abc import Sequence

import scipy.sparse as sp

from geoident.fem.recovery import recovery
from geoident.forward.gauges.observation import RelativeDisplacements
from geoident.forward.gauges.placement import Placed, is_placed_after
from geoident.forward.gauges.stress import NORMAL_COMPONENTS, Spots, component_weights
from geoident.forward.stages import CaseOnMesh
from geoident.model.gauges import Channel


def strains(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> Placed:
    """Channels that read a strain at a point, while its ground stays from their zero on.

    Ground that is placed right after the zero counts from its placing on.

    The coefficients of a stress n . S n hold for a strain n . eps n too, with shear strains
    gamma = 2 eps halved.
    """
    kinematics, spots = on_mesh.kinematics, Spots.of(channels, on_mesh, as_built=True)
    rows, as_built = [sp.csr_array((0, on_mesh.mesh.points.size))], []
    for spot in spots.found:
        if spot.site is None:
            continue
        element, sequence = spot.site.element, on_mesh.sequence
        group = sequence.group_of == sequence.group_of[element]
        recovered = recovery(on_mesh.mesh, kinematics, element, group, spot.place)
        weights = component_weights(spot.channel, spot.signs, kinematics.n_strain)
        if not spot.channel.quantity:
            weights[NORMAL_COMPONENTS:] /= 2.0
        rows.append(sp.csr_array(weights[None] @ recovered.gradients))
        if is_placed_after(sequence, on_mesh.case.zero_of(spot.channel), spot.site):
            as_built.append(spot.channel.name)
    operator = sp.csr_array(sp.vstack(rows))
    return Placed(
        RelativeDisplacements(operator),
        spots.readable,
        spots.snapped,
        spots.faults,
        as_built=tuple(as_built),
    )

"""Motions of points, against each other or against fixed ground: where they are read, and when."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from geoident.errors import Fault
from geoident.forward.actions.on_beams import site_on_beam
from geoident.forward.analysis.stage import LinearRows
from geoident.forward.gauges.beyond_mesh import beside_fault, is_beside
from geoident.forward.gauges.observation import AnalysisState, Observable
from geoident.forward.gauges.placement import (
    Placed,
    best_site,
    from_zero,
    is_placed_after,
    point_fault,
)
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Bools, Floats
from geoident.model.gauges import Channel


class RelativeDisplacements(Observable):
    """Motions of points against each other or against fixed ground: sums of vector . u, SI.

    Args:
        rows: G', (g, n_dofs).
    """

    def __init__(self, rows: sp.csr_array) -> None:
        self.rows: sp.csr_array = rows

    def linear(self, state: AnalysisState, wanted: Bools) -> LinearRows:
        """G' itself."""
        return LinearRows(u=self.rows)

    def values(self, state: AnalysisState) -> Floats:
        """Values (g, 1 + n + k) at a state, SI."""
        return np.asarray(self.rows @ state.end.u)


def relative_displacements(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> Placed:
    """Channels that read the motion of a point, or of two against each other.

    They can be read while their points stand in ground that has been there since the zero, on the
    way of construction from one to the other; or that is placed right after the zero: what has
    moved before is then no motion of theirs, and the readings count from the placing on. A point
    on a beam between interfaces that stands at the zero is one of this beam.
    """
    kinematics, mesh, sequence = on_mesh.kinematics, on_mesh.mesh, on_mesh.sequence
    rows = sp.lil_array((len(channels), mesh.points.size))
    readable = np.zeros((len(channels), len(sequence.states)), dtype=bool)
    snapped, as_built = list[str](), list[str]()
    faults: dict[tuple[str, tuple[float, ...], str], Fault] = {}
    ends = (point for channel in channels for point, _ in channel.motions)
    on_mesh.locator.find(kinematics.in_section(point)[0] for point in ends)
    for row, channel in enumerate(channels):
        zero = on_mesh.case.zero_of(channel)
        readable[row] = from_zero(on_mesh, channel)
        for point, vector in channel.motions:
            place, turned = kinematics.in_section(point)
            sites, beside = on_mesh.locator.sites(place), None
            on_beam = site_on_beam(on_mesh, place, sequence.states[zero].structures)
            site, stays = best_site(sites, sequence, zero)
            if on_beam is not None:
                site, stays = on_beam, np.ones(len(sequence.states), dtype=bool)
            else:
                beside = beside_fault(on_mesh, channel, point, sites)
            if site is None or beside is not None:
                fault = beside or point_fault(on_mesh, channel, point, sites)
                # once for the end of a casing, to which all its channels refer
                faults.setdefault((channel.gauge, point, channel.zero), fault)
                continue
            moved = np.outer(site.shapes, turned * np.array(vector))
            if channel.turns:
                moved = site.gradients @ (np.array(channel.turns) * np.outer(turned, turned)).T
            dofs = site.nodes[:, None] * mesh.dim + np.arange(mesh.dim)
            rows[[row], dofs.ravel()] += moved.ravel()
            readable[row] &= stays
            if is_beside(site):
                snapped.append(channel.name)
            if on_beam is None and is_placed_after(sequence, zero, site):
                as_built.append(channel.name)
    return Placed(
        RelativeDisplacements(sp.csr_array(rows)),
        readable,
        tuple(dict.fromkeys(snapped)),
        tuple(faults.values()),
        as_built=tuple(dict.fromkeys(as_built)),
    )

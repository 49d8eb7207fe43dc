"""Motions of points, against each other or against fixed ground: where they are read, and when."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from geoident.errors import Fault
from geoident.fem.location import Site
from geoident.forward.gauges.beyond_mesh import beside_fault, is_beside
from geoident.forward.gauges.observation import RelativeDisplacements
from geoident.forward.gauges.placement import (
    Placed,
    best_site,
    from_zero,
    is_placed_after,
    point_fault,
)
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Floats
from geoident.model.gauges import Channel
from geoident.model.mesh import Mesh


def relative_displacements(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> Placed:
    """Channels that read the motion of a point, or of two against each other.

    They can be read while their points stand in ground that has been there since the zero, on the
    way of construction from one to the other; or that is placed right after the zero: what has
    moved before is then no motion of theirs, and the readings count from the placing on.
    """
    kinematics, mesh, rows, readable = on_mesh.kinematics, on_mesh.mesh, [], []
    snapped: list[str] = []
    as_built: list[str] = []
    faults: list[Fault] = []
    nowhere: set[tuple[str, tuple[float, ...], str]] = set()
    ends_of_all = (point for channel in channels for point, _ in channel.motions)
    on_mesh.locator.find(kinematics.in_section(point)[0] for point in ends_of_all)
    for channel in channels:
        ends, stays = [], [from_zero(on_mesh, channel)]
        for point, vector in channel.motions:
            place, turned = kinematics.in_section(point)
            sites = on_mesh.locator.sites(place)
            site, there = best_site(sites, on_mesh.sequence, on_mesh.case.zero_of(channel))
            beside = beside_fault(on_mesh, channel, point, sites)
            if site is None or beside is not None:
                refused = (channel.gauge, point, channel.zero)
                if refused not in nowhere:  # said once of the end of a casing that all refer to
                    faults.append(beside or point_fault(on_mesh, channel, point, sites))
                nowhere.add(refused)
                continue
            moved = np.outer(site.shapes, turned * np.array(vector))
            if channel.turns:
                moved = site.gradients @ (np.array(channel.turns) * np.outer(turned, turned)).T
            ends.append((site, moved))
            stays.append(there)
            if is_beside(site):
                snapped.append(channel.name)
            if is_placed_after(on_mesh.sequence, on_mesh.case.zero_of(channel), site):
                as_built.append(channel.name)
        rows.append(_row(mesh, ends))
        readable.append(np.all(stays, axis=0))
    operator = sp.csr_array(sp.vstack(rows)) if rows else sp.csr_array((0, mesh.n_nodes * mesh.dim))
    when = np.array(readable, bool).reshape(-1, len(on_mesh.sequence.states))
    return Placed(
        RelativeDisplacements(operator),
        when,
        tuple(dict.fromkeys(snapped)),
        tuple(faults),
        as_built=tuple(dict.fromkeys(as_built)),
    )


def _row(mesh: Mesh, ends: list[tuple[Site, Floats]]) -> sp.csr_array:
    """One row of G', from points and what their nodes add to it, (n_a, dim)."""
    columns, values = [np.empty(0, np.int64)], [np.empty(0)]
    for site, moved in ends:
        columns.append((site.nodes[:, None] * mesh.dim + np.arange(mesh.dim)).ravel())
        values.append(moved.ravel())
    column = np.concatenate(columns)
    return sp.csr_array(
        (np.concatenate(values), (np.zeros_like(column), column)),
        shape=(1, mesh.n_nodes * mesh.dim),
    )

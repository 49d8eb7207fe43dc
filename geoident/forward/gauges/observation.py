"""What the gauges see: the rows of G', and from when to when each channel can be read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from geoident.errors import Fault
from geoident.fem.kinematics import kinematics_of
from geoident.fem.location import Locator, Site
from geoident.forward.stages import ConstructionSequence
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import Channel
from geoident.model.mesh import Mesh


@dataclass(frozen=True)
class Observation:
    """The gauges of a case on its mesh.

    Args:
        channels: names, in the order of the rows.
        operator: G', (n_channels, n_dofs) sparse: relative displacements from displacements.
        zero: (n_channels,) state at which each channel reads zero.
        readable: (n_states, n_channels) when its points stand in ground that has been there since
            its zero, on the way of construction from one to the other.
        snapped: names of channels with a point just outside the mesh.
    """

    channels: tuple[str, ...]
    operator: sp.csr_array
    zero: Ints
    readable: Bools
    snapped: tuple[str, ...]

    def unreadable(self, channel: str, state: int) -> str | None:
        """Why a channel can't be read at a state, or None if it can."""
        row = self.channels.index(channel)
        if state < self.zero[row]:
            return "it is zeroed only at a later stage"
        if not self.readable[state, row]:
            return "a point of it stands in ground that is no longer there"
        return None


def observe(
    case: Case, mesh: Mesh, locator: Locator, sequence: ConstructionSequence
) -> tuple[Observation, list[Fault]]:
    """The observation operator of a case, and what is wrong with its gauges."""
    names = case.stage_names
    kinematics = kinematics_of(case.analysis)
    rows, zeros, readable, snapped = [], [], [], []
    faults: list[Fault] = []
    for channel in case.channels:
        zero = names.index(channel.zero)
        ends = []
        for point, sign in ((channel.first, -1.0), (channel.second, 1.0)):
            if point is None:
                continue
            place, turned = kinematics.in_section(point)
            sites = locator.sites(place)
            site, stays = best_site(sites, sequence, zero)
            if site is None:
                faults.append(_point_fault(case, mesh, sequence, channel, point, sites))
                continue
            ends.append((site, sign * turned, stays))
            if site.outside > 1e-6:
                snapped.append(channel.name)
        rows.append(_row(mesh, channel, [(site, signs) for site, signs, _ in ends]))
        zeros.append(zero)
        readable.append(~_before(sequence, zero) & np.all([stays for *_, stays in ends], axis=0))
    operator = sp.csr_array(sp.vstack(rows)) if rows else sp.csr_array((0, mesh.n_nodes * mesh.dim))
    found = Observation(
        tuple(channel.name for channel in case.channels), operator, np.array(zeros, np.int64),
        np.array(readable, bool).reshape(-1, len(sequence.states)).T, tuple(dict.fromkeys(snapped)),
    )  # fmt: skip
    return found, faults


def best_site(
    sites: tuple[Site, ...], sequence: ConstructionSequence, zero: int
) -> tuple[Site | None, Bools]:
    """The site that stays for most states from the zero on, the best-lying one among equals.

    Returns:
        The site, None if none is there at the zero; (n_states,) the states at which it is there and
        has been there on the way of construction from the zero.
    """
    best, longest = None, np.zeros(len(sequence.states), dtype=bool)
    for site in sites:
        stays = _stays(sequence, zero, site.element)
        if stays.sum() > longest.sum():
            best, longest = site, stays
    return best, longest


def _stays(sequence: ConstructionSequence, zero: int, element: int) -> Bools:
    """(n_states,) states from the zero on to which no stage without the element leads."""
    group = sequence.group_of[element]
    gone = np.array([group not in state.materials for state in sequence.states])
    built_on = sequence.built_on
    way = built_on ^ built_on[:, [zero]]
    way[zero] = True
    return np.asarray(~(gone[:, None] & way).any(axis=0) & ~_before(sequence, zero))


def _before(sequence: ConstructionSequence, zero: int) -> Bools:
    """(n_states,) states before the zero."""
    return np.arange(len(sequence.states)) < zero


def _row(mesh: Mesh, channel: Channel, ends: list[tuple[Site, Floats]]) -> sp.csr_array:
    """One row of G': direction . (u(second) - u(first)); each end with its signs (dim,)."""
    direction = np.array(channel.direction)
    columns, values = [np.empty(0, np.int64)], [np.empty(0)]
    for site, signs in ends:
        columns.append((site.nodes[:, None] * mesh.dim + np.arange(mesh.dim)).ravel())
        values.append(np.outer(site.shapes, signs * direction).ravel())
    column = np.concatenate(columns)
    return sp.csr_array(
        (np.concatenate(values), (np.zeros_like(column), column)),
        shape=(1, mesh.n_nodes * mesh.dim),
    )


def reading_faults(case: Case, observation: Observation) -> list[Fault]:
    """Readings that were taken when the gauge could not be read."""
    names = case.stage_names
    faults = []
    for reading in case.readings:
        reason = observation.unreadable(reading.channel, names.index(reading.stage))
        if reading.value is not None and reason and not reading.bad:
            faults.append(
                Fault(
                    "unreadable-gauge",
                    f"gauge '{reading.channel}' can't have been read at stage "
                    f"'{reading.stage}': {reason}",
                    "leave the value blank, or correct the stage, the gauge's 'zero' or its points",
                    reading.location,
                )
            )
    return faults


def _point_fault(
    case: Case,
    mesh: Mesh,
    sequence: ConstructionSequence,
    channel: Channel,
    point: tuple[float, ...],
    sites: tuple[Site, ...],
) -> Fault:
    place = format_point(point)
    if not sites:
        low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
        return case.source.fault(
            channel.key,
            code="gauge-outside",
            message=f"point {place} of gauge '{channel.name}' lies outside the mesh",
            hint=f"the mesh reaches from {format_point(low)} to {format_point(high)}",
        )
    groups = sorted({sequence.groups[sequence.group_of[site.element]] for site in sites})
    return case.source.fault(
        channel.key,
        code="gauge-in-absent-ground",
        message=f"point {place} of gauge '{channel.name}' stands in '{', '.join(groups)}', which "
        f"is not there at stage '{channel.zero}', where the gauge is zeroed",
        hint="set 'zero' to a stage at which that ground is present, or correct the point",
    )


def format_point(point: tuple[float, ...] | Floats) -> str:
    """A point for a message.

    >>> format_point((1.0, -2.5))
    '(1, -2.5) m'
    """
    return f"({', '.join(f'{x:.6g}' for x in point)}) m"

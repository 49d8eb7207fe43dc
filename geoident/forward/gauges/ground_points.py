"""Points of gauges in the ground: their element, and when ground is there.

What stresses, strains and pressures of water in the pores have in common: they are read at one
point, from the strain points of the ground around.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoident.errors import Fault
from geoident.fem.location import Site
from geoident.fem.recovery import Recovery, recovery
from geoident.forward.gauges.beyond_mesh import beside_fault, is_beside
from geoident.forward.gauges.placement import best_site, point_fault
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Bools, Floats
from geoident.model.gauges import Channel, Reads

GONE = "the ground at its point is not there then"


@dataclass(frozen=True)
class GroundPoint:
    """The point of a channel in the ground.

    Args:
        channel: read at its second point.
        place: (dim,) in the section, m.
        signs: (dim,) of the axes there: across the axis of revolution x is turned.
        site: the element that holds it.
        on_mesh: the case on its mesh.
    """

    channel: Channel
    place: Floats
    signs: Floats
    site: Site
    on_mesh: CaseOnMesh

    @property
    def group(self) -> int:
        """Index of the group of its ground."""
        return int(self.on_mesh.sequence.group_of[self.site.element])

    def recovery(self) -> Recovery:
        """How stress and strain there follow from the strain points of its group around."""
        on_mesh = self.on_mesh
        same = on_mesh.sequence.group_of == self.group
        return recovery(on_mesh.mesh, on_mesh.kinematics, self.site.element, same, self.place)


@dataclass(frozen=True)
class GroundPoints:
    """The points of some channels (g) in the ground.

    Args:
        points: of each channel that stands in ground.
        readable: (g, n_states) when they can be read.
        snapped: names of those just outside the mesh.
        faults: of those that stand in no ground.
    """

    points: tuple[GroundPoint, ...]
    readable: Bools
    snapped: tuple[str, ...]
    faults: tuple[Fault, ...]

    @classmethod
    def of(
        cls,
        channels: Sequence[Channel],
        on_mesh: CaseOnMesh,
        sites_of: Sequence[tuple[Site, ...]] | None = None,
        *,
        as_built: bool = False,
    ) -> GroundPoints:
        """The points of channels.

        Args:
            channels: some channels (g,), each read at its second point.
            on_mesh: the case on its mesh.
            sites_of: g times the elements that count as holding the point; None: all that do.
            as_built: whether ground that is placed right after the zero will do.
        """
        points, faults = list[GroundPoint](), list[Fault]()
        readable = np.zeros((len(channels), len(on_mesh.sequence.states)), dtype=np.bool_)
        for row, channel in enumerate(channels):
            place, signs = on_mesh.kinematics.in_section(channel.second)
            sites = on_mesh.locator.sites(place) if sites_of is None else sites_of[row]
            site, readable[row] = _site(channel, sites, on_mesh, as_built=as_built)
            beside = None if sites_of else beside_fault(on_mesh, channel, channel.second, sites)
            if site is None or beside is not None:
                faults.append(beside or point_fault(on_mesh, channel, channel.second, sites))
            else:
                points.append(GroundPoint(channel, np.array(place), signs, site, on_mesh))
        snapped = tuple(one.channel.name for one in points if is_beside(one.site))
        return cls(tuple(points), readable, snapped, tuple(faults))


def _site(
    channel: Channel, sites: tuple[Site, ...], on_mesh: CaseOnMesh, *, as_built: bool
) -> tuple[Site | None, Bools]:
    """The element that holds the point of a channel, and (n_states,) when it can be read there.

    A change needs ground that stays from its zero on; a value needs it when it is read.
    """
    sequence = on_mesh.sequence
    if channel.is_zeroed:
        return best_site(sites, sequence, on_mesh.case.zero_of(channel), as_built=as_built)
    best, longest = None, np.zeros(len(sequence.states), dtype=np.bool_)
    for site in sites:
        group = int(sequence.group_of[site.element])
        present = np.array([group in state.materials for state in sequence.states])
        if channel.reads is Reads.VIRGIN:
            present[:] = present[0]
        if present.sum() > longest.sum():
            best, longest = site, present
    return best, longest

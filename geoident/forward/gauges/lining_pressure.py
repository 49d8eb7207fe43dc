"""What the ground presses on a lining or wall, normal to it: cells behind beams and shells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from geoident.fem.location import Site
from geoident.forward.gauges.ground_points import GroundPoints
from geoident.forward.gauges.on_structures import NOT_STANDING, place_on_beam, standing
from geoident.forward.gauges.placement import Placed
from geoident.forward.gauges.shell_forces import place_on_shell, shell_faults
from geoident.forward.gauges.stress import StressReadings
from geoident.forward.stages import CaseOnMesh
from geoident.forward.structures.placing import present_throughout
from geoident.model.gauges import Channel


def pressures_on_linings(channels: Sequence[Channel], on_mesh: CaseOnMesh) -> Placed:
    """Channels that read what the ground presses on a beam or shell, normal to it."""
    stands, faults = standing(channels, on_mesh)
    for channel in channels:
        if (found := place_on_shell(channel, on_mesh)) is not None:
            faults = (*faults, *shell_faults(channel, found[1], on_mesh))
    if faults:
        return Placed(StressReadings((), on_mesh), stands, faults=faults, unreadable=NOT_STANDING)
    cells, sites = zip(*(_behind(channel, on_mesh) for channel in channels), strict=True)
    placed = GroundPoints.of(cells, on_mesh, sites)
    observable = StressReadings(placed.points, on_mesh)
    readable = placed.readable & stands
    return Placed(observable, readable, placed.snapped, placed.faults, NOT_STANDING)


def _behind(channel: Channel, on_mesh: CaseOnMesh) -> tuple[Channel, tuple[Site, ...]]:
    """The channel at its place on the lining with the normal there, and the ground that presses."""
    found = place_on_shell(channel, on_mesh)
    place = place_on_beam(channel, on_mesh)[0] if found is None else found[1]
    foot = tuple(map(float, place.point))
    present = present_throughout(on_mesh.sequence, channel.structure)

    def presses(site: Site) -> bool:
        centre = on_mesh.mesh.points[site.nodes].mean(axis=0)
        outside = (centre - place.point) @ place.inside < 0.0
        return bool(outside and present is not None and present[site.element])

    sites = tuple(site for site in on_mesh.locator.sites(foot) if presses(site))
    direction = tuple(map(float, place.inside))
    return replace(channel, second=foot, direction=direction, towards=None), sites

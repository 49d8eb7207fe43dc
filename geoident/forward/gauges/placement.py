"""Where the gauges stand: in which element, and how far from what is excavated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.fem.faces import FacetPatch, distance_to_faces, patches
from geoident.forward.gauges.observable import best_site
from geoident.forward.stages import CaseOnMesh, element_number


@dataclass(frozen=True)
class Placement:
    """A point of a gauge on the mesh.

    Args:
        channels: names of the channels that end there.
        point: its coordinates, m.
        element: number of its element in the mesh file.
        group: of the element.
        distance: from the outline of all that is ever excavated, m; None if nothing is.
    """

    channels: tuple[str, ...]
    point: tuple[float, ...]
    element: int
    group: str
    distance: float | None


def placements(on_mesh: CaseOnMesh) -> tuple[Placement, ...]:
    """Where the points of all gauges stand, each once, in the order of the case."""
    case, mesh, sequence = on_mesh.case, on_mesh.mesh, on_mesh.sequence
    outline = _excavation_outline(on_mesh)
    ends: dict[tuple[tuple[float, ...], int], list[str]] = {}
    for channel in case.channels:
        for point, _ in channel.motions:
            ends.setdefault((point, case.zero_of(channel)), []).append(channel.name)
    places = []
    for (point, zero), channels in ends.items():
        place, _ = on_mesh.kinematics.in_section(point)
        site, _ = best_site(on_mesh.locator.sites(place), sequence, zero)
        if site is not None:
            group = sequence.groups[sequence.group_of[site.element]]
            away = distance_to_faces(mesh, outline, np.asarray(place)) if outline else None
            number = element_number(mesh, site.element)
            places.append(Placement(tuple(channels), point, number, group, away))
    return tuple(places)


def _excavation_outline(on_mesh: CaseOnMesh) -> tuple[FacetPatch, ...]:
    """Faces between what is ever excavated and the ground that stays."""
    mesh, table = on_mesh.mesh, on_mesh.table
    dug = np.zeros(mesh.n_elements, dtype=bool)
    for stage in on_mesh.case.stages:
        for name in stage.excavate:
            dug[mesh.groups[name]] = True
    outer, edge = table.free(dug), table.free(np.ones_like(dug))
    inside = ~np.isin(table.face[outer], table.face[edge])
    return patches(mesh, table, outer[inside])

"""Where the gauges stand: in which element, and how far from what is excavated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.fem.faces import FaceTable, FacetPatch, distance_to_faces, patches
from geoident.fem.kinematics import kinematics_of
from geoident.forward.gauges.observable import GaugeSurroundings, best_site
from geoident.forward.stages import element_number
from geoident.model.case import Case
from geoident.model.mesh import Mesh


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


def placements(ground: GaugeSurroundings, table: FaceTable) -> tuple[Placement, ...]:
    """Where the points of all gauges stand, each once, in the order of the case.

    Args:
        ground: case, mesh and stages.
        table: the faces of the mesh.
    """
    case, mesh, sequence = ground.case, ground.mesh, ground.sequence
    outline, kinematics = _excavation_outline(case, mesh, table), kinematics_of(case.analysis)
    ends: dict[tuple[tuple[float, ...], str], list[str]] = {}
    for channel in case.channels:
        for point, _ in channel.motions:
            ends.setdefault((point, channel.zero), []).append(channel.name)
    places = []
    for (point, zero), channels in ends.items():
        place, _ = kinematics.in_section(point)
        site, _ = best_site(ground.locator.sites(place), sequence, case.stage_names.index(zero))
        if site is not None:
            group = sequence.groups[sequence.group_of[site.element]]
            away = distance_to_faces(mesh, outline, np.asarray(place)) if outline else None
            number = element_number(mesh, site.element)
            places.append(Placement(tuple(channels), point, number, group, away))
    return tuple(places)


def _excavation_outline(case: Case, mesh: Mesh, table: FaceTable) -> tuple[FacetPatch, ...]:
    """Faces between what is ever excavated and the ground that stays."""
    dug = np.zeros(mesh.n_elements, dtype=bool)
    for stage in case.stages:
        for name in stage.excavate:
            dug[mesh.groups[name]] = True
    outer, edge = table.free(dug), table.free(np.ones_like(dug))
    inside = ~np.isin(table.face[outer], table.face[edge])
    return patches(mesh, table, outer[inside])

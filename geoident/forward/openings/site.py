"""What a closed form needs to know of the place: the circle, its groups and the ground around it.

The case gives the circle; in a mesh the wall of what is excavated within must lie on it. A model
cut along planes of symmetry shows a half or a quarter of it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from geoident.fem.faces import patches
from geoident.fem.location import format_point
from geoident.forward.actions.supports import fixed_dofs, group_nodes
from geoident.forward.stages import CaseOnMesh, ConstructionSequence
from geoident.model.arrays import Bools, Ints
from geoident.model.mesh import nodes_in

ROUND = 0.02
"""How far the wall may lie off its circle, in parts of the radius."""

FAR = 3.0
"""Distance of the edges and of other openings from the centre at least, in radii."""

DEEP = 10.0
"""The same, from which on the end of the model is not worth a word."""

_SHOWN = 4  # names in a message


@dataclass(frozen=True)
class OpeningSite:
    """A circular opening.

    Args:
        centre: its centre, m.
        radius: a, m.
        groups: indices of the element groups that fill it.
        ground: index of a group around it.
        walls: groups of faces on the wall; None: any group (there is no mesh).
        remarks: what is to be known of how well it fits.
    """

    centre: tuple[float, float]
    radius: float
    groups: frozenset[int]
    ground: int
    walls: frozenset[str] | None = None
    remarks: tuple[str, ...] = ()


def site_without_mesh(
    sequence: ConstructionSequence, centre: tuple[float, float] | None, radius: float | None
) -> OpeningSite | str:
    """The opening of a case without mesh, all that is excavated; or why there is none, a clause.

    Args:
        sequence: the states of the case.
        centre: of the opening as the case gives it, m.
        radius: likewise, m.
    """
    if centre is None or radius is None:
        return "without a mesh 'fit.closed-form' must give the centre and the radius"
    groups = frozenset(g for state in sequence.states for g in state.leaving)
    around = [g for g in sequence.states[0].materials if g not in groups]
    if not groups:
        return "no stage excavates anything"
    if not around:
        return "every group is excavated, none is left around the opening"
    materials = {sequence.states[0].materials[g] for g in around}
    if len(materials) > 1:
        return f"the ground around the opening is of several materials: {_listed(materials)}"
    return OpeningSite(centre, radius, groups, around[0])


def site_in_mesh(
    on_mesh: CaseOnMesh, centre: tuple[float, float] | None, radius: float | None
) -> OpeningSite | str:
    """The circular opening that a case gives, in its mesh, or why it is none, a clause.

    Args:
        on_mesh: the case on its mesh.
        centre: of the opening as the case gives it, m.
        radius: likewise, m.
    """
    mesh, sequence = on_mesh.mesh, on_mesh.sequence
    leaving = frozenset(g for state in sequence.states[1:] for g in state.leaving)
    if not leaving:
        return "no stage excavates anything"
    if centre is None or radius is None:
        return (
            "the case does not say where the opening is: give its centre and radius, as in "
            "'fit: {closed-form: {centre: [0 m, 0 m], radius: 2.5 m}}'"
        )
    distance = np.linalg.norm(mesh.points - np.array(centre), axis=1)
    within = [distance[nodes_in(mesh.blocks, sequence.group_of == g)].max() for g in leaving]
    pairs = zip(leaving, within, strict=True)
    groups = frozenset(g for g, away in pairs if away <= (1.0 + ROUND) * radius)
    if not groups:
        about = format_point(centre)
        return f"no group that is excavated lies within {radius:.4g} m of {about}"
    names = _listed(sequence.groups[g] for g in groups)
    inside, present = np.isin(sequence.group_of, list(groups)), sequence.present(0)
    stays = present & ~inside
    wall = np.intersect1d(nodes_in(mesh.blocks, inside), nodes_in(mesh.blocks, stays))
    if not len(wall):
        return f"{names} border no ground that stays"
    if np.abs(distance[wall] - radius).max() > ROUND * radius:
        return (
            f"the wall of {names} is not the circle of radius {radius:.4g} m about "
            f"{format_point(centre)}: it lies {distance[wall].min():.3g} to "
            f"{distance[wall].max():.3g} m from there"
        )
    outer = patches(mesh, on_mesh.table, on_mesh.table.free(present))
    edge = np.unique(np.concatenate([patch.nodes.ravel() for patch in outer]))
    edge = np.setdiff1d(edge, _symmetric_sides(on_mesh, centre, radius))
    far = float(distance[edge].min(initial=np.inf)) / radius
    if far < FAR:
        return (
            f"the model, or another opening, ends {far:.1f} radii from the centre of the "
            f"opening; at least {FAR:g} are needed"
        )
    around, virgin, remarks = ground_at_wall(on_mesh, inside), sequence.states[0].materials, []
    if len(around) > 1:
        return f"the ground at the wall is of several materials: {_listed(around)}"
    ((material, ground),) = around.items()
    if far < DEEP:
        remarks.append(
            f"the model ends {far:.1f} radii from the centre, where the closed form continues: "
            f"displacements differ by some {100.0 / far**2:.0f} %"
        )
    if others := {m for g, m in virgin.items() if m != material and g not in groups}:
        remarks.append(f"the closed form leaves out {_listed(others)}: all is {material}")
    on_wall = {n for n in mesh.facet_groups if set(group_nodes(mesh, n)) == set(wall)}
    return OpeningSite(centre, radius, groups, ground, frozenset(on_wall), tuple(remarks))


def ground_at_wall(on_mesh: CaseOnMesh, inside: Bools) -> dict[str, int]:
    """Materials of the virgin ground that touch an opening, each with the first group of it.

    Args:
        on_mesh: the case.
        inside: (n_elements,) the elements that fill the opening.
    """
    mesh, sequence = on_mesh.mesh, on_mesh.sequence
    wall = nodes_in(mesh.blocks, inside)
    touching = np.concatenate([np.isin(block.nodes, wall).any(axis=1) for block in mesh.blocks])
    around = np.unique(sequence.group_of[touching & sequence.present(0) & ~inside])
    virgin = sequence.states[0].materials
    return {virgin[int(group)]: int(group) for group in around[::-1]}


def _symmetric_sides(on_mesh: CaseOnMesh, centre: tuple[float, float], radius: float) -> Ints:
    """Nodes (k,) of the sides of a mesh that go through the centre and are held across."""
    points, nodes = on_mesh.mesh.points, [np.empty(0, np.int64)]
    fixed = fixed_dofs(on_mesh).reshape(-1, 2)
    for axis in range(2):
        for side in (points[:, axis].min(), points[:, axis].max()):
            on_side = np.flatnonzero(np.abs(points[:, axis] - side) <= 1e-6 * radius)
            if abs(centre[axis] - side) <= ROUND * radius and fixed[on_side, axis].all():
                nodes.append(on_side)
    return np.concatenate(nodes)


def _listed(names: Iterable[str]) -> str:
    shown = [f"'{name}'" for name in sorted(names)]
    more = f" and {len(shown) - _SHOWN} more" if len(shown) > _SHOWN else ""
    return ", ".join(shown[:_SHOWN]) + more

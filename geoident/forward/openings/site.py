"""What a closed form needs to know of the place: the circle, its groups and the ground around it.

The circle is given by the case, or found in the mesh: ground that leaves and whose wall lies on a
circle. A model cut along planes of symmetry shows a half or a quarter of it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from geoident.fem.faces import patches
from geoident.fem.location import format_point
from geoident.forward.actions.supports import fixed_dofs, group_nodes
from geoident.forward.stages import CaseOnMesh, ConstructionSequence
from geoident.model.arrays import Floats, Ints
from geoident.model.mesh import nodes_in

ROUND = 0.02
"""How far the wall may lie off its circle, in parts of the radius."""

FAR = 3.0
"""Distance of the edges and of other openings from the centre at least, in radii."""

DEEP = 10.0
"""The same, from which on the end of the model is not worth a word."""

_SHOWN = 4  # names in a message

_WIDEST = np.pi / 4
"""Widest part of the wall, as an angle, without a node."""


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


@dataclass(frozen=True)
class Circle:
    """A circle that the case gives; None for what it leaves to the mesh."""

    centre: tuple[float, float] | None = None
    radius: float | None = None


def site_without_mesh(sequence: ConstructionSequence, circle: Circle) -> OpeningSite | str:
    """The opening of a case without mesh: all that is excavated. Or why there is none."""
    if circle.centre is None or circle.radius is None:
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
    return OpeningSite(circle.centre, circle.radius, groups, around[0])


def site_in_mesh(on_mesh: CaseOnMesh, circle: Circle) -> OpeningSite | str:
    """The first circular opening that the stages of a case make in its mesh, or why none is.

    Args:
        on_mesh: the case on its mesh.
        circle: what the case says of the opening.
    """
    leaving: frozenset[int] = frozenset()
    why = "no stage excavates anything"
    for state in on_mesh.sequence.states[1:]:
        if state.leaving - leaving:
            leaving |= state.leaving
            found = _OpeningSearch(on_mesh, leaving).site(circle)
            if isinstance(found, OpeningSite):
                return found
            why = found
    return why


class _OpeningSearch:
    """Looks whether some groups are a circular opening."""

    def __init__(self, on_mesh: CaseOnMesh, groups: frozenset[int]) -> None:
        mesh, sequence = on_mesh.mesh, on_mesh.sequence
        self._on_mesh, self._mesh, self._sequence = on_mesh, mesh, sequence
        self._groups = groups
        self._inside = np.isin(sequence.group_of, list(groups))
        self._present = sequence.present(0)
        self._wall = np.intersect1d(
            nodes_in(mesh.blocks, self._inside),
            nodes_in(mesh.blocks, self._present & ~self._inside),
        )

    def site(self, given: Circle) -> OpeningSite | str:
        """The opening, or why it is none."""
        names = _listed(self._sequence.groups[g] for g in self._groups)
        if len(self._wall) < 3:
            return f"{names} border no ground that stays"
        centre, radius = self._circle(given)
        away = np.linalg.norm(self._mesh.points[self._wall] - centre, axis=1)
        if np.abs(away - radius).max() > ROUND * radius:
            return (
                f"the wall of {names} is no circle: it lies {away.min():.3g} to "
                f"{away.max():.3g} m from {format_point(np.round(centre, 6) + 0.0)}"
            )
        sides = self._symmetries(centre, radius)
        if self._widest_gap(centre, sides) > _WIDEST:
            return f"the wall of {names} is only a part of a circle"
        return self._checked(centre, radius, sides)

    def _circle(self, given: Circle) -> tuple[Floats, float]:
        """The circle through the wall in least squares, or the given one."""
        x = self._mesh.points[self._wall]
        rows = np.column_stack([2.0 * x, np.ones(len(x))])
        first, second, rest = np.linalg.lstsq(rows, (x**2).sum(axis=1), rcond=None)[0]
        centre = np.array(given.centre if given.centre is not None else (first, second))
        if given.radius is not None:
            return centre, given.radius
        if given.centre is not None:
            return centre, float(np.linalg.norm(x - centre, axis=1).mean())
        return centre, float(np.sqrt(rest + first**2 + second**2))

    def _checked(
        self, centre: Floats, radius: float, sides: list[tuple[int, Ints]]
    ) -> OpeningSite | str:
        """The opening if it is far from all else, in ground of one material."""
        edge = np.setdiff1d(self._outer_nodes(), np.concatenate([[], *(n for _, n in sides)]))
        points = self._mesh.points[edge.astype(np.int64)]
        far = float(np.linalg.norm(points - centre, axis=1).min(initial=np.inf)) / radius
        if far < FAR:
            return (
                f"the model, or another opening, ends {far:.1f} radii from the centre of the "
                f"opening; at least {FAR:g} are needed"
            )
        around = self._around()
        materials = {self._sequence.states[0].materials[g] for g in around}
        if len(materials) > 1:
            return f"the ground at the wall is of several materials: {_listed(materials)}"
        x, y = (round(float(coordinate), 9) + 0.0 for coordinate in centre)
        site = OpeningSite((x, y), radius, self._groups, around[0], self._walls())
        return replace(site, remarks=self._remarks(far, materials.pop()))

    def _remarks(self, far: float, material: str) -> tuple[str, ...]:
        remarks = []
        if far < DEEP:
            remarks.append(
                f"the model ends {far:.1f} radii from the centre, where the closed form goes on: "
                f"displacements differ by some {100.0 / far**2:.0f} %"
            )
        virgin = self._sequence.states[0].materials
        others = {m for g, m in virgin.items() if m != material and g not in self._groups}
        if others:
            remarks.append(f"the closed form leaves out {_listed(others)}: all is {material}")
        return tuple(remarks)

    def _around(self) -> list[int]:
        """Groups that stay and touch the wall."""
        touching = [np.isin(block.nodes, self._wall).any(axis=1) for block in self._mesh.blocks]
        stays, at_wall = self._present & ~self._inside, np.concatenate(touching)
        return [int(g) for g in np.unique(self._sequence.group_of[stays & at_wall])]

    def _walls(self) -> frozenset[str]:
        """Groups of faces whose nodes are those of the wall."""
        names = self._mesh.facet_groups
        wall = set(self._wall)
        return frozenset(n for n in names if set(group_nodes(self._mesh, n)) == wall)

    def _symmetries(self, centre: Floats, radius: float) -> list[tuple[int, Ints]]:
        """Sides of the model through the centre whose nodes are held: axis and nodes."""
        points, found = self._mesh.points, []
        fixed = fixed_dofs(self._on_mesh).reshape(-1, 2)
        for axis in range(2):
            for side in (points[:, axis].min(), points[:, axis].max()):
                nodes = np.flatnonzero(np.abs(points[:, axis] - side) <= 1e-6 * radius)
                if abs(centre[axis] - side) <= ROUND * radius and fixed[nodes, axis].all():
                    found.append((axis, nodes))
        return found

    def _widest_gap(self, centre: Floats, sides: list[tuple[int, Ints]]) -> float:
        """Largest angle between neighbours on the wall, with its images beyond the symmetries."""
        x = self._mesh.points[self._wall] - centre
        for axis, _ in sides:
            image = x.copy()
            image[:, axis] *= -1.0
            x = np.concatenate([x, image])
        angles = np.sort(np.arctan2(x[:, 1], x[:, 0]))
        return float(np.diff(angles, append=angles[0] + 2.0 * np.pi).max())

    def _outer_nodes(self) -> Ints:
        """Nodes on free faces of the virgin ground."""
        table = self._on_mesh.table
        found = patches(self._mesh, table, table.free(self._present))
        return np.unique(np.concatenate([patch.nodes.ravel() for patch in found]))


def _listed(names: Iterable[str]) -> str:
    shown = [f"'{name}'" for name in sorted(names)]
    more = f" and {len(shown) - _SHOWN} more" if len(shown) > _SHOWN else ""
    return ", ".join(shown[:_SHOWN]) + more

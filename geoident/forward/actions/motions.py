"""Motions that are given: of supports, as measured at points, and the contraction of a wall.

A state imposes w_j, the change of what its supports give since the state on which it builds: zero
for a support that only holds. A support that begins later counts from the shape that the ground
has then (theory 2.8).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from geoident.errors import Fault
from geoident.fem.location import format_point
from geoident.forward.actions.supports import support_key, support_keys, support_nodes
from geoident.forward.stages import CaseOnMesh
from geoident.model.actions import MotionField
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case, KeyPath, Support
from geoident.model.dual import ParameterPoint
from geoident.model.mesh import Mesh, rows_in
from geoident.model.parameter import Scalar

_SAME = 1e-9
"""Relative difference of motions given twice that is rounding."""

_ON_LINE = 1e-9
"""Extent of points across a line or plane, relative to that along it, that is rounding."""

_HALVINGS = 40
"""Of a distance, down to the rounding of the coordinates at its ends."""


@dataclass(frozen=True)
class _Term:
    """A number of the case with the motion of some degrees of freedom (k,) that it makes, m."""

    dofs: Ints
    unit: Floats
    number: Scalar


class GivenMotions:
    """What the supports of all states give; places and fields are found once.

    Args:
        on_mesh: the case on its mesh.
    """

    def __init__(self, on_mesh: CaseOnMesh) -> None:
        self._on_mesh, self._states = on_mesh, on_mesh.sequence.states
        self._terms: dict[Support, list[_Term]] = {}

    def moved(self) -> str | None:
        """The first support that any stage moves, or None."""
        names = (
            name
            for state in self._states[1:]
            for name, support in state.supports.items()
            if support.moves
        )
        return next(names, None)

    def change(self, state: int, point: ParameterPoint) -> Floats | None:
        """Displacement step (n_dofs, 1 + n) that a state imposes; None where nothing moves.

        Args:
            state: number of the state.
            point: the parameters, and those to differentiate by.
        """
        current = self._states[state]
        before = self._states[current.base].supports if current.base else {}
        if state == 0 or dict(before) == dict(current.supports):
            return None
        if not any(one.moves for one in (*before.values(), *current.supports.values())):
            return None
        step = np.zeros((self._on_mesh.discretization.n_dofs, point.n_columns))
        for name in current.supports:
            dofs, moved = self.step_of(state, name, point)
            step[dofs] = moved
        return step

    def step_of(self, state: int, name: str, point: ParameterPoint) -> tuple[Ints, Floats]:
        """What a support imposes in a state: its degrees of freedom (k,), and (k, 1 + n), m.

        Args:
            state: number of the state.
            name: of a support that holds then.
            point: the parameters.
        """
        current = self._states[state]
        support = current.supports[name]
        earlier = self._states[current.base].supports.get(name) if current.base else None
        dofs, now = self._given(support, point)
        if earlier is not None:
            at, then = self._given(earlier, point)
            _, rows, earlier_rows = np.intersect1d(dofs, at, return_indices=True)
            now[rows] -= then[earlier_rows]
        return dofs, now

    def _given(self, support: Support, point: ParameterPoint) -> tuple[Ints, Floats]:
        """Degrees of freedom (k,) that a support holds, and how far it moves them (k, 1 + n)."""
        mesh = self._on_mesh.mesh
        if support not in self._terms:
            self._terms[support] = _terms_of(mesh, support)
        nodes = support_nodes(mesh, support)
        dofs = (nodes[:, None] * mesh.dim + np.array(support.components)).ravel()
        order = np.argsort(dofs, kind="stable")
        moved = np.zeros((len(dofs), point.n_columns))
        for term in self._terms[support]:
            columns = point.number(term.number).columns
            moved[order[np.searchsorted(dofs[order], term.dofs)]] = np.outer(term.unit, columns)
        return dofs, moved


def _terms_of(mesh: Mesh, support: Support) -> list[_Term]:
    """The motion of a support as numbers of the case times given motions.

    Raises:
        ValueError: points do not cover it, or a wall is not a closed line (`motion_faults`).
    """
    nodes, dim = support_nodes(mesh, support), mesh.dim
    terms = [_Term(nodes * dim + c, np.ones(len(nodes)), s) for c, s in support.motions]
    field = support.measured
    if field is not None:
        values, far = interpolated(field, mesh.points[nodes])
        if far.any():
            raise ValueError("points of a motion do not cover its support")
        for column, c in enumerate(field.components):
            terms.append(_Term(nodes * dim + c, values[:, column], field.factor))
    wall = support.contraction
    if wall is not None:
        if wall.centre is not None:
            centre = np.array(wall.centre)
        elif support.components == (0,):  # towards the axis of revolution
            centre = np.zeros(dim)
        else:
            line = closed_line(mesh, support.group)
            if line is None:
                raise ValueError("a wall is not a closed line")
            centre = _centroid(mesh.points[line])
        inwards = -0.5 * (mesh.points[nodes] - centre)
        for c in support.components:
            terms.append(_Term(nodes * dim + c, inwards[:, c], wall.part))
    return terms


def closed_line(mesh: Mesh, group: str) -> Ints | None:
    """Nodes (k,) around a group of lines in the plane; None where it is not one closed line."""
    following: dict[int, list[tuple[int, int, Ints]]] = {}
    count = 0
    for block, rows in rows_in(mesh.facets, mesh.facet_groups.get(group, np.empty(0, np.int64))):
        for nodes in block.nodes[rows]:
            first, last, middle = int(nodes[0]), int(nodes[1]), nodes[2:]
            following.setdefault(first, []).append((count, last, middle))
            following.setdefault(last, []).append((count, first, middle[::-1]))
            count += 1
    if not count or any(len(ways) != 2 for ways in following.values()):
        return None
    start = at = min(following)
    last, line = -1, list[int]()
    while not line or at != start:
        last, to, middle = next(way for way in following[at] if way[0] != last)
        line += [at, *map(int, middle)]
        at = to
        count -= 1
    return np.array(line) if not count and len(set(line)) == len(line) > 2 else None


def _centroid(corners: Floats) -> Floats:
    """(2,) of the area in a polygon (k, 2)."""
    origin = corners.mean(axis=0)
    one, other = corners - origin, np.roll(corners, -1, axis=0) - origin
    twice = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    return np.asarray(origin + (twice[:, None] * (one + other)).sum(axis=0) / (3.0 * twice.sum()))


def interpolated(field: MotionField, positions: Floats) -> tuple[Floats, Bools]:
    """Motions at places, linear between the points of a field.

    Where points stand on a line (or, in space, in a plane), places are looked at along it. A place
    a little beyond the points, up to half of the usual distance between them, takes the motion
    of the nearest place between them: walls are round.

    Args:
        field: k points.
        positions: (m, dim), m.

    Returns:
        (m, c) motions, m, without the factor; (m,) which places the points do not cover.
    """
    points, values = np.array(field.points), np.array(field.values)
    middle = points.mean(axis=0)
    if len(points) == 1:
        away = np.linalg.norm(positions - middle, axis=1)
        size = np.maximum(np.abs(positions).max(axis=1, initial=0.0), 1.0)
        return np.tile(values, (len(positions), 1)), np.asarray(away > _ON_LINE * size)
    _, sizes, axes = np.linalg.svd(points - middle, full_matrices=False)
    axes = axes[sizes > _ON_LINE * sizes[0]]
    near, wanted = (points - middle) @ axes.T, (positions - middle) @ axes.T
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    allowed = 0.5 * float(np.median(apart.min(axis=1)))
    between = _between(near, values)
    motion = between(wanted)
    beyond = np.flatnonzero(np.isnan(motion).any(axis=1))
    low, high = np.zeros(len(beyond)), np.ones(len(beyond))
    for _ in range(_HALVINGS):  # towards the middle, until they are between the points
        half = 0.5 * (low + high)
        outside = np.isnan(between(half[:, None] * wanted[beyond])).any(axis=1)
        high, low = np.where(outside, half, high), np.where(outside, low, half)
    motion[beyond] = between(low[:, None] * wanted[beyond])
    far = np.zeros(len(positions), dtype=bool)
    far[beyond] = (1.0 - low) * np.linalg.norm(wanted[beyond], axis=1) > allowed
    return motion, far


def _between(places: Floats, values: Floats) -> Callable[[Floats], Floats]:
    """What gives values (m, c) at places (m, r) between known ones; NaN beyond them."""
    from scipy.interpolate import LinearNDInterpolator  # noqa: PLC0415

    if places.shape[1] == 1:
        order = np.argsort(places[:, 0])
        x, columns = places[order, 0], values[order].T
        return lambda wanted: np.stack(
            [np.interp(wanted[:, 0], x, column, np.nan, np.nan) for column in columns], axis=1
        )
    interpolate: Callable[[Floats], Floats] = LinearNDInterpolator(places, values)
    return interpolate


def motion_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Motions that cannot be: open walls, points that do not cover, two motions of one node.

    Args:
        on_mesh: the case on its mesh, which has the groups of all supports.
    """
    faults = [
        f for path, one in support_keys(on_mesh.case) for f in _own_faults(on_mesh, path, one)
    ]
    return faults or list(_contradictions(on_mesh))


def _own_faults(on_mesh: CaseOnMesh, path: KeyPath, support: Support) -> Iterator[Fault]:
    """What is wrong with the motion of one support."""
    mesh, source, wall = on_mesh.mesh, on_mesh.case.source, support.contraction
    around = wall is not None and wall.centre is None and support.components != (0,)
    if around and closed_line(mesh, support.group) is None:
        message = f"'{support.group}' is not one closed line, so no area is within it"
        hint = "Name the whole wall, or give 'centre: [x, y]' where symmetry cuts it."
        place = (*path, "contraction")
        yield source.fault(place, "open-wall", message, hint)
    if support.measured is not None:
        nodes = support_nodes(mesh, support)
        _, far = interpolated(support.measured, mesh.points[nodes])
        if far.any():
            where = format_point(mesh.points[nodes[np.flatnonzero(far)[0]]])
            message = f"the points do not cover '{support.group}': {np.count_nonzero(far)} of its "
            message += f"{len(nodes)} nodes lie beyond them, such as that at {where}"
            hint = "Give points as far as the group reaches, or a group that ends with the points."
            yield source.fault((*path, "measured"), "not-covered", message, hint)


def _contradictions(on_mesh: CaseOnMesh) -> Iterator[Fault]:
    """Nodes that two supports move differently, or that one holds and the other moves."""
    case, mesh, motions = on_mesh.case, on_mesh.mesh, GivenMotions(on_mesh)
    point = ParameterPoint(case.start, tuple(case.start))
    reported: set[tuple[str, str]] = set()
    for n, state in enumerate(on_mesh.sequence.states):
        if not n or not any(one.moves for one in state.supports.values()):
            continue
        owner = np.full(on_mesh.discretization.n_dofs, -1)
        step = np.zeros((len(owner), point.n_columns))
        names = list(state.supports)
        for k, name in enumerate(names):
            dofs, moved = motions.step_of(n, name, point)
            shared = owner[dofs] >= 0
            size = np.maximum(np.abs(moved).max(axis=0, initial=0.0), np.abs(step).max(axis=0))
            differ = shared & (np.abs(moved - step[dofs]) > _SAME * size).any(axis=1)
            if differ.any():
                dof = int(dofs[np.flatnonzero(differ)[0]])
                other = names[owner[dof]]
                if (other, name) not in reported:
                    reported.add((other, name))
                    moving = name if state.supports[name].moves else other
                    path = support_key(moving, state.held_since[moving])
                    yield _two_motions(case, mesh, path, (other, name), dof)
            owner[dofs], step[dofs] = k, moved


def _two_motions(case: Case, mesh: Mesh, path: KeyPath, names: tuple[str, str], dof: int) -> Fault:
    """One node is given two motions by the supports of these names."""
    node, component = divmod(dof, mesh.dim)
    where, axis = format_point(mesh.points[node]), "xyz"[component]
    message = f"'{names[0]}' and '{names[1]}' both hold the node at {where} along {axis}, and give "
    message += "it different motions"
    hint = f"Take shared nodes out of one of them, hold one of them not along {axis}, or give both "
    hint += "the same motion."
    return case.source.fault(path, "two-motions", message, hint)

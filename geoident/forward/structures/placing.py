"""Where beams and bars are on a mesh: their pieces and directions, what holds their ends."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from geoident.fem.location import Site
from geoident.fem.shells import (
    ShellMembers,
    consistent_sides,
    corners_of,
    shell_members,
)
from geoident.fem.structures import (
    Members,
    bars,
    beams,
    grouted_parts,
    shells,
    straight_pieces,
)
from geoident.forward.actions.on_beams import site_on_beam
from geoident.forward.actions.supports import group_nodes
from geoident.forward.stages import CaseOnMesh, ConstructionSequence
from geoident.forward.structures import grouted
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Analysis, Case
from geoident.model.cells import CELLS
from geoident.model.mesh import Mesh, rows_in, with_rotations
from geoident.model.structures import Anchors, Bars, Beam, GroutedBars, Shell

_HeldPoint = tuple[str, tuple[float, ...]]

GROUT_POINTS = 10
"""Points, spread evenly along the grouted length of an anchor, at which it holds the ground."""


def placed(on_mesh: CaseOnMesh, name: str, present: Bools) -> Members:
    """The members of a structure.

    Args:
        on_mesh: the case on its mesh.
        name: of the structure.
        present: (n_elements,) what is there as long as it stands.
    """
    structure = on_mesh.case.structures[name]
    if isinstance(structure, Bars):
        states = (s.structures for s in on_mesh.sequence.states if name in s.structures)
        return _bars(on_mesh, structure, present, frozenset.intersection(*states))
    if isinstance(structure, Shell):
        return _shell(on_mesh, structure, present)
    assert isinstance(structure, Beam)
    mesh = on_mesh.mesh
    edges = straight_pieces(mesh, structure.group)
    # Where ground is on one side only it is on the left of pieces: bending moments are positive
    # with tension on the open side. Pieces between ground on both sides, as the embedded part of a
    # wall, go on in the direction of those that they follow on.
    side = np.sign(facing_balance(on_mesh, edges, present)).astype(np.int64)
    edges = np.where(_going_on(edges, side)[:, None], edges[:, ::-1], edges)
    hinged, held = hinged_and_held(on_mesh, structure)
    if on_mesh.case.analysis is not Analysis.AXISYMMETRIC:
        return beams(mesh, edges, held, hinged)
    return shells(mesh, edges, held, hinged, 0.0 if structure.nu is None else structure.nu.factor)


def shell_groups(case: Case, mesh: Mesh) -> tuple[str, ...]:
    """The groups of faces on which shells are built, those that the mesh has."""
    shells = (one for one in case.structures.values() if isinstance(one, Shell))
    return tuple(shell.group for shell in shells if shell.group in mesh.facet_groups)


def with_shells(mesh: Mesh, groups: tuple[str, ...]) -> Mesh:
    """The mesh with unknowns for the rotations of shells on groups of its faces."""
    if not groups:
        return mesh
    return with_rotations(mesh, np.unique(np.concatenate([group_nodes(mesh, g) for g in groups])))


def _shell(on_mesh: CaseOnMesh, shell: Shell, present: Bools) -> ShellMembers:
    """A shell on the mesh; its normals look to the side without ground (`open_sides`)."""
    mesh, faces = on_mesh.mesh, on_mesh.mesh.facet_groups[shell.group]
    corners, unsplit = corners_of(mesh, faces), on_mesh.unsplit.mesh
    sides = consistent_sides(corners, open_sides(unsplit, corners_of(unsplit, faces), present))
    return shell_members(mesh, faces, corners, sides, np.array(shell.axis))


def open_sides(mesh: Mesh, corners: Sequence[tuple[int, ...]], present: Bools) -> Ints:
    """(n,) 1 where the normals of faces look away from ground that is there, -1 where into it.

    Args:
        mesh: of solid elements.
        corners: of every face, in its order around its normal.
        present: (n_elements,) which elements are there.

    Returns:
        0 where there is ground on both sides or on none.
    """
    side = np.zeros(len(corners), dtype=np.int64)
    number = {frozenset(own): n for n, own in enumerate(corners)}
    on_shell = np.zeros(mesh.n_nodes, dtype=bool)
    on_shell[[node for own in corners for node in own]] = True
    for block, rows in rows_in(mesh.blocks, present):
        near = block.nodes[rows]
        near = near[on_shell[near].sum(axis=1) >= 3]
        for face in CELLS[block.kind].shape.faces:
            own = near[:, list(face)]
            for nodes, element in zip(own[on_shell[own].all(axis=1)].tolist(),
                                      near[on_shell[own].all(axis=1)], strict=True):  # fmt: skip
                n = number.get(frozenset(nodes))
                if n is None:
                    continue
                x = mesh.points[list(corners[n])]
                normal = np.cross(x[1] - x[0], x[2] - x[0])
                inwards = mesh.points[element].mean(axis=0) - x.mean(axis=0)
                side[n] -= 1 if normal @ inwards > 0.0 else -1
    return side


def hinge_nodes(mesh: Mesh, beam: Beam, hinge: str | tuple[float, ...]) -> Ints:
    """Nodes (k,) of a beam at one of its hinges; none where the hinge is not on the beam.

    Args:
        mesh: the mesh.
        beam: on its lines.
        hinge: a group of the mesh, or a point (dim,), m, at most 1 % of a piece from its node.
    """
    pieces = straight_pieces(mesh, beam.group)
    nodes = np.unique(pieces)
    if isinstance(hinge, str):
        return np.intersect1d(nodes, group_nodes(mesh, hinge))
    shortest = np.linalg.norm(np.diff(mesh.points[pieces], axis=1)[:, 0], axis=1).min()
    apart = np.linalg.norm(mesh.points[nodes] - hinge, axis=1)
    nearest = int(np.argmin(apart))
    return nodes[[nearest]] if apart[nearest] <= 0.01 * shortest else nodes[:0]


def _bars(
    on_mesh: CaseOnMesh, structure: Bars, present: Bools, standing: frozenset[str]
) -> Members:
    """Bars on the mesh; their members are numbered as the case gives them."""
    locator = on_mesh.locator
    ends = np.array(structure.ends, dtype=np.float64)
    extent = None
    if on_mesh.case.analysis is Analysis.AXISYMMETRIC and structure.spacing is not None:
        extent = 2 * np.pi * ends[:, 0, 0]

    def holding(points: list[_HeldPoint]) -> list[Site]:
        sites = [
            site_on_beam(on_mesh, point, standing) or locator.best(point, present)
            for _, point in points
        ]
        return [site for site in sites if site is not None]

    sites = [
        (holding(first), holding(second))
        for first, second in (held_points(structure, pair) for pair in structure.ends)
    ]
    if isinstance(structure, Anchors):
        ends, _ = grouted_parts(ends, structure.grouted, GROUT_POINTS)
    return bars(on_mesh.mesh, ends, sites, extent)


def held_points(
    structure: Bars, ends: tuple[tuple[float, ...], tuple[float, ...]]
) -> tuple[list[_HeldPoint], list[_HeldPoint]]:
    """What the mesh holds of a bar at its first and at its second end: what it is, and where.

    Args:
        structure: with the bar.
        ends: of the bar, (dim,) each, m.
    """
    if isinstance(structure, GroutedBars):
        return grouted.held_points(structure, ends)
    if isinstance(structure, Anchors):
        _, points = grouted_parts(np.array([ends]), structure.grouted, GROUT_POINTS)
        grout = [("the grouted length at", tuple(point)) for point in points[0].tolist()]
        return [("the head", ends[0])], grout
    second = [("the end", ends[1])] if structure.second_end == "joined" else []
    return [("the end", ends[0])], second


def present_throughout(sequence: ConstructionSequence, name: str) -> Bools | None:
    """(n_elements,) what is there as long as a structure stands; None if it never does."""
    states = [n for n, state in enumerate(sequence.states) if name in state.structures]
    return np.logical_and.reduce([sequence.present(n) for n in states]) if states else None


def _going_on(edges: Ints, side: Ints) -> Bools:
    """(n,) which edges are turned round, so that no direction changes where two of them meet.

    Args:
        edges: (n, 2) nodes.
        side: (n,) 1 where an edge stays, -1 where it is turned, 0 where its neighbours say.
    """
    at: dict[int, list[int]] = {}
    for n, pair in enumerate(edges.tolist()):
        for node in pair:
            at.setdefault(node, []).append(n)
    decided = side.copy()
    waiting = deque(np.flatnonzero(side).tolist())
    while waiting:
        edge = waiting.popleft()
        for end, node in enumerate(edges[edge].tolist()):
            others = [other for other in at[node] if other != edge]
            if len(others) == 1 and decided[others[0]] == 0:
                goes_on = edges[others[0], 1 - end] == node  # one ends where the other begins
                decided[others[0]] = decided[edge] if goes_on else -decided[edge]
                waiting.append(others[0])
    return np.asarray(decided < 0)


def facing_balance(on_mesh: CaseOnMesh, edges: Ints, present: Bools) -> Floats:
    """On which side of edges (n, 2) present ground is: (n,) positive for left, 0 for both or none.

    Args:
        on_mesh: the case on a plane mesh.
        edges: (n, 2) nodes of the two ends of each.
        present: (n_elements,) which elements are there.
    """
    mesh = on_mesh.unsplit.mesh
    edges = edges if on_mesh.original is None else on_mesh.original[edges]
    balance = np.zeros(len(edges))
    along = mesh.points[edges[:, 1]] - mesh.points[edges[:, 0]]
    for block, rows in rows_in(mesh.blocks, present):
        centre = mesh.points[block.nodes[rows]].mean(axis=1)
        holds = _incidence(mesh, block.nodes[rows])
        both = (holds[edges[:, 0]] * holds[edges[:, 1]]).tocoo()
        to_centre = centre[both.col] - mesh.points[edges[both.row, 0]]
        a = along[both.row]
        np.add.at(balance, both.row, np.sign(a[:, 0] * to_centre[:, 1] - a[:, 1] * to_centre[:, 0]))
    return balance


def _incidence(mesh: Mesh, nodes: Ints) -> sp.csr_array:
    """(n_nodes, n_elements) which element has which node."""
    columns = np.repeat(np.arange(len(nodes)), nodes.shape[1])
    shape = (mesh.n_nodes, len(nodes))
    return sp.csr_array((np.ones(nodes.size), (nodes.ravel(), columns)), shape=shape)


def clamped_nodes(mesh: Mesh, beam: Beam) -> Bools:
    """(n_nodes,) nodes at which a beam does not turn."""
    clamped = np.zeros(mesh.n_nodes, dtype=bool)
    for group in beam.clamped_on:
        clamped[group_nodes(mesh, group)] = True
    return clamped


def hinged_and_held(on_mesh: CaseOnMesh, beam: Beam) -> tuple[Bools, Bools]:
    """(n_nodes,) at which a beam has a hinge, and at which it does not turn."""
    mesh = on_mesh.mesh
    hinged = np.zeros(mesh.n_nodes, dtype=bool)
    for hinge in beam.hinges:
        hinged[hinge_nodes(mesh, beam, hinge)] = True
    held = clamped_nodes(mesh, beam)
    if on_mesh.case.analysis is not Analysis.AXISYMMETRIC:
        return hinged, held
    on_axis = on_mesh.kinematics.on_axis(mesh.points)
    return hinged & ~on_axis, held | on_axis


def toothed(mesh: Mesh, beam: Beam, nodes: Ints) -> Bools:
    """(n,) pieces of a beam that lie on lines of three nodes.

    Args:
        mesh: the mesh.
        beam: on lines of it.
        nodes: (n, 2) ends of the pieces.
    """
    middles = [
        block.nodes[rows][:, 2]
        for block, rows in rows_in(mesh.facets, mesh.facet_groups[beam.group])
        if block.kind == "line3"
    ]
    of_three = np.concatenate([np.empty(0, dtype=np.int64), *middles])
    return np.asarray(np.isin(nodes, of_three).any(axis=1))


_BEARS = 0.3
"""Part of the largest weight of a bar on nodes from which on it bears on a node."""


def bears_on(mesh: Mesh, members: Members) -> Bools:
    """(n_nodes,) nodes on which a structure bears: of bars those next to their ends."""
    held = np.zeros(mesh.n_nodes, dtype=bool)
    if members.nodes is not None:
        held[members.nodes] = True
        return held
    weights = abs(members.operator).tocoo()
    largest = abs(members.operator).max(axis=1).toarray().ravel()
    chosen = weights.data > _BEARS * largest[weights.row]
    held[weights.col[chosen] // mesh.dim] = True
    return held

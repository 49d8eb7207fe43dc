"""Supports and loads on the named groups of a mesh."""

from __future__ import annotations

import numpy as np

from geoident.errors import Fault
from geoident.fem.faces import load_faces, load_patches
from geoident.fem.location import format_point
from geoident.forward.stages import CaseOnMesh, listed
from geoident.model.actions import FaceLoad, HeadForce, Load, PointForce, Seismic
from geoident.model.arrays import Bools, Ints
from geoident.model.case import Case, KeyPath, Support
from geoident.model.mesh import Mesh, and_inner, nodes_in, rows_in
from geoident.model.structures import Shell


def fixed_dofs(on_mesh: CaseOnMesh, state: int = 0) -> Bools:
    """(n_dofs,) which degrees of freedom the supports hold in a state, and the axis of revolution.

    Args:
        on_mesh: the case on its mesh.
        state: number of the state; the virgin state is 0.
    """
    mesh = on_mesh.mesh
    fixed = np.zeros((mesh.n_nodes, mesh.dim), dtype=bool)
    for support in on_mesh.sequence.states[state].supports.values():
        nodes = support_nodes(mesh, support)
        for component in support.components:
            fixed[nodes, component] = True
    fixed[on_mesh.kinematics.on_axis(mesh.points), 0] = True
    stations = mesh.n_nodes - len(mesh.stations_by)
    fixed[mesh.n_places : stations] = _held_rotations(on_mesh)
    across = np.arange(mesh.dim) > 0
    fixed[stations:] = across & ~mesh.stations_bend[:, None]  # a bar moves along itself
    return fixed.ravel()


def _held_rotations(on_mesh: CaseOnMesh) -> Bools:
    """(k, dim) which rotations of shells are held: at abutments all, on a plane those along it."""
    mesh = on_mesh.mesh
    held = np.zeros((len(mesh.rotations_of), mesh.dim), dtype=bool)
    for shell in on_mesh.case.structures.values():
        if not isinstance(shell, Shell):
            continue
        own = group_nodes(mesh, shell.group)
        for group in (*shell.clamped_on, *shell.mirrored_on):
            nodes = np.intersect1d(own, group_nodes(mesh, group))
            along = np.ones(mesh.dim, dtype=bool)
            if group not in shell.clamped_on:
                along[mirror_axis(mesh, shell, group)] = False
            held[np.searchsorted(mesh.rotations_of, nodes)] |= along
    return held


def mirror_axis(mesh: Mesh, shell: Shell, group: str) -> int | None:
    """The axis at right angles to the plane on which a shell meets a group; None for no such one.

    Where they meet in a straight line several planes hold it: the faces beside it go on across that
    of symmetry.
    """
    faces = mesh.facet_groups[shell.group]
    there = np.intersect1d(group_nodes(mesh, shell.group), group_nodes(mesh, group))
    if not len(there):
        return None
    flat = np.ptp(mesh.points[there], axis=0) <= _NEAR_NODE * np.ptp(mesh.points, axis=0).max()
    own = [block.nodes[rows] for block, rows in rows_in(mesh.facets, faces)]
    beside = np.concatenate([nodes[np.isin(nodes, there).any(axis=1)].ravel() for nodes in own])
    across = np.where(flat, np.ptp(mesh.points[beside], axis=0), -1.0)
    return int(np.argmax(across)) if flat.any() else None


def group_nodes(mesh: Mesh, name: str) -> Ints:
    """Nodes (k,) of a group of facets, nodes or elements (searched in this order).

    With those that beams between interfaces have there.
    """
    if name in mesh.facet_groups:
        nodes = nodes_in(mesh.facets, mesh.facet_groups[name])
    elif name in mesh.node_groups:
        nodes = mesh.node_groups[name]
    else:
        nodes = nodes_in(mesh.blocks, mesh.groups[name])
    return and_inner(mesh, nodes)


_NEAR_NODE = 1e-6
"""How far a support at a point may be from its node, relative to the size of the mesh."""


def support_nodes(mesh: Mesh, support: Support) -> Ints:
    """Nodes (k,) that a support holds; none where a point is no node."""
    if support.at is None:
        return group_nodes(mesh, support.group)
    away = np.linalg.norm(mesh.points[: mesh.n_places] - np.array(support.at), axis=1)
    nearest = int(np.argmin(away))
    if away[nearest] > _NEAR_NODE * np.ptp(mesh.points, axis=0).max():
        return np.empty(0, np.int64)
    return np.array([nearest])


def support_keys(case: Case) -> list[tuple[KeyPath, Support]]:
    """Every support of the case with the key where it is written."""
    keys: list[tuple[KeyPath, Support]] = [(("supports", s.group), s) for s in case.supports]
    for n, stage in enumerate(case.stages):
        supports = ((name, one) for name, one in stage.supports.items() if one is not None)
        keys += [(("stages", n, "supports", name), one) for name, one in supports]
    return keys


def all_supports(case: Case) -> tuple[Support, ...]:
    """One support of every name, that which is given last."""
    return tuple({support.group: support for _, support in support_keys(case)}.values())


def support_key(name: str, since: int) -> KeyPath:
    """Where a support is written that holds from a state on."""
    return ("stages", since - 1, "supports", name) if since else ("supports", name)


def support_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Supports on groups that the mesh does not have, or at points where no node is."""
    mesh, source = on_mesh.mesh, on_mesh.case.source
    usual = {**mesh.facet_groups, **mesh.node_groups}
    faults = []
    for path, support in support_keys(on_mesh.case):
        if support.at is not None:
            if not len(support_nodes(mesh, support)):
                places = mesh.points[: mesh.n_places]
                away = np.linalg.norm(places - np.array(support.at), axis=1)
                nearest = format_point(mesh.points[int(np.argmin(away))])
                message = f"no node of {mesh.file} is at {format_point(np.array(support.at))}"
                hint = f"The nearest node is at {nearest}; write its coordinates."
                faults.append(source.fault((*path, "at"), "no-node-there", message, hint))
        elif support.group not in {**usual, **mesh.groups}:
            what = f"group '{support.group}'"
            faults.append(on_mesh.missing_group(path, what, "groups of faces and nodes", usual))
    return faults


def load_keys(case: Case) -> list[tuple[KeyPath, Load]]:
    """Every load of the case with the key where it is written."""
    keys: list[tuple[KeyPath, Load]] = [(("loads", k), v) for k, v in case.loads.items()]
    for n, stage in enumerate(case.stages):
        keys += [(("stages", n, "loads", k), v) for k, v in stage.loads.items()]
    return keys


def load_key(name: str, since: int) -> KeyPath:
    """Where a load is written that acts from the end of a state on."""
    return ("stages", since - 1, "loads", name) if since else ("loads", name)


def load_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Loads on groups that the mesh does not have or that no element borders."""
    case, mesh = on_mesh.case, on_mesh.mesh
    of_nodes = {**mesh.node_groups, **mesh.facet_groups, **mesh.groups}
    faults = []
    for path, load in load_keys(case):
        on = (*path, "on")
        if isinstance(load, Seismic | HeadForce):
            continue
        if isinstance(load, PointForce):
            if isinstance(load.place, str) and load.place not in of_nodes:
                what = f"group '{load.place}'"
                faults.append(on_mesh.missing_group(on, what, "groups of nodes", mesh.node_groups))
        elif load.group not in mesh.facet_groups:
            what = f"group of faces '{load.group}'"
            faults.append(on_mesh.missing_group(on, what, "groups of faces", mesh.facet_groups))
        elif np.any(load_faces(mesh, on_mesh.table, load.group) < 0):
            message = f"some faces of '{load.group}' border no element"
            hint = f"its groups of faces: {listed(mesh.facet_groups)}"
            faults.append(case.source.fault(on, "missing-group", message, hint))
    return faults


def load_place_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Loads that at some stage have no free face or no ground to act on."""
    case, mesh = on_mesh.case, on_mesh.mesh
    faults: dict[KeyPath, Fault] = {}
    for n, state in enumerate(on_mesh.sequence.states):
        present = on_mesh.sequence.present(n)
        for name, load in state.loads.items():
            path = load_key(name, state.loads_since[name])
            if path in faults or isinstance(load, Seismic):
                continue
            if isinstance(load, HeadForce):
                if load.structure not in state.structures:
                    faults[path] = _head_fault(case, load, path, state.name)
                continue
            if isinstance(load, PointForce):
                if not _has_ground(on_mesh, load, present):
                    faults[path] = _force_fault(case, load, path, state.name)
            elif not load_patches(mesh, on_mesh.table, load.group, present):
                faults[path] = _face_fault(case, load, (*path, "on"), state.name)
    return list(faults.values())


def _has_ground(on_mesh: CaseOnMesh, load: PointForce, present: Bools) -> bool:
    """Whether a point force acts on ground that is present."""
    if not isinstance(load.place, str):
        return on_mesh.locator.best(load.place, present) is not None
    ground_nodes = nodes_in(on_mesh.mesh.blocks, present)
    nodes = group_nodes(on_mesh.mesh, load.place)
    return len(nodes) > 0 and bool(np.isin(nodes, ground_nodes).all())


def _force_fault(case: Case, load: PointForce, path: KeyPath, stage: str) -> Fault:
    if isinstance(load.place, str):
        where, path = f"nodes of '{load.place}' lie", (*path, "on")
    else:
        where, path = f"the point {load.place} of the force lies", (*path, "at")
    return case.source.fault(
        path,
        "no-ground-there",
        f"at stage '{stage}' {where} in no ground that is present",
        "correct the place, or 'remove' the force before its ground is gone",
    )


def _head_fault(case: Case, load: HeadForce, path: KeyPath, stage: str) -> Fault:
    return case.source.fault(
        (*path, "on"),
        "no-such-structure",
        f"at stage '{stage}' the load acts on the heads of '{load.structure}', which does "
        "not stand then",
        f"add 'build: [{load.structure}]', or 'remove' the load before it is dismantled",
    )


def _face_fault(case: Case, load: FaceLoad, path: KeyPath, stage: str) -> Fault:
    return case.source.fault(
        path,
        "no-free-face",
        f"at stage '{stage}' faces of '{load.group}' are not at the surface "
        "of the ground: elements stand on both sides, or on none",
        "let the load begin when the face is open, and 'remove' it before it is gone",
    )

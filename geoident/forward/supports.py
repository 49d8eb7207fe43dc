"""Supports and loads on the named groups of a mesh."""

from __future__ import annotations

import numpy as np

from geoident.errors import Fault
from geoident.fem.faces import FaceTable, FacetPatch, patches
from geoident.forward.timeline import Timeline, listed
from geoident.model.actions import Load
from geoident.model.arrays import Bools, Ints
from geoident.model.case import Case, KeyPath
from geoident.model.mesh import ElementBlock, Mesh


def fixed_dofs(case: Case, mesh: Mesh) -> Bools:
    """(n_dofs,) which degrees of freedom the supports hold."""
    fixed = np.zeros((mesh.n_nodes, mesh.dim), dtype=bool)
    for support in case.supports:
        nodes = group_nodes(mesh, support.group)
        for component in support.components:
            fixed[nodes, component] = True
    return fixed.ravel()


def group_nodes(mesh: Mesh, name: str) -> Ints:
    """Nodes of a group of facets, nodes or elements (searched in this order)."""
    if name in mesh.facet_groups:
        return _nodes_of(mesh.facets, mesh.facet_groups[name])
    if name in mesh.node_groups:
        return mesh.node_groups[name]
    return _nodes_of(mesh.blocks, mesh.groups[name])


def support_faults(case: Case, mesh: Mesh) -> list[Fault]:
    """Supports on groups that the mesh does not have."""
    known = {**mesh.facet_groups, **mesh.node_groups, **mesh.groups}
    return [
        case.source.fault(
            ("supports", support.group),
            code="missing-group",
            message=f"the mesh {mesh.file} has no group '{support.group}'",
            hint=f"its groups of faces and nodes: "
            f"{listed({**mesh.facet_groups, **mesh.node_groups})}",
        )
        for support in case.supports
        if support.group not in known
    ]


def load_keys(case: Case) -> list[tuple[KeyPath, Load]]:
    """Every load of the case with the key where it is written."""
    keys: list[tuple[KeyPath, Load]] = [(("loads", k), v) for k, v in case.loads.items()]
    for n, stage in enumerate(case.stages):
        keys += [(("stages", n, "loads", k), v) for k, v in stage.loads.items()]
    return keys


def load_faults(case: Case, mesh: Mesh, table: FaceTable) -> list[Fault]:
    """Loads on groups that the mesh does not have or that no element borders."""
    faults = []
    for path, load in load_keys(case):
        if load.group not in mesh.facet_groups:
            message = f"the mesh {mesh.file} has no group of faces '{load.group}'"
        elif np.any(load_faces(mesh, table, load.group) < 0):
            message = f"some faces of '{load.group}' border no element"
        else:
            continue
        hint = f"its groups of faces: {listed(mesh.facet_groups)}"
        faults.append(
            case.source.fault((*path, "on"), code="missing-group", message=message, hint=hint)
        )
    return faults


def load_faces(mesh: Mesh, table: FaceTable, group: str) -> Ints:
    """Identity in the face table of every facet of a group, -1 where it borders no element."""
    found = np.concatenate([table.find(block) for block in mesh.facets])
    return np.asarray(found[mesh.facet_groups[group]])


def load_patches(
    mesh: Mesh, table: FaceTable, group: str, present: Bools
) -> tuple[FacetPatch, ...] | None:
    """The loaded free faces of the present body; None if a face is not free (inside, or absent)."""
    wanted = np.unique(load_faces(mesh, table, group))
    rows = table.free(present)
    rows = rows[np.isin(table.face[rows], wanted)]
    if len(rows) != len(wanted):
        return None
    return patches(mesh, table, rows)


def burden_faults(case: Case, mesh: Mesh, table: FaceTable, timeline: Timeline) -> list[Fault]:
    """Loads that at some stage have no free face to act on."""
    paths = {id(load): path for path, load in load_keys(case)}
    faults: dict[KeyPath, Fault] = {}
    for n, state in enumerate(timeline.states):
        for load in state.loads.values():
            path = (*paths[id(load)], "on")
            if path in faults or load_patches(mesh, table, load.group, timeline.present(n)):
                continue
            faults[path] = case.source.fault(
                path,
                code="no-free-face",
                message=f"at stage '{state.name}' faces of '{load.group}' are not at the surface "
                "of the ground: elements stand on both sides, or on none",
                hint="let the load begin when the face is open, and 'remove' it before it is gone",
            )
    return list(faults.values())


def _nodes_of(blocks: tuple[ElementBlock, ...], elements: Ints) -> Ints:
    nodes, first = [], 0
    for block in blocks:
        mine = elements[(elements >= first) & (elements < first + len(block))] - first
        nodes.append(block.nodes[mine].ravel())
        first += len(block)
    return np.unique(np.concatenate(nodes)) if nodes else np.empty(0, np.int64)

"""Supports and loads on the named groups of a mesh."""

from __future__ import annotations

import numpy as np

from geoident.errors import Fault
from geoident.fem.faces import FaceTable, load_faces, load_patches
from geoident.fem.kinematics import kinematics_of
from geoident.fem.location import Locator, Site
from geoident.forward.stages import ConstructionSequence, listed
from geoident.model.actions import FaceLoad, Load, PointForce, Seismic
from geoident.model.arrays import Bools, Ints
from geoident.model.case import Case, KeyPath
from geoident.model.mesh import Mesh, nodes_in


def fixed_dofs(case: Case, mesh: Mesh) -> Bools:
    """(n_dofs,) which degrees of freedom the supports hold, and the axis of revolution."""
    fixed = np.zeros((mesh.n_nodes, mesh.dim), dtype=bool)
    for support in case.supports:
        nodes = group_nodes(mesh, support.group)
        for component in support.components:
            fixed[nodes, component] = True
    fixed[kinematics_of(case.analysis).on_axis(mesh.points), 0] = True
    return fixed.ravel()


def group_nodes(mesh: Mesh, name: str) -> Ints:
    """Nodes (k,) of a group of facets, nodes or elements (searched in this order)."""
    if name in mesh.facet_groups:
        return nodes_in(mesh.facets, mesh.facet_groups[name])
    if name in mesh.node_groups:
        return mesh.node_groups[name]
    return nodes_in(mesh.blocks, mesh.groups[name])


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


def load_key(name: str, since: int) -> KeyPath:
    """Where a load is written that acts from the end of a state on."""
    return ("stages", since - 1, "loads", name) if since else ("loads", name)


def load_faults(case: Case, mesh: Mesh, table: FaceTable) -> list[Fault]:
    """Loads on groups that the mesh does not have or that no element borders.

    Args:
        case: the case.
        mesh: its mesh.
        table: its faces.
    """
    faults = []
    for path, load in load_keys(case):
        if isinstance(load, PointForce | Seismic):
            faults += _place_faults(case, mesh, path, load)
            continue
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


def _place_faults(case: Case, mesh: Mesh, path: KeyPath, load: PointForce | Seismic) -> list[Fault]:
    """A point force on a group that the mesh does not have."""
    known = {**mesh.node_groups, **mesh.facet_groups, **mesh.groups}
    if isinstance(load, Seismic) or not isinstance(load.place, str) or load.place in known:
        return []
    return [
        case.source.fault(
            (*path, "on"),
            code="missing-group",
            message=f"the mesh {mesh.file} has no group '{load.place}'",
            hint=f"its groups of nodes: {listed(mesh.node_groups)}",
        )
    ]


def point_site(locator: Locator, load: PointForce, present: Bools) -> Site | None:
    """The present element that takes a point force best; None if it acts on nodes or nowhere.

    Args:
        locator: finds points.
        load: the force.
        present: (n_elements,) which elements are there.
    """
    if isinstance(load.place, str):
        return None
    return next((s for s in locator.sites(load.place) if present[s.element]), None)


def load_place_faults(
    case: Case, mesh: Mesh, table: FaceTable, locator: Locator, sequence: ConstructionSequence
) -> list[Fault]:
    """Loads that at some stage have no free face or no ground to act on.

    Args:
        case: the case.
        mesh: its mesh.
        table: its faces.
        locator: finds points in it.
        sequence: the states of construction.
    """
    faults: dict[KeyPath, Fault] = {}
    for n, state in enumerate(sequence.states):
        present = sequence.present(n)
        for name, load in state.loads.items():
            path = load_key(name, state.loads_since[name])
            if path in faults or isinstance(load, Seismic):
                continue
            if isinstance(load, PointForce):
                if not _has_ground(mesh, locator, load, present):
                    faults[path] = _force_fault(case, load, path, state.name)
            elif not load_patches(mesh, table, load.group, present):
                faults[path] = _face_fault(case, load, (*path, "on"), state.name)
    return list(faults.values())


def _has_ground(mesh: Mesh, locator: Locator, load: PointForce, present: Bools) -> bool:
    """Whether a point force acts on ground that is present."""
    if not isinstance(load.place, str):
        return point_site(locator, load, present) is not None
    here = nodes_in(mesh.blocks, present)
    nodes = group_nodes(mesh, load.place)
    return len(nodes) > 0 and bool(np.isin(nodes, here).all())


def _force_fault(case: Case, load: PointForce, path: KeyPath, stage: str) -> Fault:
    if isinstance(load.place, str):
        where, path = f"nodes of '{load.place}' lie", (*path, "on")
    else:
        where, path = f"the point {load.place} of the force lies", (*path, "at")
    return case.source.fault(
        path,
        code="no-ground-there",
        message=f"at stage '{stage}' {where} in no ground that is present",
        hint="correct the place, or 'remove' the force before its ground is gone",
    )


def _face_fault(case: Case, load: FaceLoad, path: KeyPath, stage: str) -> Fault:
    return case.source.fault(
        path,
        code="no-free-face",
        message=f"at stage '{stage}' faces of '{load.group}' are not at the surface "
        "of the ground: elements stand on both sides, or on none",
        hint="let the load begin when the face is open, and 'remove' it before it is gone",
    )

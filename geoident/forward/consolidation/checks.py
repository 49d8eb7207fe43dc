"""Whether ground can consolidate on its mesh, and water has a way out."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from geoident.errors import Fault
from geoident.forward.consolidation.pores import drained_nodes
from geoident.forward.stages import CaseOnMesh, ConstructionState
from geoident.forward.structures.interfaces import beams_on
from geoident.model.arrays import Ints
from geoident.model.case import Case, KeyPath
from geoident.model.cells import CELLS
from geoident.model.hydraulic import Drained
from geoident.model.mesh import nodes_in, rows_in
from geoident.model.parameter import Values


def drained_group_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Drained faces that the mesh does not have."""
    mesh = on_mesh.mesh
    usual = {**mesh.facet_groups, **mesh.node_groups}
    return [
        on_mesh.missing_group(path, f"group '{name}'", "groups of faces and nodes", usual)
        for path, name in _drained_keys(on_mesh.case)
        if name not in {**usual, **mesh.groups}
    ]


def consolidation_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Elements of first order, stages from which no water leaves, drained faces without ground."""
    if not on_mesh.case.consolidates:
        return []
    return [
        *_orders(on_mesh),
        *_undrained(on_mesh),
        *_drained_elsewhere(on_mesh),
        *_two_heads(on_mesh),
    ]


def leaking_walls(on_mesh: CaseOnMesh) -> list[str]:
    """A note on walls between interfaces through which water flows, as seldom meant."""
    case = on_mesh.case
    leaking = [
        name
        for name, given in case.interfaces.items()
        if given.permeable and any(beams_on(case, one) for one in on_mesh.joints[given.along])
    ]
    if not leaking or not case.consolidates:
        return []
    return [
        f"water flows through the walls on {', '.join(map(repr, leaking))}: those that hold it "
        "back need 'permeable: false' there"
    ]


def inadmissible_water(case: Case, name: str, values: Values) -> str | None:
    """Why the water of a material is not admissible, a sentence; None if it is."""
    hydraulic = case.materials[name].hydraulic
    breach = None if hydraulic is None else hydraulic.breach(values)
    return None if breach is None else f"of {name} {breach}"


def _orders(on_mesh: CaseOnMesh) -> Iterator[Fault]:
    """Consolidating materials with elements whose pressures would oscillate."""
    case, mesh, sequence = on_mesh.case, on_mesh.mesh, on_mesh.sequence
    for name, material in case.materials.items():
        if not material.consolidates:
            continue
        groups = {g for s in sequence.states for g, m in s.materials.items() if m == name}
        elements = np.flatnonzero(np.isin(sequence.group_of, sorted(groups)))
        kinds = [
            block.kind
            for block, rows in rows_in(mesh.blocks, elements)
            if len(rows) and CELLS[block.kind].order == 1
        ]
        if kinds:
            yield case.source.fault(
                ("materials", name, "hydraulic"),
                "first-order",
                f"'{name}' consolidates, and the mesh {mesh.file} has elements of first "
                f"order there ({', '.join(kinds)}), in which pressures of water oscillate",
                f"Write 'mesh: {{file: {mesh.file}, order: 2}}'.",
            )


def _undrained(on_mesh: CaseOnMesh) -> Iterator[Fault]:
    """Stages that last, and from whose ground no water can leave."""
    case = on_mesh.case
    for n, state in enumerate(on_mesh.sequence.states):
        materials = set(state.materials.values())
        consolidates = any(case.materials[name].consolidates for name in materials)
        if not state.lasts or state.goes_on or not consolidates:
            continue
        if any(_has_drains(case, name) for name in materials):
            continue
        corners = _corners(on_mesh, state, consolidating=True)
        at_once = _corners(on_mesh, state, consolidating=False)
        drained = [drained_nodes(on_mesh, name) for name in state.drained]
        if not np.intersect1d(corners, np.concatenate([at_once, *drained])).size:
            yield case.source.fault(
                ("stages", n - 1, "lasts") if n else ("stages",),
                "undrained",
                f"'{case.stages[n - 1].whole}' lasts, and no water leaves its ground: "
                "no face is drained, and no ground has drains",
                "Write 'drained: {GROUP OF FACES: {}}' in the case or in the stage, give a "
                "material 'drains', or write 'lasts: 0 d' for a stage in which no time passes.",
            )


def _drained_elsewhere(on_mesh: CaseOnMesh) -> Iterator[Fault]:
    """Drained faces that touch no consolidating ground at any state."""
    case, states = on_mesh.case, on_mesh.sequence.states
    corners = [_corners(on_mesh, state, consolidating=True) for state in states]
    filled = np.unique(np.concatenate(corners))
    for path, name in _drained_keys(case):
        if not np.intersect1d(drained_nodes(on_mesh, name), filled).size:
            yield case.source.fault(
                path,
                "no-water-there",
                f"'{name}' is drained, and touches no ground with 'hydraulic' at any stage",
                "Correct the name of the group, or give the material there 'hydraulic'.",
            )


def _two_heads(on_mesh: CaseOnMesh) -> Iterator[Fault]:
    """Faces with two heads, of two drained groups; where these only meet, the later one counts."""
    case, sequence = on_mesh.case, on_mesh.sequence
    told: set[frozenset[str]] = set()
    for n, state in enumerate(sequence.states):
        for one, other in combinations(state.drained, 2):
            heads = [_head(state.drained[name]) for name in (one, other)]
            if heads[0] == heads[1] or {one, other} in told:
                continue
            common = np.intersect1d(_faces(on_mesh, one), _faces(on_mesh, other)).size
            if not common:
                continue
            told.add(frozenset((one, other)))
            paths = [
                path
                for path, name in _drained_keys(case)
                if name in {one, other}
                and (path[0] == "drained" or sequence.built_on[int(path[1]) + 1, n])
            ]
            yield case.source.fault(
                paths[-1],
                "two-heads",
                f"'{one}' and '{other}' have {common} face{'s' * (common > 1)} in common, drained "
                f"with {heads[0]} by the one and with {heads[1]} by the other",
                "Give both the same head, let one of them end ('GROUP: closed'), or name groups "
                "that have no face in common.",
            )


def _head(drained: Drained) -> str:
    """What a drained face is given, for a message; equal only where the numbers are."""
    if drained.head is None:
        return "the pressure at rest"
    factor, parameter = drained.head.factor, drained.head.parameter
    if parameter is None:
        return f"head {factor:.12g} m"
    return f"head {'' if factor == 1.0 else f'{factor:.12g} '}${parameter}"


def _faces(on_mesh: CaseOnMesh, name: str) -> Ints:
    """Identities (k,) of the faces of ground of a drained group: its own, or all within it."""
    mesh, table = on_mesh.mesh, on_mesh.table
    if name in mesh.facet_groups:
        rows = rows_in(mesh.facets, mesh.facet_groups[name])
        return np.concatenate([table.find(block)[of] for block, of in rows])
    within = np.isin(np.arange(mesh.n_nodes), drained_nodes(on_mesh, name))
    every = table.by_place(mesh, np.arange(len(table.face)))
    return np.concatenate([table.face[at[within[nodes].all(axis=1)]] for _, _, at, nodes in every])


def _has_drains(case: Case, name: str) -> bool:
    hydraulic = case.materials[name].hydraulic
    return hydraulic is not None and hydraulic.drains is not None


def _corners(on_mesh: CaseOnMesh, state: ConstructionState, *, consolidating: bool) -> Ints:
    """Nodes of the ground of a state that water takes time to leave, or leaves at once."""
    materials, sequence = on_mesh.case.materials, on_mesh.sequence
    wanted = [
        group
        for group, name in state.materials.items()
        if (materials[name].consolidates if consolidating else materials[name].hydraulic is None)
    ]
    return nodes_in(on_mesh.mesh.blocks, np.isin(sequence.group_of, wanted))


def _drained_keys(case: Case) -> list[tuple[KeyPath, str]]:
    """Every group of drained faces with the key where it is written."""
    keys: list[tuple[KeyPath, str]] = [(("drained", name), name) for name in case.drained]
    for n, stage in enumerate(case.stages):
        keys += [(("stages", n, "drained", name), name) for name in stage.drained]
    return keys

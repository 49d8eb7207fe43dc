"""Whether a mesh is what was meant: tangled, on top of itself, parted, turned."""

from __future__ import annotations

import numpy as np

from geoident.errors import Fault, Location
from geoident.fem.faces import hanging_nodes, nonconforming
from geoident.fem.location import format_point
from geoident.fem.measure import coinciding_nodes
from geoident.fem.orientation import overlapping
from geoident.fem.overlaps import Overlaps, overlaps
from geoident.forward.of_mesh import OfMesh
from geoident.forward.stages import CaseOnMesh, element_number, used_groups
from geoident.model.arrays import Bools, Ints
from geoident.model.mesh import nodes_in, spans

_NAMED = 5  # elements or pairs in a message: enough to find the place

_overlapping_of = OfMesh[Ints]()
_overlaps_of = OfMesh[Overlaps]()


def mesh_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Ground that is there twice: elements that are present together and lie on each other."""
    return _tangle_faults(on_mesh) or _overlap_faults(on_mesh)


def mesh_notes(on_mesh: CaseOnMesh) -> list[str]:
    """Notes on what is allowed but may not be meant."""
    return [
        *_turned_notes(on_mesh),
        *_conformity_notes(on_mesh),
        *_duplicate_notes(on_mesh),
        *_hanging_notes(on_mesh),
    ]


def _tangle_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Elements that are present together and lie on the same side of the face that they share."""
    mesh, sequence = on_mesh.mesh, on_mesh.sequence
    pairs = _overlapping_of(mesh, None, lambda: overlapping(mesh, on_mesh.table))
    states = range(len(sequence.states))
    together = np.zeros(len(pairs), dtype=np.bool_)
    for present in {sequence.present(n).tobytes(): sequence.present(n) for n in states}.values():
        together |= present[pairs].all(axis=1)
    pairs = pairs[together]
    if not len(pairs):
        return []
    members = [element_number(mesh, int(e)) for e in pairs.ravel()]
    named = [f"{a} and {b}" for a, b in zip(members[::2], members[1::2], strict=True)][:_NAMED]
    more = f" and {len(pairs) - _NAMED} more pairs" if len(pairs) > _NAMED else ""
    one, other = (nodes_in(mesh.blocks, np.array([e])) for e in pairs[0])
    nodes = np.intersect1d(one, other)
    turned = np.isin(members, on_mesh.turned).any()
    why = ", after some were turned that had their nodes clockwise" if turned else ""
    message = (
        f"the mesh is tangled: elements {', '.join(named)}{more} lie on the same side of the face "
        f"that they share{why} (the first near {format_point(mesh.points[nodes].mean(axis=0))})"
    )
    hint = "look at the mesh there: a node in the wrong place, or two parts on top of each other"
    return [Fault("tangled-mesh", message, hint, Location(mesh.file))]


def _presence(on_mesh: CaseOnMesh) -> tuple[Ints, Bools]:
    """Part (n_elements,) of the ground that comes and goes together; (k, k) which ever meet."""
    sequence = on_mesh.sequence
    present = np.zeros((len(sequence.groups), len(sequence.states)), dtype=np.bool_)
    for n, state in enumerate(sequence.states):
        present[list(state.materials), n] = True
    history, part = np.unique(present, axis=0, return_inverse=True)
    number = history.astype(np.int64)
    return part.ravel()[sequence.group_of], number @ number.T > 0


def _overlap_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Elements that are present together and lie in each other without sharing a face."""
    mesh, group_of = on_mesh.mesh, on_mesh.sequence.group_of
    part, together = _presence(on_mesh)
    doubled = _overlaps_of(mesh, part.tobytes(), lambda: overlaps(mesh, on_mesh.table, part))
    doubled = doubled.of(together[part[doubled.element], part[doubled.other]])
    pairs = np.sort(np.stack([group_of[doubled.element], group_of[doubled.other]], axis=1), axis=1)
    return [
        _overlap_fault(on_mesh, tuple(pair), doubled.of(np.all(pairs == pair, axis=1)))
        for pair in np.unique(pairs, axis=0)
    ]


def _overlap_fault(on_mesh: CaseOnMesh, pair: tuple[int, ...], doubled: Overlaps) -> Fault:
    """Of the places at which elements of two groups, or of one, lie in each other."""
    mesh, groups = on_mesh.mesh, on_mesh.sequence.groups
    names = [repr(groups[g]) for g in dict.fromkeys(pair)]
    whose = (
        f"the groups {' and '.join(names)} overlap" if names[1:] else f"{names[0]} overlaps itself"
    )
    one, other = (element_number(mesh, int(e)) for e in (doubled.element[0], doubled.other[0]))
    n = len(np.unique(np.concatenate([doubled.element, doubled.other])))
    low, high = doubled.place.min(axis=0), doubled.place.max(axis=0)
    message = (
        f"{whose}: {n} elements lie in each other without sharing a face, between "
        f"{format_point(low)} and {format_point(high)} (the first: {one} and {other} near "
        f"{format_point(doubled.place[0])}); ground there would weigh and resist twice"
    )
    hint = (
        "cut one part out of the other before meshing (gmsh: BooleanFragments), delete the second "
        "copy, or write 'NAME: absent' for a group that is not meant"
    )
    place = used_groups(on_mesh.case)[groups[pair[-1]]]
    return on_mesh.case.source.fault(
        place, "overlapping-ground", f"in the mesh {mesh.file} {message}", hint
    )


def _turned_notes(on_mesh: CaseOnMesh) -> list[str]:
    """Which elements were turned."""
    turned = on_mesh.turned
    if not len(turned):
        return []
    way = "clockwise" if on_mesh.mesh.dim == 2 else "inside out"
    if len(turned) == on_mesh.mesh.n_elements:
        return [f"all elements of the mesh are numbered {way}; they were turned"]
    named = ", ".join(str(n) for n in turned[:_NAMED])
    more = f" and {len(turned) - _NAMED} more" if len(turned) > _NAMED else ""
    which = f"elements {named}{more} are" if len(turned) > 1 else f"element {named} is"
    return [f"{which} numbered {way}, other than the rest; they were turned"]


def _duplicate_notes(on_mesh: CaseOnMesh) -> list[str]:
    """Where nodes of different elements stand at one place, so that the ground can part there."""
    pairs = coinciding_nodes(on_mesh.mesh)
    if not len(pairs):
        return []
    n, place = len(pairs), format_point(on_mesh.mesh.points[pairs[0, 0]])
    what = f"{n} pairs of nodes coincide" if n > 1 else "two nodes coincide"
    return [
        f"{what} ({'the first ' if n > 1 else ''}near {place}): {_sides(on_mesh, pairs)} "
        "are not tied there and can part or overlap; if no slit is meant, "
        "merge them (gmsh: Coherence Mesh)"
    ]


def _sides(on_mesh: CaseOnMesh, pairs: Ints) -> str:
    """What pairs of nodes (k, 2) at one place belong to."""
    sequence = on_mesh.sequence
    group = np.full(on_mesh.mesh.n_nodes, -1, dtype=np.int64)
    for block, span in spans(on_mesh.mesh.blocks):
        group[block.nodes] = sequence.group_of[span][:, None]
    met = np.unique(np.sort(group[pairs], axis=1), axis=0)
    between = [" and ".join(repr(sequence.groups[g]) for g in pair) for pair in met[:_NAMED]]
    if len(met) == 1 and met[0, 0] == met[0, 1]:
        return f"elements of {sequence.groups[met[0, 0]]!r} that do not share a node"
    if len(met) == 1:
        return between[0]
    more = f" and {len(met) - _NAMED} more pairs of groups" if len(met) > _NAMED else ""
    return f"elements of {', of '.join(between)}{more} that do not share a node"


def _hanging_notes(on_mesh: CaseOnMesh) -> list[str]:
    """Where nodes stand on elements that do not have them."""
    mesh = on_mesh.mesh
    nodes = hanging_nodes(mesh, on_mesh.table)
    if not len(nodes):
        return []
    n, place = len(nodes), format_point(mesh.points[nodes[0]])
    what = f"{n} nodes stand" if n > 1 else "a node stands"
    return [
        f"{what} inside the side of an element that does not have {'them' if n > 1 else 'it'} "
        f"({'the first ' if n > 1 else ''}near {place}): the elements are not tied there and can "
        "part or overlap; let neighbours share whole sides (gmsh: fragment or Coherence before "
        "meshing)"
    ]


def _conformity_notes(on_mesh: CaseOnMesh) -> list[str]:
    """Where elements touch without sharing a face."""
    centres = nonconforming(on_mesh.mesh, on_mesh.table)
    if not len(centres):
        return []
    n = len(centres)
    faces = f"{n} quadrilateral faces lie" if n > 1 else "1 quadrilateral face lies"
    return [
        f"{faces} against triangles, {'the first ' if n > 1 else ''}near "
        f"{format_point(centres[0])}: elements that do not share whole faces can part there; "
        "put pyramids between hexahedra and tetrahedra, as gmsh does"
    ]


def _groups_at(on_mesh: CaseOnMesh, node: int) -> list[str]:
    """Names of the groups of the elements that have a node."""
    sequence = on_mesh.sequence
    groups = set()
    for block, span in spans(on_mesh.mesh.blocks):
        having = np.any(block.nodes == node, axis=1)
        groups |= set(sequence.group_of[span][having].tolist())
    return [sequence.groups[g] for g in sorted(groups)]


def parted_from(on_mesh: CaseOnMesh, elements: Ints) -> str:
    """Why some elements (k,) hang on nothing, where their nodes are copies; empty otherwise."""
    mesh = on_mesh.mesh
    own = nodes_in(mesh.blocks, elements)
    pairs = coinciding_nodes(mesh)
    pairs = pairs[np.isin(pairs, own).sum(axis=1) == 1]
    if not len(pairs):
        return ""
    node = pairs[0][~np.isin(pairs[0], own)]
    beside = " and ".join(repr(name) for name in _groups_at(on_mesh, int(node[0])))
    n = len(pairs)
    which = f"{n} of its nodes stand" if n > 1 else "One of its nodes stands"
    return (
        f"{which} where nodes of {beside} stand, and "
        f"{'are' if n > 1 else 'is'} not the same (the first near "
        f"{format_point(mesh.points[pairs[0, 0]])}): merge them (gmsh: Coherence Mesh)."
    )

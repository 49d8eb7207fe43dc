"""Whether structures find the mesh and the ground that they need, and what to know of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping

import numpy as np

from geoident.errors import Fault
from geoident.fem.location import format_point
from geoident.fem.shells import consistent_sides, corners_of, flat_triangles
from geoident.fem.structures import straight_pieces
from geoident.forward.actions.supports import fixed_dofs, group_nodes, mirror_axis
from geoident.forward.stages import CaseOnMesh, ConstructionState
from geoident.forward.structures.members import rigidities
from geoident.forward.structures.placing import (
    clamped_nodes,
    held_points,
    hinge_nodes,
    present_throughout,
)
from geoident.model.actions import FaceDistance, Release
from geoident.model.arrays import Bools, Ints
from geoident.model.case import Case, KeyPath
from geoident.model.dual import ParameterPoint
from geoident.model.mesh import Mesh, and_inner, nodes_in, rows_in
from geoident.model.parameter import Scalar, Values
from geoident.model.structures import (
    Bars,
    Beam,
    GroutedBars,
    OpeningSupport,
    Piles,
    Shell,
    Structure,
    Struts,
)

ON_PLANE = 1e-6
"""Distance from a plane, in parts of the size of the mesh, that counts as on it."""


def structure_notes(on_mesh: CaseOnMesh) -> list[str]:
    """Linings that end at supports and turn freely there, and `built_notes`."""
    mesh = on_mesh.mesh
    built = {name for state in on_mesh.sequence.states for name in state.structures}
    held = np.logical_or.reduce(fixed_dofs(on_mesh).reshape(-1, mesh.dim), axis=1)
    notes = []
    for name, structure in on_mesh.case.structures.items():
        if name in built and isinstance(structure, Beam):
            nodes, count = np.unique(straight_pieces(mesh, structure.group), return_counts=True)
            free = held & ~clamped_nodes(mesh, structure)
            free &= ~on_mesh.kinematics.on_axis(mesh.points)
            ends = nodes[(count == 1) & free[nodes]]
            if len(ends):
                notes.append(
                    f"the lining '{name}' ends at {len(ends)} nodes that supports hold, and turns "
                    "freely there; on a plane of symmetry name the group under 'clamped_on'"
                )
        elif name in built and isinstance(structure, Shell):
            free = _free_edge(on_mesh, structure)
            n = int(np.count_nonzero(held[free]))
            if n:
                notes.append(
                    f"the shell '{name}' ends at {n} nodes that supports hold, and turns "
                    "freely there; name the group under 'mirrored_on' where it is a plane of "
                    "symmetry, under 'clamped_on' where the shell is clamped"
                )
            notes += _kinks(name, structure, on_mesh)
        elif name in built and isinstance(structure, GroutedBars):
            notes += _long_pieces(name, structure, on_mesh.case.start)
    return notes + built_notes(on_mesh)


_LONGEST = 1.0
"""Pieces of grouted bars by the length on which N decays; twice that it jumps to and fro."""


def _long_pieces(name: str, bars: GroutedBars, values: Values) -> Iterator[str]:
    """Grouted bars whose pieces are too long for the stiffness of their grout."""
    EA, k = (float(one.value) for one in rigidities(bars, ParameterPoint(values, ())))
    decay = (EA / k) ** 0.5
    length = max(float(np.linalg.norm(np.subtract(*pair))) - bars.free for pair in bars.ends)
    if length / bars.pieces > _LONGEST * decay:
        enough = int(np.ceil(2 * length / decay))
        yield (
            f"the pieces of '{name}' are {length / bars.pieces:.3g} m long, and its force decays "
            f"on sqrt(EA / k) = {decay:.3g} m: write 'pieces: {enough}'"
        )


_KINKS = 0.05
"""Error of m of a lining on triangles of first order, by their area over the square of t: measured
on rings of t = 0.05 to 0.5 m on triangles of 0.02 to 0.09 m2, R = 3 m (0.03 to 0.08)."""

_FLAT = np.cos(np.radians(0.1))
"""Of the angle of a face to what goes on smoothly beside it, below which a shell is flat."""


def _kinks(name: str, shell: Shell, on_mesh: CaseOnMesh) -> Iterator[str]:
    """Curved shells on triangles of first order that are large for the thickness."""
    mesh, faces = on_mesh.mesh, on_mesh.mesh.facet_groups[shell.group]
    turned, _ = consistent_sides(corners_of(mesh, faces), np.zeros(len(faces), dtype=np.int64))
    triangles = flat_triangles(mesh, faces, turned)
    of_first = [block.kind == "tri3" for block, rows in rows_in(mesh.facets, faces) for _ in rows]
    x = mesh.points[triangles.nodes]
    normal = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    twice = np.linalg.norm(normal, axis=1)
    beside = np.einsum("mk,msk->ms", normal, triangles.normals).min(axis=1)
    kinked = np.array(of_first)[triangles.face] & (beside < _FLAT * twice)
    if not kinked.any():
        return
    t = shell.thickness.value(on_mesh.case.start)
    area = float(twice[kinked].mean()) / 2
    error = _KINKS * area / t**2
    if error > _KINKS:
        yield (
            f"the shell '{name}' is curved, on triangles of first order of {area:.2g} m2, and "
            f"{t:.3g} m thick: moments of its faces are off by some {100 * min(error, 1):.0f} %. "
            "Take elements of second order, or quadrilaterals, or triangles smaller than the "
            "square of the thickness"
        )


def _free_edge(on_mesh: CaseOnMesh, shell: Shell) -> Ints:
    """Nodes (k,) at the edge of a shell that the case neither clamps nor mirrors."""
    mesh = on_mesh.mesh
    corners = corners_of(mesh, mesh.facet_groups[shell.group])
    sides = Counter(
        frozenset(pair) for own in corners for pair in zip(own, own[1:] + own[:1], strict=True)
    )
    edge = np.array(sorted({n for pair, count in sides.items() if count == 1 for n in pair}))
    named = [group_nodes(mesh, group) for group in (*shell.clamped_on, *shell.mirrored_on)]
    return np.setdiff1d(edge.astype(np.int64), np.concatenate([np.empty(0, np.int64), *named]))


def built_notes(on_mesh: CaseOnMesh) -> list[str]:
    """Structures that no stage builds, with a mesh or without one.

    Also from where behind the face others stand, and what is built with the excavation beside it.
    """
    states = on_mesh.sequence.states
    built = {name for state in states for name in state.structures}
    notes = [
        f"no stage builds the structure '{name}', so it supports nothing: name it under 'build' of "
        "a stage"
        for name in on_mesh.case.structures
        if name not in built
    ]
    for state in states[1:]:
        before = states[state.base]
        distances = [x for x in before.release.values() if isinstance(x, FaceDistance)]
        for name in sorted(state.built):
            what = f"the structure '{name}' is built at stage '{state.name}'"
            if distances:
                notes.append(
                    f"{what}: it stands from the distance to the face at stage '{before.name}', "
                    f"{_distance(distances[0])}, on and takes its share of what is released after "
                    "that"
                )
            elif name not in state.stressed and _lines(on_mesh, name, state.leaving):
                stage = f"{{name: opened, excavate: {_named(on_mesh, state.leaving)}, release: "
                stage += f"{_parts(on_mesh, state.leaving, '0.5')}}}"
                notes.append(
                    f"{what}, which excavates the ground at it, so it carries what this "
                    "releases as if it had stood before the excavation. If it follows the face, "
                    f"release a part first, by a stage '{stage}', and 'release: "
                    f"{_parts(on_mesh, state.leaving, '1')}' where it is built"
                )
    return notes


def lining_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Supports that stand before their tunnel is there, though its stress is released in parts.

    A stage builds first and releases then. What is built in the stage that excavates the tunnel, or
    after one whose face is still ahead of the section, would take all of the stress.
    """
    case, sequence, faults = on_mesh.case, on_mesh.sequence, []
    for n, state in enumerate(sequence.states[1:], start=1):
        before = sequence.states[state.base]
        opened = frozenset(g for g in state.leaving if _in_parts(state.release.get(g)))
        coming = frozenset(g for g, part in before.release.items() if _ahead(part))
        if not opened and not coming:
            continue
        keys: list[tuple[KeyPath, str, frozenset[int]]] = []
        for k, name in enumerate(case.stages[n - 1].build):
            if name in state.stressed:
                continue  # the jack gives its force
            keys += [(("build", k), name, g) for g in (opened, coming) if _lines(on_mesh, name, g)]
        for group in case.stages[n - 1].install:
            index = sequence.groups.index(group)
            keys += [(("install", group), group, g) for g in (opened, coming) if index in g]
        for path, name, groups in keys:
            if groups == opened:
                why = f"stage '{state.name}' excavates the ground at '{name}' and builds it, so "
                why += "that it would stand before anything is released and carry all of it"
            else:
                why = f"'{name}' would stand from the distance to the face at stage "
                why += f"'{before.name}' on, {_distance(before.release[min(coming)])}: before the "
                why += "face has passed"
            build = f"build: [{name}]"
            if path[0] == "install":
                build = f"install: {{{name}: {case.stages[n - 1].install[name]}}}"
            place, hint = ("stages", n - 1, *path), _later(state, build, on_mesh, groups)
            faults.append(case.source.fault(place, "lining-too-early", why, hint))
    return faults


def _later(
    state: ConstructionState, build: str, on_mesh: CaseOnMesh, groups: frozenset[int]
) -> str:
    """The line by which a structure is built after its tunnel is open."""
    part = state.release[min(groups)]
    if isinstance(part, FaceDistance):
        away = part.distance
        written = f"${away.parameter}" if away.parameter else f"{away.factor:.6g} m"
        line = f"{{name: lined, distance: {written}, {build}}}"
        return f"Build it after this stage, by '{line}': it then takes what is released from there."
    line = f"{{name: lined, {build}, release: {_parts(on_mesh, groups, '1')}}}"
    return f"Build it where the rest is released, after this stage: '{line}'."


def _lines(on_mesh: CaseOnMesh, name: str, groups: frozenset[int]) -> bool:
    """Whether a structure is on the wall of what groups of elements fill: all of it, or heads."""
    mesh, beam = on_mesh.mesh, on_mesh.case.structures[name]
    if not groups or isinstance(beam, Piles):
        return False
    if isinstance(beam, OpeningSupport) or not mesh.blocks:
        return True  # of the one opening of a case without mesh
    elements = np.isin(on_mesh.sequence.group_of, list(groups))
    if isinstance(beam, Bars):
        return any(on_mesh.locator.best(head, elements) is not None for head, _ in beam.ends)
    within = nodes_in(mesh.blocks, elements)
    return bool(np.isin(group_nodes(mesh, beam.group), and_inner(mesh, within)).all())


def _in_parts(release: Release | None) -> bool:
    """Whether a stage says that not all of a stress is released yet."""
    return release is not None and release != Scalar(1.0)


def _ahead(release: Release) -> bool:
    """Whether the face has yet to come, by a distance that is no parameter."""
    if not isinstance(release, FaceDistance) or release.distance.parameter is not None:
        return False
    return release.distance.factor < 0.0


def _distance(release: Release) -> str:
    """Where a section is by its distance to the face."""
    assert isinstance(release, FaceDistance)
    away = release.distance
    if away.parameter is not None:
        return f"${away.parameter}"
    return f"{abs(away.factor):.4g} m {'ahead of' if away.factor < 0.0 else 'behind'} it"


def _named(on_mesh: CaseOnMesh, groups: frozenset[int]) -> str:
    return f"[{', '.join(on_mesh.sequence.groups[g] for g in sorted(groups))}]"


def _parts(on_mesh: CaseOnMesh, groups: frozenset[int], part: str) -> str:
    """A part of the stress of groups as a case gives it."""
    return f"{{{', '.join(f'{on_mesh.sequence.groups[g]}: {part}' for g in sorted(groups))}}}"


def structure_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Structures on groups that the mesh does not have."""
    mesh, faults = on_mesh.mesh, []
    known = {**mesh.facet_groups, **mesh.node_groups, **mesh.groups}
    for name, beam in on_mesh.case.structures.items():
        if isinstance(beam, Shell):
            faults += _shell_faults(on_mesh, name, beam)
        if not isinstance(beam, Beam):
            continue
        uses: list[tuple[KeyPath, str, str, Mapping[str, object]]] = [
            (("on",), f"group '{beam.group}' of lines", beam.group, mesh.facet_groups)
        ]
        clamped = enumerate(beam.clamped_on)
        uses += [(("clamped_on", n), f"group '{g}'", g, known) for n, g in clamped]
        hinges = [(n, hinge) for n, hinge in enumerate(beam.hinges) if isinstance(hinge, str)]
        uses += [(("hinges", n), f"group '{g}'", g, known) for n, g in hinges]
        faults += [
            on_mesh.missing_group(("structures", name, *path), what, "groups", groups)
            for path, what, group, groups in uses
            if group not in groups
        ]
        if all(group in groups for _, _, group, groups in uses):
            faults += _hinge_faults(on_mesh, name, beam)
            faults += _axis_faults(on_mesh, name, beam)
        faults += _weight_faults(on_mesh.case, name, beam)
    return faults


def _hinge_faults(on_mesh: CaseOnMesh, name: str, beam: Beam) -> list[Fault]:
    """Hinges that lie at no node of their beam."""
    mesh, faults = on_mesh.mesh, []
    nodes = np.unique(straight_pieces(mesh, beam.group))
    for n, hinge in enumerate(beam.hinges):
        if len(hinge_nodes(mesh, beam, hinge)):
            continue
        if isinstance(hinge, str):
            message = f"no node of the group '{hinge}' lies on the beam '{name}'"
        else:
            nearest = nodes[np.linalg.norm(mesh.points[nodes] - hinge, axis=1).argmin()]
            message = (
                f"the hinge {format_point(hinge)} is at no node of the beam '{name}'; its nearest "
                f"node is {format_point(mesh.points[nearest])}"
            )
        faults.append(
            on_mesh.case.source.fault(
                ("structures", name, "hinges", n),
                "no-hinge-there",
                message,
                "a hinge stands at a node of the beam, where two of its pieces meet",
            )
        )
    return faults


def _axis_faults(on_mesh: CaseOnMesh, name: str, beam: Beam) -> list[Fault]:
    """Shells of revolution with pieces on the axis itself."""
    mesh = on_mesh.mesh
    on_axis = on_mesh.kinematics.on_axis(mesh.points)
    pieces = straight_pieces(mesh, beam.group)
    count = int(np.count_nonzero(on_axis[pieces].all(axis=1)))
    if not count:
        return []
    return [
        on_mesh.case.source.fault(
            ("structures", name, "on"),
            "on-the-axis",
            f"{count} pieces of the beam '{name}' lie on the axis x = 0, where a shell of "
            "revolution has no radius",
            "let the group end at the axis",
        )
    ]


_ALONG = np.cos(np.radians(5.0))
"""Of the angle between an axis and the normal of a face, below which it has no direction there."""


def _shell_faults(on_mesh: CaseOnMesh, name: str, shell: Shell) -> list[Fault]:
    """Shells on groups that the mesh lacks, planes of symmetry and axes that do not serve."""
    mesh, source = on_mesh.mesh, on_mesh.case.source
    known = {**mesh.facet_groups, **mesh.node_groups, **mesh.groups}
    uses: list[tuple[KeyPath, str, str, Mapping[str, object]]] = [
        (("on",), f"group '{shell.group}' of faces", shell.group, mesh.facet_groups)
    ]
    for key, named in (("clamped_on", shell.clamped_on), ("mirrored_on", shell.mirrored_on)):
        uses += [((key, n), f"group '{g}'", g, known) for n, g in enumerate(named)]
    faults = [
        on_mesh.missing_group(("structures", name, *path), what, "groups", groups)
        for path, what, group, groups in uses
        if group not in groups
    ]
    if faults:
        return faults

    def fault(code: str, message: str, hint: str, *path: str | int) -> Fault:
        return source.fault(("structures", name, *path), code, message, hint)

    own = group_nodes(mesh, shell.group)
    for n, group in enumerate(shell.mirrored_on):
        nodes = np.intersect1d(own, group_nodes(mesh, group))
        if mirror_axis(mesh, shell, group) is None or len(nodes) == len(own):
            why = "do not lie on a plane at right angles to x, y or z" if len(nodes) else "are none"
            why = "are all of its nodes" if len(nodes) == len(own) else why
            message = f"the nodes of the shell '{name}' on the group '{group}' {why}"
            hint = "name the faces or nodes of one plane of symmetry that crosses the shell"
            faults.append(fault("no-symmetry-there", message, hint, "mirrored_on", n))
    faces = mesh.facet_groups[shell.group]
    x = mesh.points[flat_triangles(mesh, faces, np.zeros(len(faces), dtype=bool)).nodes]
    normal = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    along = np.abs(normal @ np.array(shell.axis)) / np.linalg.norm(shell.axis)
    across = np.flatnonzero(along > _ALONG * np.linalg.norm(normal, axis=1))
    if len(across):
        place = format_point(x[across[0]].mean(axis=0))
        message = f"the axis of the shell '{name}' is at right angles to {len(across)} of its "
        message += f"faces, the first near {place}: it has no direction along them"
        hint = "take a direction along all faces, or make two shells of the group"
        faults.append(fault("axis-across", message, hint, "axis"))
    return faults + _weight_faults(on_mesh.case, name, shell)


def _weight_faults(case: Case, name: str, beam: Beam | Shell) -> list[Fault]:
    """Beams and shells with a weight where nothing weighs."""
    if not beam.has_weight or (case.gravity is not None and any(case.gravity)):
        return []
    key = "weight" if beam.density is None else "density"
    what = "shell" if isinstance(beam, Shell) else "beam"
    return [
        case.source.fault(
            ("structures", name, key),
            "no-gravity",
            f"the {what} '{name}' has a weight, but there is no gravity",
            f"Add 'gravity: 9.81 m/s2', or leave out '{key}'.",
        )
    ]


def structure_place_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Structures whose nodes or ends lie in no ground at some stage at which they stand."""
    case, sequence = on_mesh.case, on_mesh.sequence
    faults = _symmetry_faults(on_mesh)
    for name, structure in case.structures.items():
        for n, state in enumerate(sequence.states):
            if name not in state.structures:
                continue
            missing = _missing(on_mesh, structure, sequence.present(n))
            if missing is not None:
                path, where = missing
                message = (
                    f"at stage '{state.name}' the structure '{name}' stands, but {where} in no "
                )
                faults.append(_no_ground(case, name, path, f"{message}ground that is present"))
                break
        else:
            present = present_throughout(sequence, name)
            if present is not None and isinstance(structure, Bars):
                missing = _missing(on_mesh, structure, present)
                if missing is not None:
                    path, where = missing
                    stands = [s.name for s in sequence.states if name in s.structures]
                    message = f"{where} in no ground that is present at all stages at which the "
                    message += f"structure '{name}' stands: {', '.join(stands)}"
                    faults.append(_no_ground(case, name, path, message))
    return faults


def _missing(
    on_mesh: CaseOnMesh, structure: Structure, present: Bools
) -> tuple[KeyPath, str] | None:
    """Where a structure lacks ground: the key, and what lies where."""
    mesh = on_mesh.mesh
    if isinstance(structure, Bars):
        for n, pair in enumerate(structure.ends):
            for k, held in enumerate(held_points(structure, pair)):
                for what, point in held:
                    if on_mesh.locator.best(point, present) is None:
                        return ("ends", n, k), f"{what} {format_point(point)} lies"
        return None
    assert isinstance(structure, Beam | Shell)
    there = and_inner(mesh, nodes_in(mesh.blocks, present))
    lost = np.setdiff1d(group_nodes(mesh, structure.group), there)
    if len(lost) == 0:
        return None
    return ("on",), f"{len(lost)} nodes, the first near {format_point(mesh.points[lost[0]])}, lie"


def _symmetry_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Struts that should end on a plane of symmetry and do not."""
    case, mesh = on_mesh.case, on_mesh.mesh
    fixed = fixed_dofs(on_mesh).reshape(-1, mesh.dim)
    return [
        case.source.fault(
            ("structures", name, "ends", n, *(() if inclined else (1,))),
            "no-symmetry-there",
            f"the strut '{name}' ends on a plane of symmetry, but {why}",
            hint,
        )
        for name, strut in case.structures.items()
        if isinstance(strut, Struts) and strut.second_end == "symmetry"
        for n, pair in enumerate(strut.ends)
        for why, hint, inclined in _off_symmetry(mesh, fixed, *pair)
    ]


def _off_symmetry(
    mesh: Mesh, fixed: Bools, first: tuple[float, ...], second: tuple[float, ...]
) -> Iterator[tuple[str, str, bool]]:
    """Why the second end of a strut is on no plane of symmetry, the remedy, whether it leans.

    Such a plane is one at which the mesh ends, with all its nodes there held across it.
    """
    along = np.subtract(second, first)
    axis = int(np.argmax(np.abs(along)))
    size = float(np.ptp(mesh.points, axis=0).max())
    name, place = "xyz"[axis], second[axis]
    if np.delete(np.abs(along), axis).max() > ON_PLANE * float(np.linalg.norm(along)):
        why = f"it runs from {format_point(first)} to {format_point(second)}, inclined to the axes"
        yield why, "such a plane crosses the strut at right angles", True
        return
    across = mesh.points[:, axis]
    on_plane = np.abs(across - place) <= ON_PLANE * size
    held = np.count_nonzero(fixed[on_plane, axis])
    low, high = float(across.min()), float(across.max())
    hint = (
        "correct the coordinates, hold the plane by 'supports', or write 'second_end: fixed' for "
        "an end that does not move"
    )
    if not on_plane.any():
        yield f"the mesh has no nodes at {name} = {place:.6g} m", hint, False
    elif held < np.count_nonzero(on_plane):
        count = np.count_nonzero(on_plane)
        yield (
            f"{count - held} of the {count} nodes at {name} = {place:.6g} m are not held along "
            f"{name}",
            hint,
            False,
        )
    elif min(place - low, high - place) > ON_PLANE * size:
        yield (
            f"the mesh continues on both sides of {name} = {place:.6g} m, from {low:.6g} to "
            f"{high:.6g} m",
            hint,
            False,
        )


def _no_ground(case: Case, name: str, path: KeyPath, message: str) -> Fault:
    hint = "correct the place, or 'dismantle' the structure before its ground is gone"
    if isinstance(case.structures[name], GroutedBars):
        hint += "; of bars that lose a part of their ground make two structures, of the part that "
        hint += "goes and of the part that stays"
    return case.source.fault(("structures", name, *path), "no-ground-there", message, hint)

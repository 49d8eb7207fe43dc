"""A case on its mesh: who is present when, of what (theory 2), and the ground as strain points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from dataclasses import fields as dataclass_fields
from functools import cached_property

import numpy as np

from geoident.errors import Fault
from geoident.fem.faces import FaceTable, FacetPatch, face_table, patches
from geoident.fem.interfaces import JointFaces
from geoident.fem.kinematics import (
    Kinematics,
    StrainPoints,
    block_geometry,
    kinematics_of,
    strain_points,
)
from geoident.fem.location import Locator
from geoident.forward.of_mesh import OfMesh
from geoident.model.actions import FaceDistance, Load, Release, Temperature, Water
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import VIRGIN, Case, KeyPath, Stage, Support
from geoident.model.cells import CELLS
from geoident.model.ground import Elastic, PointField, PointGrowth, with_constants
from geoident.model.heat import HeatFace
from geoident.model.hydraulic import Drained
from geoident.model.mesh import Mesh
from geoident.model.parameter import Scalar
from geoident.model.structures import Bars

_SHOWN = 5  # numbers in a message: enough to find the place

Index = Ints | slice
"""Places in an array: their numbers, or a slice where they are one run (no copies)."""


@dataclass(frozen=True)
class ConstructionState:
    """A state of construction, at the end of a stage.

    Args:
        name: of the stage.
        materials: group index to material name, for the present groups.
        placed: group indices that enter free of stress at this stage.
        loads: what acts, by name.
        base: index of the state on which this one builds; of the virgin state, 0.
        water: in the pores, or None for none.
        temperature: group index to change of temperature.
        leaving: group indices that leave at this stage.
        release: group index to the part of its stress that is released so far, or the distance to
            the face that says it, if one was given.
        structures: names of the structures that stand.
        built: names of those that are built at this stage, free of stress.
        loads_since: index of the state from which on each of the loads acts.
        stressed: structure to the force of one bar, N, for those whose force is given at this
            stage: a jack or a press holds it while the ground moves.
        locked: structure to the force at which its bars were locked off at an earlier stage.
        supports: what is held, by name.
        held_since: index of the state from which on each of the supports holds or moves so.
        relaxed: group indices that lose at this stage the stress that they have had since the
            virgin state, or since their placing.
        lasts: how long the stage lasts, s; None: as long as all that takes time needs.
        over: the time in which what it does comes evenly, s; 0: at its beginning.
        at: when in it this state is, s since its beginning; None: at its end.
        goes_on: a later moment of the same stage as the state before.
        drained: group of faces at which water leaves.
        heat: group of faces or nodes to the heat that flows there.
        heat_since: index of the state from which on each of them does so.
        placed_at: group index to its temperature, degC, for those placed at this stage.
    """

    name: str
    materials: Mapping[int, str]
    placed: frozenset[int]
    loads: Mapping[str, Load]
    base: int = 0
    water: Water | None = None
    temperature: Mapping[int, Temperature] = field(default_factory=dict)
    leaving: frozenset[int] = frozenset()
    release: Mapping[int, Release] = field(default_factory=dict)
    structures: frozenset[str] = frozenset()
    built: frozenset[str] = frozenset()
    loads_since: Mapping[str, int] = field(default_factory=dict)
    stressed: Mapping[str, Scalar] = field(default_factory=dict)
    locked: Mapping[str, Scalar] = field(default_factory=dict)
    supports: Mapping[str, Support] = field(default_factory=dict)
    held_since: Mapping[str, int] = field(default_factory=dict)
    relaxed: frozenset[int] = frozenset()
    lasts: float | None = None
    over: float = 0.0
    at: float | None = None
    goes_on: bool = False
    drained: Mapping[str, Drained] = field(default_factory=dict)
    heat: Mapping[str, HeatFace] = field(default_factory=dict)
    heat_since: Mapping[str, int] = field(default_factory=dict)
    placed_at: Mapping[int, Scalar] = field(default_factory=dict)

    @property
    def held(self) -> frozenset[tuple[str, tuple[int, ...]]]:
        """Which supports hold in which directions, however they move."""
        return frozenset((name, one.components) for name, one in self.supports.items())


@dataclass(frozen=True)
class ConstructionSequence:
    """All states of a case, the virgin state first.

    Args:
        groups: names of the groups that the case uses; a group index counts in them.
        group_of: (n_elements,) group index of every element.
        states: one per stage.
    """

    groups: tuple[str, ...]
    group_of: Ints
    states: tuple[ConstructionState, ...]

    def present(self, state: int) -> Bools:
        """(n_elements,) which elements are present at a state."""
        present = np.zeros(len(self.groups), dtype=bool)
        present[list(self.states[state].materials)] = True
        return present[self.group_of]

    def placed_since(self, state: int) -> frozenset[int]:
        """Group indices that were placed at a state or in its history."""
        placed: set[int] = set()
        while state:
            placed |= self.states[state].placed
            state = self.states[state].base
        return frozenset(placed)

    def elements(self, group: int) -> Ints:
        """Element indices (k,) of a group."""
        return np.flatnonzero(self.group_of == group)

    @cached_property
    def materials(self) -> tuple[str, ...]:
        """Names of the materials of which some ground is made at some state, in that order."""
        return tuple(dict.fromkeys(m for state in self.states for m in state.materials.values()))

    @cached_property
    def bases(self) -> Ints:
        """(n_states,) the state on which each builds; the virgin state on itself."""
        return np.array([state.base for state in self.states], dtype=np.int64)

    @cached_property
    def built_on(self) -> Bools:
        """(n_states, n_states) [i, j]: state i is part of the history of state j, or is j.

        The virgin state is part of every history, but no motion belongs to it.
        """
        result = np.eye(len(self.states), dtype=bool)
        for n, state in enumerate(self.states[1:], start=1):
            result[:, n] |= result[:, state.base]
        return result


_table_of = OfMesh[FaceTable]()


class Discretization:
    """Strain points of a mesh, made once.

    Args:
        mesh: the mesh, every element turned so that its volume is positive.
        kinematics: of the analysis.
        sequence: the groups of the case.

    Attributes:
        kinematics: of the analysis.
        geometries: shape functions and gradients of every block.
        points: the strain points.
        points_of: index of a group to its strain points, for groups that are ever present.
    """

    def __init__(self, mesh: Mesh, kinematics: Kinematics, sequence: ConstructionSequence) -> None:
        self.kinematics = kinematics
        self.geometries = tuple(block_geometry(mesh.points, b, kinematics) for b in mesh.blocks)
        self.points: StrainPoints = strain_points(mesh, self.geometries, kinematics)
        group_of_point = sequence.group_of[self.points.element]
        ever = sorted({g for state in sequence.states for g in state.materials})
        self.points_of: dict[int, Index] = {g: as_index(group_of_point == g) for g in ever}

    @property
    def n_dofs(self) -> int:
        """Number of degrees of freedom, free and fixed."""
        return self.points.n_dofs

    def volume(self, present: Bools) -> Floats:
        """V (n_points,), zero at points of elements (n_elements,) that are absent."""
        return np.where(present[self.points.element], self.points.volume, 0.0)


def as_index(mask: Bools) -> Index:
    """A slice where the marked places (m,) are one run (no copies), else their numbers."""
    where = np.flatnonzero(mask)
    if len(where) and where[-1] - where[0] + 1 == len(where):
        return slice(int(where[0]), int(where[-1]) + 1)
    return where


def numbers(index: Index, n: int) -> Ints:
    """A slice of n, or an array (k,) of numbers, as numbers (k,)."""
    return np.arange(n)[index] if isinstance(index, slice) else index


@dataclass(frozen=True)
class CaseOnMesh:
    """A case on its mesh; what follows from both is made once, when it is first asked for.

    Args:
        case: the case.
        mesh: its mesh, every element turned so that its volume is positive (see `oriented`); one
            without elements where the case has none.
        fields: constants of its materials that vary from strain point to strain point.
        turned: numbers (k,) of the elements that were turned.
        growths: constants of its materials that grow with depth or stress.
        joints: group of faces along which the mesh is split to these faces.
        before: the same before the split; None where nothing is split.
        original: (n_nodes,) which node of before each node is.
        given: the mesh that was given, before shells, bars and interfaces have nodes of their own;
            None: this one.
    """

    case: Case
    mesh: Mesh
    fields: tuple[PointField, ...] = ()
    turned: Ints = field(default_factory=lambda: np.empty(0, np.int64))
    growths: tuple[PointGrowth, ...] = ()
    joints: Mapping[str, tuple[JointFaces, ...]] = field(default_factory=dict)
    before: CaseOnMesh | None = None
    original: Ints | None = None
    given: Mesh | None = None

    @property
    def unsplit(self) -> CaseOnMesh:
        """The case on its mesh as the file has it."""
        return self.before or self

    @cached_property
    def kinematics(self) -> Kinematics:
        """Of the analysis; with the mean dilatation where ground yields.

        Elastic ground, which it would cost more, does not need it: its answers stay what they are.
        """
        kinematics = kinematics_of(self.case.analysis)
        yields = any(not material.is_elastic for material in self.case.materials.values())
        averaged = yields and any(
            CELLS[block.kind].order == 1 and len(kinematics.quadrature(block.kind)[1]) > 1
            for block in self.mesh.blocks
        )
        return kinematics.with_mean_dilatation() if averaged else kinematics

    @cached_property
    def table(self) -> FaceTable:
        """The faces of the mesh; the two sides of an interface are one face."""
        if self.before is not None:
            table = self.before.table
            return replace(table, keys=replace(table.keys, original=self.original))
        return _table_of(self.mesh, None, lambda: face_table(self.mesh))

    @cached_property
    def outline(self) -> tuple[FacetPatch, ...]:
        """The outer faces of the whole mesh."""
        return patches(self.mesh, self.table, self.table.free(np.ones(self.mesh.n_elements, bool)))

    @cached_property
    def locator(self) -> Locator:
        """Finds elements by points."""
        return Locator(self.mesh)

    @cached_property
    def sequence(self) -> ConstructionSequence:
        """The states of construction on the groups of the mesh."""
        groups = tuple(used_groups(self.case))
        group_of = np.full(self.mesh.n_elements, -1, dtype=np.int64)
        for n, name in enumerate(groups):
            group_of[self.mesh.groups.get(name, [])] = n
        return ConstructionSequence(groups, group_of, _states_of(self.case, groups))

    @cached_property
    def discretization(self) -> Discretization:
        """Its strain points."""
        return Discretization(self.mesh, self.kinematics, self.sequence)

    def material_points(self, material: str) -> Ints:
        """Strain points (q,), ascending, of the groups that are made of a material at any state."""
        if material not in self._material_points:
            states = self.sequence.states
            groups = {g for state in states for g, m in state.materials.items() if m == material}
            element = self.discretization.points.element
            of_material = np.isin(self.sequence.group_of[element], sorted(groups))
            self._material_points[material] = np.flatnonzero(of_material)
        return self._material_points[material]

    @cached_property
    def _material_points(self) -> dict[str, Ints]:
        return {}

    def not_in(self, material: str, point: tuple[float, ...]) -> str | None:
        """What is at a point (dim,) that is never in ground of a material; None where it is."""
        sites = self.locator.sites(self.kinematics.in_section(point)[0])
        if not sites:
            return self.not_in_mesh()
        states, group_of = self.sequence.states, self.sequence.group_of
        groups = {g for state in states for g, m in state.materials.items() if m == material}
        if any(int(group_of[site.element]) in groups for site in sites):
            return None
        return f"lies in the group {self.sequence.groups[group_of[sites[0].element]]!r}"

    def not_in_mesh(self) -> str:
        """Of a point that no element holds, a clause."""
        return f"is not in the mesh {self.mesh.file}"

    def elastic_fields(self, material: str) -> tuple[PointField, ...]:
        """Elastic constants of a material that are fields."""
        return tuple(f for f in self.fields if f.material == material and f.surface is None)

    def elastic_growths(self, material: str) -> tuple[PointGrowth, ...]:
        """Elastic constants of a material that grow with depth or stress."""
        return tuple(g for g in self._growths(material) if g.growth.surface is None)

    def strength_growths(self, material: str) -> tuple[PointGrowth, ...]:
        """Strengths of a material that grow with depth or stress."""
        return tuple(g for g in self._growths(material) if g.growth.surface is not None)

    def _growths(self, material: str) -> tuple[PointGrowth, ...]:
        return tuple(g for g in self.growths if g.growth.material == material)

    def elastic(self, material: str) -> Elastic:
        """The elasticity of a material; of constants that grow, at their typical numbers."""
        typical = {g.growth.constant: Scalar(g.typical) for g in self.elastic_growths(material)}
        elastic = self.case.materials[material].elastic
        return with_constants(elastic, typical) if typical else elastic

    def strength_fields(self, material: str) -> tuple[PointField, ...]:
        """Strengths of a material that are fields."""
        return tuple(f for f in self.fields if f.material == material and f.surface is not None)

    def with_fields(
        self, case: Case, fields: tuple[PointField, ...], growths: tuple[PointGrowth, ...] = ()
    ) -> CaseOnMesh:
        """The same with fields, and with the case that has their modes among its parameters.

        Nothing that was made before depends on either, so it is kept.

        Args:
            case: with the modes.
            fields: at the strain points.
            growths: constants that grow, at the strain points.
        """
        changed = replace(self, case=case, fields=fields, growths=growths)
        names = {entry.name for entry in dataclass_fields(self)}
        changed.__dict__.update({k: v for k, v in self.__dict__.items() if k not in names})
        return changed

    @cached_property
    def boundaries(self) -> Mapping[str, tuple[FacetPatch, ...]]:
        """Material to the boundary of all ground that is made of it in the virgin state."""
        if not self.mesh.blocks:
            return {}
        made_of: dict[str, list[int]] = {}
        for group, material in self.sequence.states[0].materials.items():
            made_of.setdefault(material, []).append(group)
        elements_of = {m: np.isin(self.sequence.group_of, groups) for m, groups in made_of.items()}
        table = self.table
        return {
            m: patches(self.mesh, table, table.free(elements))
            for m, elements in elements_of.items()
        }

    def missing_group(
        self, path: KeyPath, what: str, among: str, groups: Mapping[str, object]
    ) -> Fault:
        """The case names a group that the mesh does not have.

        Args:
            path: where it names it.
            what: the group, with its kind.
            among: what the groups are that would do.
            groups: these, by name.
        """
        message = f"the mesh {self.mesh.file} has no {what}"
        hint = f"its {among}: {listed(groups)}"
        return self.case.source.fault(path, "missing-group", message, hint)


def used_groups(case: Case) -> dict[str, KeyPath]:
    """Every element group that the case names, with the key that names it first."""
    used: dict[str, KeyPath] = {name: ("groups", name) for name in case.groups}
    for n, stage in enumerate(case.stages):
        for k, name in enumerate(stage.excavate):
            used.setdefault(name, ("stages", n, "excavate", k))
        for key, names in (
            ("install", stage.install), ("change", stage.change), ("temperature", stage.temperature)
        ):  # fmt: skip
            for name in names:
                used.setdefault(name, ("stages", n, key, name))
    return used


def _states_of(case: Case, groups: Sequence[str]) -> tuple[ConstructionState, ...]:
    """The states of a case, the virgin state first; groups are counted as they are given."""
    index = {name: n for n, name in enumerate(groups)}
    supports = {support.group: support for support in case.supports}
    virgin = ConstructionState(
        name=VIRGIN,
        materials={index[g]: m for g, m in case.groups.items() if m is not None},
        placed=frozenset(),
        loads=dict(case.loads),
        water=case.water,
        loads_since=dict.fromkeys(case.loads, 0),
        supports=supports,
        held_since=dict.fromkeys(supports, 0),
        drained=case.drained,
        heat=case.heat,
        heat_since=dict.fromkeys(case.heat, 0),
    )
    states = [virgin]
    trunk = 0
    for n, stage in enumerate(case.stages, start=1):
        base = trunk if stage.base is None else case.stage_names.index(stage.base)
        states.append(_state_after(states[base], base, stage, n, index, case))
        trunk = trunk if stage.independent else n
    return tuple(states)


def _state_after(
    before: ConstructionState,
    base: int,
    stage: Stage,
    number: int,
    index: Mapping[str, int],
    case: Case,
) -> ConstructionState:
    """The state of a number, at the end of a stage that builds on another."""
    gone = {index[g] for g in stage.excavate}
    placed = frozenset(index[g] for g in stage.install)
    materials = {g: m for g, m in before.materials.items() if g not in gone}
    materials |= {index[g]: m for g, m in {**stage.install, **stage.change}.items()}
    leaving = frozenset(gone & before.materials.keys())
    # A group that leaves again with nothing said of its release is released whole.
    release = {g: part for g, part in before.release.items() if g not in leaving}
    release |= {index[g]: part for g, part in released_by(stage, case).items()}
    stays = {g: t for g, t in before.temperature.items() if g in materials and g not in placed}
    warmed = {index[g]: t for g, t in stage.temperature.items()}

    loads = {k: v for k, v in before.loads.items() if k not in stage.remove} | dict(stage.loads)
    loads_since = {k: n for k, n in before.loads_since.items() if k in loads}
    loads_since |= dict.fromkeys(stage.loads, number)
    held = {name: one for name, one in stage.supports.items() if one is not None}
    supports = {name: one for name, one in before.supports.items() if name not in stage.supports}
    held_since = {name: before.held_since[name] for name in supports} | dict.fromkeys(held, number)

    drained = {k: v for k, v in before.drained.items() if k not in stage.drained}
    drained |= {name: one for name, one in stage.drained.items() if one is not None}

    heated = {name: one for name, one in stage.heat.items() if one is not None}
    heat = {name: one for name, one in before.heat.items() if name not in stage.heat}
    heat_since = {name: before.heat_since[name] for name in heat} | dict.fromkeys(heated, number)

    built = frozenset(stage.build)
    structures = (before.structures - set(stage.dismantle)) | built
    bars = ((name, case.structures[name]) for name in stage.build)
    stressed = {k: v.prestress for k, v in bars if isinstance(v, Bars) and v.prestress is not None}
    stressed |= dict(stage.prestress) | (dict(before.stressed) if stage.goes_on else {})
    kept = structures - built - stressed.keys()
    return ConstructionState(
        name=stage.name,
        materials=materials,
        placed=placed,
        loads=loads,
        base=base,
        water=stage.water or before.water,
        temperature=stays | warmed,
        leaving=leaving,
        release=release,
        structures=structures,
        built=built,
        loads_since=loads_since,
        stressed=stressed,
        locked={k: v for k, v in {**before.locked, **before.stressed}.items() if k in kept},
        supports=supports | held,
        held_since=held_since,
        relaxed=frozenset(index[g] for g in stage.relaxed),
        lasts=stage.lasts,
        over=stage.over,
        at=stage.at,
        goes_on=stage.goes_on,
        drained=drained,
        heat=heat | heated,
        heat_since=heat_since,
        placed_at={index[g]: scalar for g, scalar in stage.placed_at.items() if g in index},
    )


def released_by(stage: Stage, case: Case) -> dict[str, Release]:
    """Group to what a stage says of its release, by its own words or by the distance to the face.

    Args:
        stage: the stage.
        case: of which it is.
    """
    released: dict[str, Release] = {}
    if stage.distance is not None and case.face is not None:
        released |= dict.fromkeys(case.face.groups, FaceDistance(stage.distance))
    return released | dict(stage.release)


def group_faults(on_mesh: CaseOnMesh) -> list[Fault]:
    """Groups that the mesh lacks, elements in none or in two of the case's groups."""
    case, mesh = on_mesh.case, on_mesh.mesh
    used = used_groups(case)
    faults = [
        _no_elements(on_mesh, name, path) for name, path in used.items() if name not in mesh.groups
    ]
    if faults:
        return faults
    count = np.zeros(mesh.n_elements, dtype=np.int64)
    for name in used:
        count[mesh.groups[name]] += 1
    for wrong, state, hint in (
        (count == 0, "in none of the groups of the case", "list their group under 'groups'"),
        (count > 1, "in several groups of the case", "give every element to one group"),
    ):
        if not wrong.any():
            continue
        elements = np.flatnonzero(wrong)
        named = [g for g, e in mesh.groups.items() if np.isin(e, elements).any()]
        where = f" (in the mesh they are in: {', '.join(sorted(named))})" if named else ""
        message = f"{len(elements)} elements of {mesh.file} are {state}{where}; first: "
        message += ", ".join(str(element_number(mesh, e)) for e in elements[:_SHOWN])
        absent = "; a group that is never present is written 'NAME: absent'"
        faults.append(case.source.fault(("groups",), "group-coverage", message, hint + absent))
    return faults


def _no_elements(on_mesh: CaseOnMesh, name: str, path: KeyPath) -> Fault:
    """A name of ground that the mesh lacks, or gives to edges, surfaces or nodes."""
    mesh = on_mesh.mesh
    among = "element groups"
    fault = on_mesh.missing_group(path, f"element group '{name}'", among, mesh.groups)
    if name in mesh.facet_groups:
        what = "edges" if mesh.dim == 2 else "surfaces"
        use = "supports, loads and structures can be on it"
        if mesh.dim == 2:
            beam = f"{{kind: beam, on: {name}, E: 15 GPa, nu: 0.2, thickness: 0.2 m}}"
            use += f"; a lining there is a beam, 'structures: {{{name}: {beam}}}', and a stage "
            use += f"builds it, 'build: [{name}]'"
    elif name in mesh.node_groups:
        what, use = "nodes", "supports and forces can be on it"
    else:
        return fault
    return replace(fault, hint=f"'{name}' is a group of {what} of the mesh: {use}; {fault.hint}")


def listed(names: Mapping[str, object]) -> str:
    """Names for a message, or ``none``."""
    return ", ".join(sorted(names)) or "none"


def element_number(mesh: Mesh, element: int) -> int:
    """The number under which the user knows an element.

    Raises:
        IndexError: there is no such element.
    """
    for block in mesh.blocks:
        if element < len(block):
            return int(block.numbers[element])
        element -= len(block)
    msg = "no such element"
    raise IndexError(msg)

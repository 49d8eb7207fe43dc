"""Who is present when, and of what (theory 2): the stages of a case on the groups of a mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from geoident.errors import Fault
from geoident.model.actions import Load, Temperature, Water
from geoident.model.arrays import Bools, Ints
from geoident.model.case import VIRGIN, Case, KeyPath, Stage
from geoident.model.mesh import Mesh
from geoident.model.parameter import Scalar
from geoident.model.structures import Bars, Structure

_SHOWN = 5


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
        release: group index to the part of its stress that is released so far, if one was given.
        structures: names of the structures that stand.
        built: names of those that are built at this stage, free of stress.
        loads_since: index of the state from which on each of the loads acts.
        stressed: structure to the force of one bar, N, for those whose force is given at this
            stage: a jack or a press holds it while the ground moves.
        locked: structure to the force at which its bars were locked off at an earlier stage.
    """

    name: str
    materials: Mapping[int, str]
    placed: frozenset[int]
    loads: Mapping[str, Load]
    base: int = 0
    water: Water | None = None
    temperature: Mapping[int, Temperature] = field(default_factory=dict)
    leaving: frozenset[int] = frozenset()
    release: Mapping[int, Scalar] = field(default_factory=dict)
    structures: frozenset[str] = frozenset()
    built: frozenset[str] = frozenset()
    loads_since: Mapping[str, int] = field(default_factory=dict)
    stressed: Mapping[str, Scalar] = field(default_factory=dict)
    locked: Mapping[str, Scalar] = field(default_factory=dict)


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
        here = np.zeros(len(self.groups), dtype=bool)
        here[list(self.states[state].materials)] = True
        return here[self.group_of]

    def elements(self, group: int) -> Ints:
        """Element indices (k,) of a group."""
        return np.flatnonzero(self.group_of == group)

    @cached_property
    def materials(self) -> tuple[str, ...]:
        """Names of the materials of which some ground is made at some state, in that order."""
        return tuple(dict.fromkeys(m for state in self.states for m in state.materials.values()))

    @cached_property
    def built_on(self) -> Bools:
        """(n_states, n_states) [i, j]: state i is part of the history of state j, or is j.

        The virgin state is part of every history, but no motion belongs to it.
        """
        result = np.eye(len(self.states), dtype=bool)
        for n, state in enumerate(self.states[1:], start=1):
            result[:, n] |= result[:, state.base]
        return result


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


def construction_sequence(case: Case, mesh: Mesh) -> ConstructionSequence:
    """The sequence of a case whose groups are all in the mesh (see `group_faults`)."""
    groups = tuple(used_groups(case))
    group_of = np.full(mesh.n_elements, -1, dtype=np.int64)
    for n, name in enumerate(groups):
        group_of[mesh.groups[name]] = n
    return ConstructionSequence(groups, group_of, states_of(case, groups))


def states_of(case: Case, groups: Sequence[str]) -> tuple[ConstructionState, ...]:
    """The states of a case, the virgin state first; groups are counted as they are given."""
    index = {name: n for n, name in enumerate(groups)}
    materials = {index[g]: m for g, m in case.groups.items() if m is not None}
    since = dict.fromkeys(case.loads, 0)
    virgin = ConstructionState(
        VIRGIN, materials, frozenset(), dict(case.loads), water=case.water, loads_since=since
    )
    states = [virgin]
    trunk = 0
    for n, stage in enumerate(case.stages, start=1):
        base = trunk if stage.base is None else case.stage_names.index(stage.base)
        states.append(_state_after(states[base], base, stage, n, index, case.structures))
        trunk = trunk if stage.independent else n
    return tuple(states)


def _state_after(
    before: ConstructionState,
    base: int,
    stage: Stage,
    number: int,
    index: Mapping[str, int],
    known: Mapping[str, Structure],
) -> ConstructionState:
    """The state of a number, at the end of a stage that builds on another."""
    gone = {index[g] for g in stage.excavate}
    placed = frozenset(index[g] for g in stage.install)
    materials = {g: m for g, m in before.materials.items() if g not in gone}
    materials |= {index[g]: m for g, m in {**stage.install, **stage.change}.items()}
    loads = {k: v for k, v in before.loads.items() if k not in stage.remove} | dict(stage.loads)
    since = {k: n for k, n in before.loads_since.items() if k in loads}
    since |= dict.fromkeys(stage.loads, number)
    stays = {g: t for g, t in before.temperature.items() if g in materials and g not in placed}
    warmed = {index[g]: t for g, t in stage.temperature.items()}
    leaving = frozenset(gone & before.materials.keys())
    # A group that leaves again with nothing said of its release is released whole.
    release = {g: part for g, part in before.release.items() if g not in leaving}
    release |= {index[g]: part for g, part in stage.release.items()}
    structures = (before.structures - set(stage.dismantle)) | set(stage.build)
    stressed = _stressed_at_building(stage, known) | dict(stage.prestress)
    kept = structures - set(stage.build) - stressed.keys()
    locked = {k: v for k, v in {**before.locked, **before.stressed}.items() if k in kept}
    return ConstructionState(
        stage.name, materials, placed, loads, base, stage.water or before.water, stays | warmed,
        leaving, release, structures, frozenset(stage.build), since, stressed, locked,
    )  # fmt: skip


def _stressed_at_building(stage: Stage, known: Mapping[str, Structure]) -> dict[str, Scalar]:
    """Structures that a stage builds with a force of their own."""
    bars = ((name, known[name]) for name in stage.build)
    return {k: v.prestress for k, v in bars if isinstance(v, Bars) and v.prestress is not None}


def group_faults(case: Case, mesh: Mesh) -> list[Fault]:
    """Groups that the mesh lacks, elements in none or in two of the case's groups."""
    used = used_groups(case)
    faults = [
        case.source.fault(
            path,
            code="missing-group",
            message=f"the mesh {mesh.file} has no element group '{name}'",
            hint=f"its element groups: {listed(mesh.groups)}",
        )
        for name, path in used.items()
        if name not in mesh.groups
    ]
    count = np.zeros(mesh.n_elements, dtype=np.int64)
    for name in used.keys() & mesh.groups.keys():
        count[mesh.groups[name]] += 1
    if not faults:
        faults += _coverage_faults(case, mesh, count)
    return faults


def listed(names: Mapping[str, object]) -> str:
    """Names for a message, or ``none``."""
    return ", ".join(sorted(names)) or "none"


def _coverage_faults(case: Case, mesh: Mesh, count: Ints) -> list[Fault]:
    faults = []
    for wrong, found, hint in (
        (count == 0, "in none of the groups of the case", "list their group under 'groups'"),
        (count > 1, "in several groups of the case", "give every element to one group"),
    ):
        if np.any(wrong):
            elements = np.flatnonzero(wrong)
            named = [g for g, e in mesh.groups.items() if np.isin(e, elements).any()]
            where = f" (in the mesh they are in: {', '.join(sorted(named))})" if named else ""
            message = f"{len(elements)} elements of {mesh.file} are {found}{where}; first: "
            message += ", ".join(str(element_number(mesh, e)) for e in elements[:_SHOWN])
            absent = "; a group that is never present is written 'NAME: absent'"
            faults.append(
                case.source.fault(
                    ("groups",), code="group-coverage", message=message, hint=hint + absent
                )
            )
    return faults


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

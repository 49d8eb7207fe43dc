"""Construction of a case: the section of a stage, and whether the stages can follow each other.

What needs no mesh is checked here; the rest is seen by the forward model.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Annotated

from pydantic import AfterValidator, Field

from geoident.io.case.actions import LoadSection, TemperatureSection, WaterSection
from geoident.io.case.durations import BY_DATES, DurationOrDates, require_no_negative
from geoident.io.case.ground import MaterialSection
from geoident.io.case.heat import StageHeatValue, build_heat
from geoident.io.case.hydraulic import StageDrainedValue, build_drained
from geoident.io.case.structures import (
    UNSTRESSED_PILE,
    AnchorSection,
    BeamSection,
    BoltSection,
    OpeningSupportSection,
    PileSection,
    StructureSection,
    StrutSection,
    beyond_capacity,
    negative_force,
    unstressed,
)
from geoident.io.case.supports.section import FREE, StageSupportValue, build_supports
from geoident.io.schema.section import Context, Section, SectionFaults, optional
from geoident.io.schema.values import (
    CaseNumber,
    CelsiusTemperature,
    Coefficient,
    FixedTime,
    Flag,
    Force,
    Length,
    Name,
    SharesUnit,
)
from geoident.io.text.faults import Faults
from geoident.io.text.wording import Refusal
from geoident.model.case import VIRGIN, KeyPath, Stage

ABSENT = "absent"

Moment = Annotated[FixedTime, AfterValidator(require_no_negative)]


def _not_reserved(value: str) -> str:
    if value == VIRGIN:
        message = f"'{VIRGIN}' is the name of the state before the first stage"
        raise Refusal("reserved-name", message, "Give the stage another name.")
    return value


class StageSection(Section):
    """One step of construction: all that it says happens together, before the readings."""

    name: Annotated[Name, AfterValidator(_not_reserved)] = Field(
        description="Unique name, to which readings refer."
    )
    excavate: list[Name] = Field([], description="Element groups that are excavated.")
    install: dict[Name, Name] = Field(
        {},
        description="Element group to material: enters free of stress (lift, lining, backfill); "
        "a group that is present is replaced.",
    )
    change: dict[Name, Name] = Field(
        {}, description="Element group to material: the material changes, the stress stays."
    )
    release: dict[Name, Coefficient] = Field(
        {},
        description="Element group to the part of its stress, 0 to 1, released up to this stage: "
        "of a group that this stage excavates, or that an earlier one excavated with part of it. "
        "The rest supports the ground until a later stage releases more "
        "(convergence-confinement).",
        examples=[{"heading": 0.4}],
    )
    distance: Length | None = optional(
        "How far the section is behind the tunnel face at the end of the stage "
        "(negative: ahead of it), which releases the stress of the tunnel as `face` says.",
        examples=["2.5 m"],
    )
    loads: dict[Name, LoadSection] = Field(
        {}, description="Loads by name, from this stage on; a name used again replaces."
    )
    remove: list[Name] = Field([], description="Names of loads that end with this stage.")
    build: list[Name] = Field(
        [],
        description="Names of `structures` that are built, at the beginning of the stage. They "
        "begin free of stress (bars with their prestress), and carry part of what this stage and "
        "later ones excavate and release.",
        examples=[["lining"]],
    )
    dismantle: list[Name] = Field(
        [],
        description="Names of structures that are removed; the ground takes over the forces that "
        "they carried.",
    )
    prestress: dict[Name, Force] = Field(
        {},
        description="Structure (bolts, struts, anchors) to the force to which each of its bars is "
        "stressed, jacked or let down at this stage; it holds during the stage whatever moves, and "
        "is locked off at its end. Overrides the `prestress` with which the stage builds it.",
        examples=[{"anchors": "350 kN"}],
    )
    water: WaterSection | None = optional(
        "Water in the pores from this stage on; as before if missing."
    )
    drained: dict[Name, StageDrainedValue] = Field(
        {},
        description="Faces at which water leaves from this stage on, as in the `drained` of the "
        "case, and 'closed' for those at which it no longer does.",
        examples=[{"drain": {"head": "2 m"}}, {"top": "closed"}],
    )
    heat: dict[Name, StageHeatValue] = Field(
        {},
        description="Faces and nodes that have a temperature or exchange heat from this stage on, "
        "as in the `heat` of the case, and 'adiabatic' for those that no longer do.",
        examples=[{"pipes": {"temperature": "-30 degC"}}, {"top 1": "adiabatic"}],
    )
    placed_at: dict[Name, CelsiusTemperature] = Field(
        {},
        description="Element group that the stage installs to its temperature then, at which it is "
        "free of stress; the `initial_temperature` of the case if missing.",
        examples=[{"lift 1": "18 degC"}],
    )
    temperature: dict[Name, TemperatureSection] = Field(
        {},
        description="Element group to change of temperature since the initial state (or since it "
        "was installed), from this stage on; needs the `expansion` of its material.",
        examples=[{"dam": "-8 K"}],
    )
    supports: dict[Name, StageSupportValue] = Field(
        {},
        description="Supports from this stage on: other motions, counted on from where the support "
        "began; new ones, which begin where the ground is then; and 'free' for one that lets go.",
        examples=[{"wall": {"contraction": "1.5 %"}}, {"outer": "free"}],
    )
    independent: Flag = Field(
        False,
        description="A load case on its own: it builds on the last stage before it that is not "
        "independent (or on `base`), and nothing builds on it that does not name it. Gauges read "
        "the motion since their zero all the same.",
    )
    base: Name | None = optional("Earlier stage, or 'virgin', on which this one builds.")
    lasts: Annotated[CaseNumber, DurationOrDates()] | None = optional(
        "How long the stage lasts, from the end of the stage on which it builds; "
        f"`{BY_DATES}` for what `dates` say; as long as all that takes time needs if missing (all "
        "water has drained, all creep has ended). 0 d for a stage in which no time passes.",
        examples=["12 d", BY_DATES],
    )
    moments: Annotated[list[Moment], SharesUnit()] | None = optional(
        "Times since the beginning of a stage that lasts for which it is computed, "
        "beside those of its readings and its end; about ten, ever farther apart, if missing. 0 d "
        "is the beginning, when all that the stage does is done and no time has passed.",
        examples=[["1 d", "3 d", "10 d"]],
    )
    over: FixedTime | None = optional(
        "Of a stage that lasts: the time, from its beginning on, in which all that it "
        "does comes evenly (a fill that is placed in three days); at once if missing.",
        examples=["3 d"],
    )

    def check(self, faults: SectionFaults) -> None:
        """Moments, and what comes evenly, lie within the stage."""
        lasts = None if self.lasts is None else self.lasts.factor  # a NaN follows from dates
        for n, time in enumerate(self.moments or ()):
            if lasts is not None and time.factor > lasts:
                message = f"'{time.text}' is later than the end of the stage, which lasts "
                message += f"'{self.lasts.text}'" if self.lasts else ""
                faults.add(("moments", n), "after-stage", message, "Correct one of them.")
        if self.over is None:
            return
        if lasts is None or self.over.factor < 0.0 or self.over.factor > lasts:
            message = f"'{self.over.text}' is longer than the stage lasts, or negative"
            if lasts is None:
                message = "what the stage does comes in a time, and the stage has no duration"
            faults.add(("over",), "out-of-range", message, "Give 'lasts', at least as long.")
        if self.temperature:
            message = "a temperature changes at the beginning of a stage"
            hint = "Remove 'over', or change the temperature in a stage of its own."
            faults.add(("over",), "contradiction", message, hint)

    def for_model(self, context: Context) -> Stage:
        """The stage for the model; what cannot be is noted as a fault."""
        supports = build_supports(self.supports, context.at("supports"))
        drained = build_drained(self.drained, context.at("drained"))
        heat = build_heat(self.heat, context.at("heat"))
        return self.to_model(Stage, context, supports=supports, drained=drained, heat=heat)


@dataclass(frozen=True)
class Begin:
    """The case before its first stage, and what its stages can refer to.

    Args:
        groups: element group to material, or `ABSENT`.
        materials: name to section.
        loads: names of the loads that act from the beginning.
        structures: all structures by name.
        supports: names of the supports that hold from the beginning.
        by_distance: groups whose stress is released by the distance to the face.
    """

    groups: Mapping[str, str]
    materials: Mapping[str, MaterialSection]
    loads: Collection[str]
    structures: Mapping[str, StructureSection]
    supports: Collection[str] = ()
    by_distance: Collection[str] = ()


def check_sequence(begin: Begin, stages: Sequence[StageSection], faults: Faults) -> None:
    """Note what a stage takes away, replaces, warms or ends that is not there then.

    Args:
        begin: what there is before the first stage.
        stages: in their order.
        faults: where to note.
    """
    trunk = _Ground(begin, stages, faults)
    reached = {VIRGIN: trunk}
    for number, stage in enumerate(stages):
        path: KeyPath = ("stages", number)
        if stage.base is not None and stage.base not in reached:
            earlier = [VIRGIN, *(one.name for one in stages[:number])]
            hint = faults.did_you_mean(stage.base, earlier, what="Stages before it")
            later = any(one.name == stage.base for one in stages[number:])
            what = "is not before this stage" if later else "is no stage"
            faults.add((*path, "base"), "unknown-stage", f"'{stage.base}' {what}", hint)
        ground = reached.get(stage.base or "", trunk).copy()
        ground.build(path, stage)
        reached[stage.name] = ground
        trunk = trunk if stage.independent else ground
    settled = frozenset[KeyPath]().union(*(ground.settled for ground in reached.values()))
    refilled = {path: part for ground in reached.values() for path, part in ground.refilled.items()}
    for path in sorted(refilled.keys() - settled, key=str):
        group = path[-1]
        message = f"'{group}' is filled again, and only {refilled[path].text} of the stress that "
        message += "it had is released: the rest would go on acting beside the new ground"
        hint = f"Release it to 1, 'release: {{{group}: 1}}', in this stage or an earlier one; of a "
        hint += "lining that takes its share of the rest, in this stage or a later one."
        faults.add(path, "still-held", message, hint, key=True)


class _Ground:
    """What stands after the stages so far.

    ``excavated`` has, for each group that was taken away, the stage at which it was. ``partly``
    has, for each that left with part of its stress, what is released of it; None: as far as the
    distance to the face says. ``refilled`` has places where such groups are filled again, with
    what was released then; ``settled`` those of them after which the rest is released.
    """

    def __init__(self, begin: Begin, stages: Sequence[StageSection], faults: Faults) -> None:
        self.begin = begin
        self.faults = faults
        self.present = {g: m for g, m in begin.groups.items() if m != ABSENT}
        self.installed: dict[str, str] = {}
        self.loads = set(begin.loads)
        self.excavated: dict[str, str] = {}
        self.partly: dict[str, CaseNumber | None] = {}
        self.refilled: dict[KeyPath, CaseNumber] = {}
        self.settled: set[KeyPath] = set()
        self.structures: set[str] = set()
        self.supports = set(begin.supports)
        self.known = set(begin.groups)
        self.known.update(group for stage in stages for group in stage.install)

    def copy(self) -> _Ground:
        """The same, to go on from here in another way."""
        other = copy(self)
        for name, value in vars(self).items():
            if isinstance(value, dict | set):
                setattr(other, name, value.copy())
        return other

    def build(self, path: KeyPath, stage: StageSection) -> None:
        """Go through one stage."""
        self._excavate(path, stage)
        self._release(path, stage)
        self._install(path, stage)
        self._change(path, stage)
        self._load(path, stage)
        self._warm(path, stage)
        self._support(path, stage)
        self._hold(path, stage)

    def _hold(self, path: KeyPath, stage: StageSection) -> None:
        """Supports that let go, and those that begin to hold."""
        for name, given in stage.supports.items():
            if given != FREE:
                self.supports.add(name)
            elif name not in self.supports:
                hint = self.faults.did_you_mean(
                    name, sorted(self.supports), what="Supports at this stage"
                )
                message = f"no support '{name}' holds at this stage that could let go"
                self.faults.add((*path, "supports", name), "no-such-support", message, hint)
            self.supports -= {name} if given == FREE else set()

    def _warm(self, path: KeyPath, stage: StageSection) -> None:
        for group in stage.temperature:
            place = (*path, "temperature", group)
            if group not in self.present:
                self._refuse_absent(place, group, "heated or cooled", key=True)
                continue
            material = self.begin.materials.get(self.present[group])
            if material is not None and material.expansion is None:
                message = f"'{group}' is made of '{self.present[group]}', which has no expansion"
                hint = "Add 'expansion: 1e-5 1/K' to the material."
                self.faults.add(place, "no-expansion", message, hint, key=True)

    def _excavate(self, path: KeyPath, stage: StageSection) -> None:
        for n, group in enumerate(stage.excavate):
            if group not in self.present:
                self._refuse_absent((*path, "excavate", n), group, "excavated", key=False)
            else:
                del self.present[group]
                self.installed.pop(group, None)
            self.excavated[group] = stage.name

    def _release(self, path: KeyPath, stage: StageSection) -> None:
        """Groups that leave with part of their stress, or release more of it later."""
        away = set() if stage.distance is None else set(self.begin.by_distance)
        for group in stage.excavate:
            self.partly.pop(group, None)
            self.refilled = {k: part for k, part in self.refilled.items() if k[-1] != group}
        for group in sorted(away - stage.release.keys()):
            if group not in stage.excavate and group not in self.partly and group in self.known:
                message = f"no stress of '{group}' is held that could be released by the distance"
                hint = "Give 'distance' from the stage on that excavates the group."
                self.faults.add((*path, "distance"), "nothing-held", message, hint, key=True)
            self.partly[group] = None
        for group, part in stage.release.items():
            place = (*path, "release", group)
            before = None if part.parameter else self.partly.get(group)
            if group not in stage.excavate and group not in self.partly:
                message = f"no stress of '{group}' is held that could be released"
                hint = "Give 'release' from the stage on that excavates the group."
                self.faults.add(place, "nothing-held", message, hint, key=True)
            elif part.parameter is None and not 0 <= part.factor <= 1:
                message = f"'{part.text}' is not between 0 (nothing released) and 1 (all of it)"
                self.faults.add(place, "out-of-range", message, "Give a part, such as 0.4.")
            elif before and not before.parameter and part.factor < before.factor:
                message = f"{part.text} of the stress of '{group}' would be released, and "
                message += f"{before.text} of it is already"
                hint = "Parts count from the excavation on and only grow: write at least "
                self.faults.add(place, "out-of-range", message, f"{hint}{before.text}.")
            self.partly[group] = part
            if part.parameter or part.factor == 1.0:
                self.settled |= {place for place in self.refilled if place[-1] == group}

    def _install(self, path: KeyPath, stage: StageSection) -> None:
        for group, material in stage.install.items():
            part = self.partly.get(group)
            ends = part is None or (group in stage.release if part.parameter else part.factor >= 1)
            if part is not None and not ends:
                self.refilled[(*path, "install", group)] = part
            if self.installed.get(group) == material:
                message = f"'{group}' is already made of '{material}' by an earlier stage"
                hint = "Excavate it first if it is to be replaced, or remove this entry."
                self.faults.add(
                    (*path, "install", group), "installed-twice", message, hint, key=True
                )
            self.present[group] = self.installed[group] = material
            self.excavated.pop(group, None)

    def _change(self, path: KeyPath, stage: StageSection) -> None:
        for group, material in stage.change.items():
            place = (*path, "change", group)
            if group in stage.install:
                message = f"'{group}' is installed and changed in one stage"
                hint = "Install the material that it has at the end of the stage."
                self.faults.add(place, "contradiction", message, hint, key=True)
            elif group not in self.present:
                self._refuse_absent(place, group, "changed", key=True)
            else:
                self.present[group] = material
                self.installed.pop(group, None)

    def _load(self, path: KeyPath, stage: StageSection) -> None:
        for n, name in enumerate(stage.remove):
            place = (*path, "remove", n)
            if name not in self.loads:
                hint = self.faults.did_you_mean(
                    name, sorted(self.loads), what="Loads at this stage"
                )
                self.faults.add(place, "no-such-load", f"no load '{name}' acts at this stage", hint)
            elif name in stage.loads:
                message = f"the load '{name}' begins and ends in one stage"
                hint = "A load of the same name replaces it; remove is not needed."
                self.faults.add(place, "contradiction", message, hint)
            self.loads.discard(name)
        self.loads.update(stage.loads)

    def _support(self, path: KeyPath, stage: StageSection) -> None:
        """Structures that leave, and those that are built."""
        for n, name in enumerate(stage.dismantle):
            place = (*path, "dismantle", n)
            if name not in self.structures:
                hint = self.faults.did_you_mean(
                    name, sorted(self.structures), what="Structures at this stage"
                )
                message = f"no structure '{name}' exists at this stage"
                self.faults.add(place, "no-such-structure", message, hint)
            self.structures.discard(name)
        for n, name in enumerate(stage.build):
            place = (*path, "build", n)
            if name not in self.begin.structures:
                self.faults.add_unknown(place, "structure", name, self.begin.structures)
            elif name in self.structures:
                message = f"the structure '{name}' is already built"
                hint = "To replace it, list it under 'dismantle' too."
                self.faults.add(place, "built-twice", message, hint)
            self.structures.add(name)

        for name, force in stage.prestress.items():
            self._stress(path, stage, name, force)

    def _stress(self, path: KeyPath, stage: StageSection, name: str, force: CaseNumber) -> None:
        """Bars whose force a stage gives."""
        place = (*path, "prestress", name)
        section = self.begin.structures.get(name)
        if section is None:
            self.faults.add_unknown(place, "structure", name, self.begin.structures, key=True)
        elif isinstance(section, BeamSection | OpeningSupportSection):
            what = "a beam" if isinstance(section, BeamSection) else f"of kind '{section.kind}'"
            message = f"'{name}' is {what}, which is not prestressed"
            hint = "Name bolts, struts or anchors."
            self.faults.add(place, "wrong-structure", message, hint, key=True)
        elif name not in self.structures:
            message = f"'{name}' cannot be stressed at stage '{stage.name}': it does not stand then"
            hint = f"Build it first: add 'build: [{name}]' to this stage or to one before it."
            if name in stage.dismantle:
                hint = "Leave out the prestress, or dismantle the structure at a later stage."
            self.faults.add(place, "no-such-structure", message, hint, key=True)
        fault = negative_force(force)
        if isinstance(section, PileSection):
            self.faults.add(place, "wrong-structure", *UNSTRESSED_PILE, key=True)
        elif isinstance(section, BoltSection) and (refusal := unstressed(section)):
            self.faults.add(place, "wrong-structure", *refusal, key=True)
        elif fault is None and isinstance(section, BoltSection | StrutSection | AnchorSection):
            fault = beyond_capacity(force, section.capacity)
        if fault:
            self.faults.add(place, "out-of-range", *fault)

    def _refuse_absent(self, place: KeyPath, group: str, what: str, *, key: bool) -> None:
        if group not in self.known:
            refuse_group(place, group, self.known, self.faults, key=key)
            return
        since = f", since '{self.excavated[group]}' excavated it" if group in self.excavated else ""
        message = f"'{group}' cannot be {what}: it is not present at this stage{since}"
        self.faults.add(place, "absent-group", message, "Check the order of the stages.", key=key)


def refuse_group(
    place: KeyPath, group: str, known: Collection[str], faults: Faults, *, key: bool
) -> None:
    """Note a group that the case does not have, though its mesh may.

    Args:
        place: where it is named.
        group: its name.
        known: the groups of the case.
        faults: where to note.
        key: it is named by a key.
    """
    message = f"no group '{group}' is in 'groups' or installed by a stage"
    hint = faults.did_you_mean(group, sorted(known), what="Groups")
    if not hint.startswith("Did"):
        hint += f" If the mesh has it, add '{group}: MATERIAL' to 'groups', or '{group}: absent' "
        hint += "for ground that a stage installs."
    faults.add(place, "unknown-group", message, hint, key=key)

"""Whether the stages of a case can follow each other, as far as no mesh is needed to see it."""

from __future__ import annotations

from copy import copy

from geoident.io.case.schema import CaseSection, StageSection
from geoident.io.text.faults import Faults
from geoident.model.case import VIRGIN, KeyPath

ABSENT = "absent"


def check_sequence(section: CaseSection, faults: Faults) -> None:
    """Note what a stage takes away, replaces, warms or ends that is not there then."""
    trunk = _Site(section, faults)
    sites = {VIRGIN: trunk}
    for number, stage in enumerate(section.stages):
        path: KeyPath = ("stages", number)
        if stage.base is not None and stage.base not in sites:
            _refuse_base((*path, "base"), stage.base, section, number, faults)
        site = sites.get(stage.base or "", trunk).copy()
        site.build(path, stage)
        sites[stage.name] = site
        trunk = trunk if stage.independent else site


def _refuse_base(
    path: KeyPath, base: str, section: CaseSection, number: int, faults: Faults
) -> None:
    earlier = [stage.name for stage in section.stages[:number]]
    hint = faults.did_you_mean(base, [VIRGIN, *earlier], what="Stages before it")
    later = base in {stage.name for stage in section.stages[number:]}
    what = "is not before this stage" if later else "is no stage"
    faults.add(path, "unknown-stage", f"'{base}' {what}", hint)


class _Site:
    """What stands after the stages so far.

    ``left`` tells for each group that was taken away at which stage.
    """

    def __init__(self, section: CaseSection, faults: Faults) -> None:
        self.section = section
        self.faults = faults
        self.present = {g: m for g, m in section.groups.items() if m != ABSENT}
        self.installed: dict[str, str] = {}
        self.loads = set(section.loads)
        self.left: dict[str, str] = {}
        self.partly: set[str] = set()
        self.structures: set[str] = set()
        self.known = set(section.groups)
        self.known.update(group for stage in section.stages for group in stage.install)

    def copy(self) -> _Site:
        """The same, to go on from here in another way."""
        other = copy(self)
        other.present, other.installed = dict(self.present), dict(self.installed)
        other.loads, other.left = set(self.loads), dict(self.left)
        other.partly, other.structures = set(self.partly), set(self.structures)
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

    def _warm(self, path: KeyPath, stage: StageSection) -> None:
        for group in stage.temperature:
            place = (*path, "temperature", group)
            if group not in self.present:
                self._refuse_absent(place, group, "warmed", key=True)
                continue
            material = self.section.materials.get(self.present[group])
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
            self.left[group] = stage.name

    def _release(self, path: KeyPath, stage: StageSection) -> None:
        """Groups that leave with part of their stress, or release more of it later."""
        self.partly -= set(stage.excavate) - stage.release.keys()
        for group, part in stage.release.items():
            place = (*path, "release", group)
            if group not in stage.excavate and group not in self.partly:
                message = f"nothing of '{group}' is held that could be released"
                hint = "Release is told from the stage on that excavates the group."
                self.faults.add(place, "nothing-held", message, hint, key=True)
            elif part.parameter is None and not 0 <= part.factor <= 1:
                message = f"'{part.text}' is not between 0 (nothing released) and 1 (all of it)"
                self.faults.add(place, "out-of-range", message, "Give a part, such as 0.4.")
            self.partly.add(group)

    def _install(self, path: KeyPath, stage: StageSection) -> None:
        for group, material in stage.install.items():
            if self.installed.get(group) == material:
                message = f"'{group}' is already made of '{material}' by an earlier stage"
                hint = "Excavate it first if it is to be replaced, or remove this entry."
                self.faults.add(
                    (*path, "install", group), "installed-twice", message, hint, key=True
                )
            self.present[group] = self.installed[group] = material
            self.left.pop(group, None)

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
                    name, sorted(self.loads), what="Loads that act then"
                )
                self.faults.add(place, "no-such-load", f"no load '{name}' acts then", hint)
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
                    name, sorted(self.structures), what="Structures that stand then"
                )
                message = f"no structure '{name}' stands then"
                self.faults.add(place, "no-such-structure", message, hint)
            self.structures.discard(name)
        for n, name in enumerate(stage.build):
            place = (*path, "build", n)
            if name not in self.section.structures:
                hint = self.faults.did_you_mean(name, self.section.structures, what="Structures")
                self.faults.add(place, "unknown-structure", f"there is no structure '{name}'", hint)
            elif name in self.structures:
                message = f"the structure '{name}' stands already"
                hint = "To replace it, list it under 'dismantle' too."
                self.faults.add(place, "built-twice", message, hint)
            self.structures.add(name)

    def _refuse_absent(self, place: KeyPath, group: str, what: str, *, key: bool) -> None:
        if group not in self.known:
            message = f"no group '{group}' is in 'groups' or installed by a stage"
            hint = self.faults.did_you_mean(group, sorted(self.known), what="Groups")
            self.faults.add(place, "unknown-group", message, hint, key=key)
            return
        since = f": it was excavated in '{self.left[group]}'" if group in self.left else ""
        message = f"'{group}' cannot be {what}, it is not present then{since}"
        self.faults.add(place, "absent-group", message, "Check the order of the stages.", key=key)

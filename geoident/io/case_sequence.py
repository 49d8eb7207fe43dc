"""Whether the stages of a case can follow each other, as far as no mesh is needed to see it."""

from __future__ import annotations

from geoident.io.case_schema import CaseSection, StageSection
from geoident.io.faults import Faults
from geoident.model.case import KeyPath

ABSENT = "absent"


def check_sequence(section: CaseSection, faults: Faults) -> None:
    """Note what a stage takes away, replaces or ends that is not there then."""
    site = _Site(section, faults)
    for number, stage in enumerate(section.stages):
        site.build(("stages", number), stage)


class _Site:
    """What stands after the stages so far.

    ``left`` tells for each group that was taken away at which stage.
    """

    def __init__(self, section: CaseSection, faults: Faults) -> None:
        self.faults = faults
        self.present = {g: m for g, m in section.groups.items() if m != ABSENT}
        self.installed: dict[str, str] = {}
        self.loads = set(section.loads)
        self.left: dict[str, str] = {}
        self.known = set(section.groups)
        self.known.update(group for stage in section.stages for group in stage.install)

    def build(self, path: KeyPath, stage: StageSection) -> None:
        """Go through one stage."""
        self._excavate(path, stage)
        self._install(path, stage)
        self._change(path, stage)
        self._load(path, stage)

    def _excavate(self, path: KeyPath, stage: StageSection) -> None:
        for n, group in enumerate(stage.excavate):
            if group not in self.present:
                self._refuse_absent((*path, "excavate", n), group, "excavated", key=False)
            else:
                del self.present[group]
                self.installed.pop(group, None)
            self.left[group] = stage.name

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

    def _refuse_absent(self, place: KeyPath, group: str, what: str, *, key: bool) -> None:
        if group not in self.known:
            message = f"no group '{group}' is in 'groups' or installed by a stage"
            hint = self.faults.did_you_mean(group, sorted(self.known), what="Groups")
            self.faults.add(place, "unknown-group", message, hint, key=key)
            return
        since = f": it was excavated in '{self.left[group]}'" if group in self.left else ""
        message = f"'{group}' cannot be {what}, it is not present then{since}"
        self.faults.add(place, "absent-group", message, "Check the order of the stages.", key=key)

"""What does not fit between the heat of a case in stages and the rest of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Protocol

from geoident.io.case.ground import MaterialSection
from geoident.io.case.heat import HeatSection
from geoident.io.case.in_service.structure import ServiceSection
from geoident.io.case.parameters import ParameterSection
from geoident.io.case.stages import StageSection
from geoident.io.schema.section import SectionFaults
from geoident.io.schema.values import CaseNumber
from geoident.model.case import KeyPath


class HeatKeys(Protocol):
    """The keys of a case that heat depends on."""

    service: ServiceSection | None
    initial_temperature: CaseNumber | None
    heat: dict[str, HeatSection]
    materials: dict[str, MaterialSection]
    parameters: dict[str, ParameterSection]
    groups: dict[str, str]
    stages: list[StageSection]


_CONDUCTS = "Add conductivity: 2.5 W/mK and heat_capacity: 2.2 MJ/m3K."


def check_heat(section: HeatKeys, faults: SectionFaults) -> None:
    """Heat in stages: all ground conducts it, and every stage has a duration.

    Args:
        section: a case with ground.
        faults: takes what is wrong.
    """
    if section.service is not None or section.initial_temperature is None:
        _refuse(section, faults)
        return
    used = dict.fromkeys(section.groups.values())
    for stage in section.stages:
        used |= dict.fromkeys([*stage.install.values(), *stage.change.values()])
    for name in used:
        if name in section.materials:
            _check_material(name, section.materials[name], section.parameters, faults)
    for n, stage in enumerate(section.stages):
        if stage.lasts is None:
            message = "heat takes time, and the stage does not say how long it lasts"
            hint = f"Add 'lasts: 12 d' to stage '{stage.name}'; 'lasts: 0 d' if no time passes."
            faults.add(("stages", n), "no-duration", message, hint)
        for group in stage.temperature:
            message = f"the temperature of '{group}' is computed: the case conducts heat"
            hint = "Give it on faces ('heat'), or remove 'initial_temperature'."
            faults.add(("stages", n, "temperature", group), "contradiction", message, hint)
        for group in stage.placed_at:
            if group not in stage.install:
                message = f"'{group}' is not installed by this stage"
                hint = "Name a group of its 'install', or remove it."
                faults.add(("stages", n, "placed_at", group), "not-placed", message, hint)


def _refuse(section: HeatKeys, faults: SectionFaults) -> None:
    """Keys of heat in stages, where they would change nothing."""
    served = section.service is not None
    message = "no heat is conducted: the case does not say with which temperature it begins"
    hint = "Add 'initial_temperature: 10 degC' to the case."
    if served:
        message = "a structure in service takes its temperatures from 'loads'"
        hint = "Remove it."
    for path in _keys_of_heat(section):
        faults.add(path, "unused-key" if served else "no-temperature", message, hint)


def _keys_of_heat(section: HeatKeys) -> Iterator[KeyPath]:
    for key in ("initial_temperature", "heat"):
        if getattr(section, key):
            yield (key,)
    for n, stage in enumerate(section.stages):
        for key in ("heat", "placed_at"):
            if getattr(stage, key):
                yield "stages", n, key


def _check_material(
    name: str,
    material: MaterialSection,
    parameters: Mapping[str, ParameterSection],
    faults: SectionFaults,
) -> None:
    path: KeyPath = ("materials", name)
    both = material.heat_capacity is not None and material.specific_heat is not None
    neither = material.heat_capacity is None and material.specific_heat is None
    if material.conductivity is None or neither:
        missing = "conductivity" if material.conductivity is None else "heat capacity"
        message = f"heat is conducted, and '{name}' has no {missing}"
        faults.add(path, "missing-key", message, _CONDUCTS)
    if both:
        message = f"'{name}' has 'heat_capacity' and 'specific_heat', which say the same"
        faults.add((*path, "specific_heat"), "twice", message, "Keep one of them.")
    elif material.specific_heat is not None and material.density is None:
        message = f"heat per mass of '{name}' needs its density"
        hint = "Add 'density', or write heat_capacity: 2.2 MJ/m3K."
        faults.add((*path, "specific_heat"), "missing-key", message, hint)
    for key in ("conductivity", "heat_capacity", "specific_heat"):
        given: CaseNumber | None = getattr(material, key)
        start = None if given is None else parameters.get(given.parameter or "")
        if given is not None and start is not None and given.factor * start.start.factor <= 0.0:
            message = f"the {key.replace('_', ' ')} of '{name}' is not positive at the start"
            hint = f"Change the start of '{given.parameter}'."
            faults.add((*path, key), "out-of-range", message, hint)

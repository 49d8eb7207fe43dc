"""What does not fit between the heat of a case in stages and the rest of it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from geoident.io.case.ground import MaterialSection
from geoident.io.case.heat import ADIABATIC
from geoident.io.case.parameters import ParameterSection
from geoident.io.case.stages import StageSection
from geoident.io.schema.section import SectionFaults
from geoident.io.schema.values import CaseNumber
from geoident.model.case import KeyPath


def check_heat(
    materials: Mapping[str, MaterialSection],
    parameters: Mapping[str, ParameterSection],
    groups: Mapping[str, str],
    heat: Collection[str],
    stages: Sequence[StageSection],
    faults: SectionFaults,
) -> None:
    """Heat in stages: all ground conducts it, and every stage has a duration.

    Args:
        materials: of the case, which has an initial temperature and no service.
        parameters: by name.
        groups: element group to material.
        heat: names of groups that heat flows through from the beginning.
        stages: in their order.
        faults: takes what is wrong, with paths from the case on.
    """
    used = dict.fromkeys(groups.values())
    for stage in stages:
        used |= dict.fromkeys([*stage.install.values(), *stage.change.values()])
    for name in used:
        if name in materials:
            _check_material(name, materials[name], parameters, faults)
    known = {*heat}
    for n, stage in enumerate(stages):
        for group, given in stage.heat.items():
            if given == ADIABATIC and group not in known:
                message = f"no heat flows at '{group}' before this stage that could end"
                hint = "Correct the name, or remove it: edges are adiabatic."
                faults.add(("stages", n, "heat", group), "no-heat", message, hint)
        known |= {*stage.heat}
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


def refuse_heat(
    keys: Mapping[str, object],
    stages: Sequence[StageSection],
    faults: SectionFaults,
    *,
    served: bool,
) -> None:
    """Keys of heat in stages, where they would change nothing.

    Args:
        keys: those of the case, by name; empty ones were not given.
        stages: in their order.
        faults: takes what is wrong, with paths from the case on.
        served: the case is of a structure in service; else it has no initial temperature.
    """
    message = "no heat is conducted: the case does not say with which temperature it begins"
    hint = "Add 'initial_temperature: 10 degC' to the case."
    if served:
        message, hint = "a structure in service takes its temperatures from 'loads'", "Remove it."
    paths: list[KeyPath] = [(key,) for key, given in keys.items() if given]
    paths += [
        ("stages", n, key)
        for n, stage in enumerate(stages)
        for key in ("heat", "placed_at")
        if getattr(stage, key)
    ]
    for path in paths:
        faults.add(path, "unused-key" if served else "no-temperature", message, hint)


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
        hint = "Add conductivity: 2.5 W/mK and heat_capacity: 2.2 MJ/m3K."
        faults.add(path, "missing-key", message, hint)
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

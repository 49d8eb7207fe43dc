"""What a hardening soil is not combined with, yet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from geoident.io.case.ground import MaterialSection
from geoident.io.case.stages import StageSection
from geoident.io.case.yielding.sections import HardeningSoilSection
from geoident.io.schema.section import SectionFaults
from geoident.model.case import KeyPath


def check_hardening(
    materials: Mapping[str, MaterialSection],
    stages: Sequence[StageSection],
    others: Mapping[str, object],
    faults: SectionFaults,
) -> None:
    """Ground that hardens by planes, faces and temperatures.

    Args:
        materials: of the case.
        stages: in their order.
        others: `face` and `initial_temperature` of the case, None where they are not given.
        faults: takes what is wrong, with paths from the case on.
    """
    soils = [n for n, one in materials.items() if any(map(_hardens, _surfaces(one)))]
    if not soils:
        return
    for name, material in materials.items():
        path: KeyPath = ("materials", name)
        surfaces = _surfaces(material)
        if any(map(_hardens, surfaces)) and len(surfaces) > 1:
            _refuse((*path, "yield"), "further yield surfaces", "yield", soils[0], faults)
        if any(getattr(one, "hardening", None) is not None for one in surfaces):
            what = "ground whose strength grows with its plastic strain"
            _refuse((*path, "yield"), what, "hardening", soils[0], faults)
        E = getattr(material, "E", None)
        if name in soils and E is not None and E.varied_by is not None:
            message = f"E of '{name}' varies from place to place, and its soil hardens"
            hint = "Give one number: the moduli of hardening soil grow with the stress by 'm'."
            faults.add((*path, "E"), "hardening", message, hint)
    for key, given in others.items():
        if given is not None:
            what = "a tunnel face" if key == "face" else "ground that conducts heat"
            _refuse((key,), what, key, soils[0], faults)
    for n, stage in enumerate(stages):
        if stage.temperature:
            what = "changes of temperature"
            _refuse(("stages", n, "temperature"), what, "temperature", soils[0], faults)


def _surfaces(material: MaterialSection) -> Sequence[object]:
    """All that is written under `yield`."""
    given = material.yields
    return given if isinstance(given, list) else [] if given is None else [given]


def _hardens(surface: object) -> bool:
    return isinstance(surface, HardeningSoilSection)


def _refuse(path: KeyPath, what: str, key: str, soil: str, faults: SectionFaults) -> None:
    message = f"hardening soil ('{soil}') cannot be combined with {what} in one case yet"
    hint = f"Remove '{key}', or describe '{soil}' by 'type: mohr-coulomb'."
    faults.add(path, "hardening", message, hint)

"""What does not fit between the creep of materials and the rest of a case."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from geoident.io.case.creep import CreepSection, sections_of_creep
from geoident.io.case.ground import MaterialSection
from geoident.io.case.stages import StageSection
from geoident.io.case.structures import StructureSection
from geoident.io.schema.section import SectionFaults
from geoident.model.case import KeyPath


def check_staged_creep(
    materials: Mapping[str, MaterialSection],
    groups: Mapping[str, str],
    stages: Sequence[StageSection],
    structures: Mapping[str, StructureSection],
    faults: SectionFaults,
) -> None:
    """Creep and ageing in stages: nothing yields, and stages last where they must.

    Args:
        materials: of the case, which has stages and no service.
        groups: element group to material.
        stages: in their order.
        structures: by name.
        faults: takes what is wrong, with paths from the case on.
    """
    yielding = [name for name, one in materials.items() if one.yields is not None]
    yielding += [name for name, one in structures.items() if getattr(one, "limits", None)]
    for name, material in materials.items():
        if material.softening is not None:
            message = "the case has stages; a modulus falls with time in service only"
            hint = "Change the material at a stage (change: {GROUP: MATERIAL}), or add 'service'."
            faults.add(("materials", name, "softening"), "no-time", message, hint)
        for key in ("creep", "ageing"):
            if getattr(material, key) is not None and yielding:
                _refuse_yield(("materials", name, key), yielding[0], faults)
    ageing = [name for name, one in structures.items() if getattr(one, "ageing", None)]
    for name in ageing if yielding else ():
        _refuse_yield(("structures", name, "ageing"), yielding[0], faults)
    there = set(groups.values())
    placed: set[str] = set()
    built: set[str] = set()
    for n, stage in enumerate(stages):
        built = (built - {*stage.dismantle}) | {*stage.build}
        placed |= {*stage.install.values(), *stage.change.values()}
        if stage.lasts is None:
            young = sorted(built.intersection(ageing))
            _require_end(n, stage, materials, there | placed, placed, young, faults)


def _refuse_yield(path: KeyPath, yielding: str, faults: SectionFaults) -> None:
    message = f"ground that creeps or ages is elastic, and '{yielding}' yields"
    hint = "Remove one of them: a case creeps and ages, or it yields."
    faults.add(path, "yields", message, hint)


def _require_end(
    number: int,
    stage: StageSection,
    materials: Mapping[str, MaterialSection],
    there: set[str],
    placed: set[str],
    young: Sequence[str],
    faults: SectionFaults,
) -> None:
    """In a stage that lasts as long as it takes, all creep has an end, and nothing is young."""
    reasons = [f"the stiffness of '{name}' grows with its age" for name in young]
    for name in sorted(there & materials.keys()):
        material = materials[name]
        endless = next(
            (one for _, one in sections_of_creep(material.creep) if not _ends(one)), None
        )
        if endless is not None:
            what = "a dashpot" if endless.maxwell is not None else "the logarithm of time"
            reasons.append(f"'{name}' creeps on without end ({what})")
        elif material.ageing is not None and name in placed:
            reasons.append(f"the stiffness of '{name}' grows with its age")
    if reasons:
        message = f"the stage does not say how long it lasts, and {reasons[0]}"
        hint = f"Add 'lasts: 12 d' to stage '{stage.name}'; 'lasts: 0 d' if no time passes."
        faults.add(("stages", number), "no-duration", message, hint)


def _ends(section: CreepSection) -> bool:
    return section.maxwell is None and section.law != "logarithmic"


def check_creep_in_service(name: str, material: MaterialSection, faults: SectionFaults) -> None:
    """In service a material creeps by one share of all its strain, and ages by a share.

    Args:
        name: of the material.
        material: its section.
        faults: takes what is wrong, with paths from the case on.
    """
    sections = sections_of_creep(material.creep)
    hint = "Write creep: {share: 0.8, time: 3 years}."
    for n, (path, one) in enumerate(sections):
        if n or one.share is None or one.part not in {None, "both"}:
            message = "a structure in service creeps by one share of its elastic strain"
            faults.add(("materials", name, "creep", *path), "not-in-service", message, hint)
    if material.ageing is not None and material.ageing.share is None:
        message = "in service a modulus grows by a share, with the time under load"
        hint = "Write ageing: {share: 0.2, time: 2 years}."
        faults.add(("materials", name, "ageing"), "not-in-service", message, hint)

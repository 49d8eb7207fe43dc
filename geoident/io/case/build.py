"""From the validated sections of a case file to the case: plain data in SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from geoident.io.case.actions import LoadBuilder, build_temperature, build_water
from geoident.io.case.gauges import build_channels, vector
from geoident.io.case.in_situ import build_in_situ
from geoident.io.case.materials import build_materials
from geoident.io.case.parameters import ParameterSection
from geoident.io.case.schema import CaseSection
from geoident.io.case.sequence import ABSENT
from geoident.io.case.structures import build_structures
from geoident.io.case.values import Given
from geoident.io.text.faults import Faults
from geoident.model.case import (
    Analysis,
    Case,
    FitSettings,
    Material,
    Stage,
    Support,
)
from geoident.model.methods import (
    LOSS_OPTIONS,
    METHOD_OPTIONS,
    ClosedFormOptions,
    LossOptions,
    MethodOptions,
    ScanAxis,
)
from geoident.model.parameter import Parameter, Prior, Scalar
from geoident.model.yielding import numbers_of_yield

_AXES = "xyz"


def build_case(section: CaseSection, mesh_file: str | None, faults: Faults) -> Case:
    """The case without its readings; what does not fit its number of axes is noted as a fault.

    Args:
        section: the whole case as it is written.
        mesh_file: path of the mesh, or None without one.
        faults: takes what is wrong.
    """
    in_situ, zones = build_in_situ(section.in_situ, _dim(section), faults)
    builder = LoadBuilder(
        Analysis(section.analysis), gravity=section.gravity is not None, faults=faults
    )
    materials = build_materials(section, faults)
    return Case(
        title=section.title,
        analysis=Analysis(section.analysis),
        mesh_file=mesh_file,
        parameters=tuple(_parameter(name, p) for name, p in section.parameters.items()),
        materials=materials,
        groups={group: None if m == ABSENT else m for group, m in section.groups.items()},
        supports=_supports(section, faults),
        in_situ=in_situ,
        gravity=_gravity(section, faults),
        loads=builder.build(section.loads, ("loads",)),
        stages=_stages(section, builder, faults),
        channels=build_channels(section, faults),
        readings=(),
        fit=_fit(section, strengths=_seek_strengths(materials)),
        source=faults.places.source(),
        in_situ_of=zones,
        water=build_water(section.water),
        structures=build_structures(section, faults),
    )


def _dim(section: CaseSection) -> int:
    return Analysis(section.analysis).dim


def _scalar(given: Given | None) -> Scalar | None:
    return None if given is None else given.scalar


def _parameter(name: str, section: ParameterSection) -> Parameter:
    prior = section.prior
    return Parameter(
        name=name,
        start=section.start.factor,
        lower=section.bounds[0].factor,
        upper=section.bounds[1].factor,
        scale=section.scale,
        prior=Prior(prior.mean.factor, prior.sd.factor, prior.kind) if prior else None,
        dimension=section.start.dimension,
        unit=section.start.unit,
    )


def _supports(section: CaseSection, faults: Faults) -> tuple[Support, ...]:
    dim = _dim(section)
    supports = []
    for group, value in section.supports.items():
        names = _AXES[:dim] if value == "fixed" else value
        components = tuple(sorted({_AXES.index(name) for name in names}))
        if components[-1] >= dim:
            path = ("supports", group)
            faults.add(path, "wrong-dimension", "a plane model has no direction z", "Use x and y.")
        supports.append(Support(group, components))
    return tuple(supports)


def _gravity(section: CaseSection, faults: Faults) -> tuple[float, ...] | None:
    given, dim = section.gravity, _dim(section)
    if given is None:
        return None
    if isinstance(given, list):
        return vector(given, dim, ("gravity",), faults, what="gravity")
    if given.factor < 0:
        hint = "A single value points downwards by itself; write it positive, or as a vector."
        faults.add(("gravity",), "out-of-range", f"'{given.text}' is negative", hint)
    return (*(0.0,) * (dim - 1), -given.factor)


def _stages(section: CaseSection, builder: LoadBuilder, faults: Faults) -> tuple[Stage, ...]:
    return tuple(
        Stage(
            name=stage.name,
            excavate=tuple(stage.excavate),
            install=dict(stage.install),
            change=dict(stage.change),
            release={group: part.scalar for group, part in stage.release.items()},
            loads=builder.build(stage.loads, ("stages", n, "loads")),
            remove=tuple(stage.remove),
            build=tuple(stage.build),
            dismantle=tuple(stage.dismantle),
            water=build_water(stage.water),
            temperature=build_temperature(
                stage.temperature, ("stages", n, "temperature"), _dim(section), faults
            ),
            independent=stage.independent,
            base=stage.base,
        )
        for n, stage in enumerate(section.stages)
    )


def _seek_strengths(materials: Mapping[str, Material]) -> bool:
    """Whether strengths of yield limits are parameters."""
    return any(
        number.parameter is not None
        for material in materials.values()
        for surface in material.yields
        for number in numbers_of_yield(surface)
    )


def _fit(section: CaseSection, *, strengths: bool) -> FitSettings:
    chain = section.fit.chain(strengths=strengths)
    methods = tuple(_options(section, method) for method in chain)
    stages = None if section.fit.stages is None else tuple(section.fit.stages)
    opening = _options(section, "closed-form")
    assert isinstance(opening, ClosedFormOptions)
    return FitSettings(methods, stages, _loss(section), opening)


def _loss(section: CaseSection) -> LossOptions:
    kind = LOSS_OPTIONS[section.fit.loss]
    given = section.fit.options(section.fit.loss) if fields(kind) else None
    return kind(**{option.name: getattr(given, option.name).factor for option in fields(kind)})


def _options(section: CaseSection, method: str) -> MethodOptions:
    kind = METHOD_OPTIONS[method]
    given = section.fit.options(method)
    values: dict[str, Any] = {}
    for option in fields(kind):
        value = getattr(given, option.name)
        values[option.name] = _plain(value)
    if method == "scan":
        values["grid"] = {
            name: ScanAxis(axis.start.factor, axis.stop.factor, axis.points or values["points"])
            for name, axis in values["grid"].items()
        }
    return kind(**values)


def _plain(value: Any) -> Any:
    """An option as numbers in SI units."""
    if isinstance(value, list):
        return tuple(_plain(entry) for entry in value)
    return value.factor if isinstance(value, Given) else value

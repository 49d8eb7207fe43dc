"""A case file as a whole: what it may hold, and the case that it is built into.

This is the code that validates, and the JSON schema is generated from it. Every key has its module
here, with its section and what this is built into. What takes more than one section to judge is in
`references` (names that refer to something else in the case) and in `stages` (their sequence).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import cache
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)
from pydantic_core import PydanticKnownError

from geoident.errors import Term
from geoident.io.case.actions import LoadSection, WaterSection
from geoident.io.case.creep import IN_TIME
from geoident.io.case.creep_checks import check_creep_in_service, check_staged_creep
from geoident.io.case.decisions import Decisions, build_decisions
from geoident.io.case.durations import Timetable, is_date
from geoident.io.case.external.section import ConvergenceLawSection, ElsewhereSection
from geoident.io.case.external.settlement_section import SettlementLawSection
from geoident.io.case.face import FaceSection, build_face
from geoident.io.case.fit import FitSection
from geoident.io.case.frames import with_periods
from geoident.io.case.gauges.kinds import GaugeSection, build_channels
from geoident.io.case.gauges.value import PlainReadingSection
from geoident.io.case.ground import MaterialSection, build_materials
from geoident.io.case.heat import HeatSection
from geoident.io.case.heat_checks import check_heat, refuse_heat
from geoident.io.case.hydraulic import DrainedSection
from geoident.io.case.in_service.seasonal import IN_SERVICE, SeasonalModelSection
from geoident.io.case.in_service.series import DIMENSION_OF, SeriesSection
from geoident.io.case.in_service.structure import (
    WATER_TEMPERATURE,
    ReservoirSection,
    ServiceSection,
    check_service,
)
from geoident.io.case.in_situ import InSituSection, build_in_situ
from geoident.io.case.interfaces import InterfaceSection, build_interfaces
from geoident.io.case.laboratory import AnyTest
from geoident.io.case.ladder import build_ladder
from geoident.io.case.model_error import ModelErrorSection
from geoident.io.case.parameters import ParameterSection
from geoident.io.case.readings import BadSection, Date, Readings
from geoident.io.case.report import ReportSection, check_curves
from geoident.io.case.stages import ABSENT, StageSection
from geoident.io.case.structures import OpeningSupportSection, StructureSection
from geoident.io.case.supports.section import SupportValue, build_supports
from geoident.io.case.varied.growth import GrowthBase
from geoident.io.case.varied.rock_mass import RockMassModulusSection
from geoident.io.case.yielding.hardening_checks import check_hardening
from geoident.io.schema.section import Context, Section, SectionFaults, optional
from geoident.io.schema.values import (
    Accelerations,
    CaseNumber,
    CelsiusTemperature,
    Count,
    FixedAcceleration,
    Name,
    ParameterName,
    Text,
    TextOrList,
)
from geoident.io.text.dates import read_date
from geoident.io.text.faults import Faults
from geoident.model.case import VIRGIN, Analysis, Case, KeyPath, Material
from geoident.model.parameter import scalars_of

_AXES = "xyz"


class MeshSection(Section):
    """The finite element mesh."""

    file: Text = Field(
        description="Path of the mesh, relative to the case. Groups go by their physical names. "
        "`geoident:specimen` and others are those on which `tests` are computed."
    )
    order: Annotated[int, Count(most=2)] = Field(
        1,
        description="2 gives elements of first order nodes on the middle of their straight edges: "
        "linear triangles, tetrahedra and wedges are too stiff where ground yields. 1 takes the "
        "elements as they are in the file.",
    )


Gravity = TextOrList[FixedAcceleration, Accelerations]


def _load_shape(value: object) -> str:
    if isinstance(value, SeriesSection) or (isinstance(value, Mapping) and "file" in value):
        return "<file>"
    if isinstance(value, ReservoirSection) or (isinstance(value, Mapping) and "model" in value):
        return "<model>"
    return "mapping"


LoadValue = Annotated[
    Annotated[LoadSection, Tag("mapping")]
    | Annotated[SeriesSection, Tag("<file>")]
    | Annotated[ReservoirSection, Tag("<model>")],
    Discriminator(_load_shape),
]
"""A load that stays, or one that changes in time."""

ONE_STAGE = "end"
"""Name of the one stage of a case with a model elsewhere that lists none."""


LEFT_OUT = "left out"
"""Key of the context of a validation: sections that are left out because they are wrong."""


class _Absent:
    """Stands for a key that is not written."""


def _or_elsewhere(instead: object) -> WrapValidator:
    """A key that is required but where the model is external."""

    def validate(value: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
        if not isinstance(value, _Absent):
            return handler(value)
        left_out = (info.context or {}).get(LEFT_OUT, ())
        if info.data.get("model", value) is None and info.field_name not in left_out:
            raise PydanticKnownError("missing")
        return instead

    return WrapValidator(validate)


def _stages(value: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
    if not isinstance(value, _Absent):
        return handler(value)
    model = info.data.get("model")
    if isinstance(model, ConvergenceLawSection):
        return [StageSection(name=name) for name in model.face]
    if isinstance(model, SeasonalModelSection):
        return [StageSection(name=IN_SERVICE)]
    # those of a settlement law are the days of reading, which nobody knows yet
    none = model is None or isinstance(model, SettlementLawSection)
    return [] if none else [StageSection(name=ONE_STAGE)]


_GROUND = ("analysis", "materials", "groups")
"""Keys without which geoident computes nothing."""


def _says_what_a_model_needs(schema: dict[str, Any]) -> None:
    """Keys of the ground are required but where the model is external or a test."""
    schema["required"] = ["format"]
    schema["if"] = {"anyOf": [{"required": ["model"]}, {"required": ["tests"]}]}
    schema["else"] = {"required": list(_GROUND)}


class CaseSection(Section):
    """A project for geoident: ground, construction, gauges and what is to be identified."""

    model_config = ConfigDict(json_schema_extra=_says_what_a_model_needs)

    format: Literal["geoident-case/1"] = Field(description="Type and version of this file.")
    title: Text = Field("", description="Free text.")
    model: ElsewhereSection | None = optional(
        "A program, a function of Python, a table of runs, a law of convergence or of "
        "settlement that gives the readings, in place of `mesh`, ground and supports: of a stage "
        "only its name is left then, of a gauge `kind: reading` with its accuracy. `analysis`, "
        "`materials` and `groups` are required without it."
    )
    analysis: Annotated[
        Literal["plane-strain", "axisymmetric", "solid"], _or_elsewhere("plane-strain")
    ] = Field(
        default_factory=_Absent,
        validate_default=True,
        description="Kind of analysis. Axisymmetric: the mesh is half a section, x is the radius "
        "(>= 0), y the axis; the stresses xx, yy, zz, xy are radial, axial, hoop and shear rz.",
    )
    mesh: MeshSection | None = optional(
        "The finite element mesh. Without it the case is a circular opening that "
        "`fit.closed-form` gives, computed by formulas: all that the stages excavate."
    )
    parameters: dict[ParameterName, ParameterSection] = Field(
        {}, description="What is identified; $NAME refers to it elsewhere in the case."
    )
    materials: Annotated[
        Annotated[dict[Name, MaterialSection], Field(min_length=1)], _or_elsewhere({})
    ] = Field(default_factory=_Absent, validate_default=True, description="Materials by name.")
    groups: Annotated[Annotated[dict[Name, Name], Field(min_length=1)], _or_elsewhere({})] = Field(
        default_factory=_Absent,
        validate_default=True,
        description="Element group to its material in the initial state (before the first stage), "
        "or 'absent'.",
    )
    tests: dict[Name, AnyTest] = Field(
        {},
        description="Tests by name, in place of the mesh and all that goes with it: a case of "
        "`tests` has `parameters` and `materials` beside them, and a project fits it together with "
        "the case of the site.",
    )
    supports: dict[Name, SupportValue] = Field(
        {},
        description="Group to fixed directions: x, [x, y], or fixed for all; or to how it moves, "
        "from the stages on that build on the virgin state.",
        examples=[{"bottom": "fixed", "outer": {"x": "1 mm"}}],
    )
    in_situ: InSituSection | None = optional(
        "In-situ stress of the ground, before the first stage."
    )
    water: WaterSection | None = optional("Water in the pores in the initial state.")
    drained: dict[Name, DrainedSection] = Field(
        {},
        description="Group of faces (lines in 2-D, surfaces in a solid) at which the water of "
        "consolidating ground leaves freely; all other edges are closed.",
        examples=[{"top": {}}, {"well": {"head": "-4 m"}}],
    )
    initial_temperature: CelsiusTemperature | None = optional(
        "Of all ground before the first stage. With it the ground conducts heat in its "
        "stages, which last, and all materials have `conductivity` and `heat_capacity`.",
        examples=["11 degC", "$T_0"],
    )
    heat: dict[Name, HeatSection] = Field(
        {},
        description="Group of faces (lines in 2-D, surfaces in a solid) or nodes to its "
        "temperature, or to what the faces exchange heat with; all other edges are adiabatic.",
        examples=[{"surface": {"temperature": "8 degC", "film": "12 W/m2K"}}],
    )
    gravity: Gravity | None = optional(
        "Acceleration, downwards (-y in 2-D, -z in a solid), or a vector.", examples=["9.81 m/s2"]
    )
    loads: dict[Name, LoadValue] = Field(
        {},
        description="Loads that act from the beginning; of a structure in service the level of the "
        "water, the temperature of the air and that of the water, `level`, `air` and "
        "`water_temperature`, day by day.",
        examples=[{"level": {"file": "level.csv", "unit": "m"}}],
    )
    structures: dict[Name, StructureSection] = Field(
        {},
        description="Walls, linings, struts, anchors and bolts by name; a stage says when it "
        "builds them.",
    )
    interfaces: dict[Name, InterfaceSection] = Field(
        {},
        description="Faces along which the ground parts and slips, by name: joints, faults, the "
        "contact of a wall.",
        examples=[{"fault": {"along": "fault", "k_n": "10 GPa/m", "k_s": "1 GPa/m"}}],
    )
    face: FaceSection | None = optional(
        "How the distance of a section to the tunnel face (`distance` of stages) "
        "becomes a part of the stress of the tunnel that is released: a longitudinal displacement "
        "profile, in plane strain.",
        examples=[{"profile": "vlachopoulos-diederichs", "radius": "4 m"}],
    )
    stages: Annotated[list[StageSection], WrapValidator(_stages)] = Field(
        default_factory=_Absent,
        validate_default=True,
        description="Construction, step by step; without it a model elsewhere has one, named "
        f"{ONE_STAGE}.",
    )
    time_steps: Annotated[int, Count(most=1000)] | None = optional(
        "Steps in time before they double in length, in stages that last: 6 if missing "
        "where water flows, 3 where ground creeps without. Twice as many leave a quarter of the "
        "error by the steps, which a fit tells.",
        examples=[12],
    )
    service: ServiceSection | None = optional(
        "The structure is in service from the last stage on: water level and "
        "temperatures of `loads` act on it day by day.",
        examples=[{"since": "2010-04-01", "faces": {"wetted": ["upstream"], "air": ["crest"]}}],
    )
    gauges: dict[Name, GaugeSection] = Field({}, description="Gauges by name.")
    dates: dict[Name, Date] = Field(
        {},
        description="Stage (or 'virgin') to the date of its end, for dated readings and drift.",
        examples=[{"heading": "2024-03-01", "bench 1": "2024-04-15"}],
    )
    readings: Readings | None = optional(
        "Path of a CSV file (gauge,stage,value,unit), a description of a file, or a "
        "list of files and readings."
    )
    bad: list[BadSection] = Field(
        [], description="Readings known to be wrong: shown with the reason, and not used."
    )
    decision: Decisions | None = optional(
        "What is to be done if a reading is beyond a value, or a list of that. A fit "
        "says how probable it is, and which reading at an earlier stage would make it so.",
        examples=[{"if": "CV1 > 40 mm at bench 5", "then": "install the second row of bolts"}],
    )
    fit: FitSection = Field(default_factory=FitSection)
    report: ReportSection | None = optional("The head of the report.")

    @property
    def service_stage(self) -> str | None:
        """Name of the stage that is in service; None for a case of stages alone."""
        if isinstance(self.model, SeasonalModelSection):
            return IN_SERVICE
        return self.stages[-1].name if self.service is not None and self.stages else None

    @property
    def in_stages(self) -> bool:
        """Whether readings belong to stages, and not to days of their own."""
        return self.service_stage is None and not isinstance(self.model, SettlementLawSection)

    @property
    def service_since(self) -> str | None:
        """When the service begins."""
        if isinstance(self.model, SeasonalModelSection):
            return self.model.since
        return None if self.service is None else self.service.since

    def check(self, faults: SectionFaults) -> None:
        """There is ground, or a model elsewhere, not both."""
        if self.model is None:
            _require_ground(self, faults)
        else:
            _refuse_ground(self, faults)
        if self.service is not None and self.model is None:
            _check_in_service(self, self.service, faults)
        if self.time_steps is not None and not any(stage.lasts for stage in self.stages):
            message = "no stage lasts, so there are no steps in time"
            hint = "Remove it, or write how long stages last: 'lasts: 30 d'."
            faults.add(("time_steps",), "unused-key", message, hint)
        until, since = self.fit.until, self.service_since
        if until is not None and since is not None and not is_date(until):
            message = f"'{until}' is no date, and a structure in service has no other stages"
            faults.add(("fit", "until"), "bad-date", message, "Write it like 2024-03-01.")
        elif until is not None and since is not None and read_date(until) <= read_date(since):
            key = "service" if self.model is None else "model"
            message = f"'{until}' is not after {key}.since, '{since}'"
            faults.add(("fit", "until"), "dates", message, "Correct one of them.")


def _require_ground(section: CaseSection, faults: SectionFaults) -> None:
    """What geoident computes has materials, loads that stay, and gauges that are somewhere."""
    for name, load in section.loads.items():
        if section.service is None and not isinstance(load, LoadSection):
            message = f"'{name}' changes in time, and the model has none"
            hint = (
                "Loads from files belong to a structure in service: 'service' with its faces, or "
                "'model: {kind: seasonal}'. In stages write numbers."
            )
            faults.add(("loads", name), "no-time", message, hint)
    if section.service is None:
        check_staged_creep(
            section.materials, section.groups, section.stages, section.structures, faults
        )
        others = {"face": section.face, "initial_temperature": section.initial_temperature}
        check_hardening(section.materials, section.stages, others, faults)
    if section.service is None and section.initial_temperature is not None:
        check_heat(
            section.materials, section.parameters, section.groups, section.heat, section.stages,
            faults,
        )  # fmt: skip
    else:
        keys = {"initial_temperature": section.initial_temperature, "heat": section.heat}
        refuse_heat(keys, section.stages, faults, served=section.service is not None)
    if section.interfaces and (section.mesh is None or section.service is not None):
        what = "a structure in service" if section.service is not None else "a case without a mesh"
        message = f"{what} has no interfaces"
        hint = "Describe the case by stages on a mesh, without 'service', or remove them."
        faults.add(("interfaces",), "no-interface", message, hint)
    for name, gauge in section.gauges.items():
        if isinstance(gauge, PlainReadingSection):
            message = "a plain reading is nowhere, so geoident cannot compute it"
            hint = (
                "Say what the gauge is and where; 'kind: reading' belongs to a case with 'model'."
            )
            faults.add(("gauges", name, "kind"), "no-place", message, hint)


def _check_in_service(section: CaseSection, service: ServiceSection, faults: SectionFaults) -> None:
    """A structure in service has a mesh, stages, and nothing that only fits readings of stages."""
    for key in ("mesh", "stages"):
        if not getattr(section, key):
            message = f"a structure in service needs '{key}'"
            hint = "Without a mesh: 'model: {kind: seasonal}'." if key == "mesh" else ""
            hint = hint or "The last stage is the one in service: stages: [{name: in service}]."
            faults.add(("service",), "missing-key", message, hint)
    known = list(DIMENSION_OF)
    for name, load in section.loads.items():
        if isinstance(load, ReservoirSection) and name != WATER_TEMPERATURE:
            hint = f"Call it {WATER_TEMPERATURE}."
            faults.add(("loads", name), "unused-load", "a reservoir's temperature acts there", hint)
        elif isinstance(load, SeriesSection) and name not in known:
            message = f"nothing depends on '{name}'"
            hint = f"What acts day by day is {', '.join(known)}."
            faults.add(("loads", name), "unused-load", message, hint)
    in_time = [name for name, one in section.loads.items() if not isinstance(one, LoadSection)]
    check_service(service, [name for name in in_time if name in known], faults)
    waters = [section.water, *(stage.water for stage in section.stages)]
    for n, uplift in enumerate(service.uplift):
        if uplift.pores and any(waters):
            message = "the case has 'water' in pores that stands still, and this falls"
            hint = "Remove 'water': its motion is a constant of each gauge."
            faults.add(("service", "uplift", n, "pores"), "two-waters", message, hint)
    if section.stages and section.stages[-1].independent:
        message = "the last stage is the one in service, and it is independent"
        hint = "Put the stage of the service last."
        faults.add(("stages", len(section.stages) - 1, "independent"), "no-service", message, hint)
    for name, material in section.materials.items():
        if material.yields is not None:
            message = "a structure in service is elastic"
            hint = "Remove 'yield', or describe the case by stages, without 'service'."
            faults.add(("materials", name, "yield"), "yields", message, hint)
        check_creep_in_service(name, material, faults)
    for name, structure in section.structures.items():
        for attribute in ("limits", "capacity", "compression_only"):
            if getattr(structure, attribute, None):
                key = "yield" if attribute == "limits" else attribute
                message = "a structure in service is elastic: its motions are sums"
                hint = f"Remove '{key}'; it is elastic without."
                faults.add(("structures", name, key), "yields", message, hint)
    for n, stage in enumerate(section.stages):
        if stage.lasts is not None:
            message = "the stages of a structure in service are equilibria without time"
            hint = "Remove it: water has drained from the ground when the service begins."
            faults.add(("stages", n, "lasts"), "no-time", message, hint)
    if service.loaded is not None and not any(
        getattr(material, key) for material in section.materials.values() for key in IN_TIME
    ):
        message = f"no material has {', '.join(IN_TIME[:-1])} or {IN_TIME[-1]}"
        hint = "Remove it, or add creep: {share: 0.8, time: 3 years} to a material."
        faults.add(("service", "loaded"), "unused-key", message, hint)
    fit = section.fit
    error = fit.model_error
    if isinstance(error, ModelErrorSection) and error.time is not None:
        message = "the model of a structure in service errs by level and temperature, not in time"
        faults.add(("fit", "model_error", "time"), "no-stages", message, "Remove it.")
    for key in ("ladder", "keep_reduced"):
        if key in fit.model_fields_set and getattr(fit, key):
            message = "it does not fit readings in time: their noise follows from the residuals"
            faults.add(("fit", key), "no-stages", message, "Remove it.")
    methods = [fit.method] if isinstance(fit.method, str) else fit.method or []
    for method in methods:
        if method not in _IN_TIME:
            message = f"{method} does not fit readings in time"
            hint = f"Write one of {', '.join(_IN_TIME)}, or remove it."
            faults.add(("fit", "method"), "no-method", message, hint)
    _refuse_decision(section, faults)
    if fit.loss != "squared":
        message = f"'{fit.loss}' does not fit readings whose errors last"
        faults.add(("fit", "loss"), "no-loss", message, "Remove it; wrong readings go to 'bad'.")


_IN_TIME = ("gauss-newton", "simplex")
"""Methods that need nothing of a model but its readings."""


_OF_THE_GROUND = (
    "mesh", "materials", "groups", "supports", "in_situ", "water", "drained", "initial_temperature",
    "heat", "gravity", "loads", "structures", "interfaces", "face", "service", "time_steps",
)  # fmt: skip


def _refuse_ground(section: CaseSection, faults: SectionFaults) -> None:
    """A model elsewhere has its ground, its construction and its gauges there."""
    why = "the model is external ('model'), so this would change nothing"
    for key in _OF_THE_GROUND:
        given = getattr(section, key)
        if key == "loads":
            given = {n: load for n, load in given.items() if not isinstance(load, SeriesSection)}
        if key in section.model_fields_set and given:
            faults.add((key,), "no-ground", why, "Remove it.")
    _check_series(section, faults)
    if isinstance(section.model, SeasonalModelSection):
        _check_seasonal(section, faults)
    for n, stage in enumerate(section.stages):
        fields = type(stage).model_fields
        for key in sorted(stage.model_fields_set - {"name"}):
            if getattr(stage, key) == fields[key].get_default():
                continue
            faults.add(("stages", n, key), "no-ground", why, "Leave the name of the stage only.")
    for name, gauge in section.gauges.items():
        if not isinstance(gauge, PlainReadingSection):
            message = f"the model is external, and geoident cannot place a gauge '{gauge.kind}'"
            hint = "Write 'kind: reading' with its accuracy; 'model' says what it reads."
            faults.add(("gauges", name, "kind"), "no-place", message, hint)
    if isinstance(section.model, SettlementLawSection):
        _check_settlement(section, faults)
    elif not section.stages:
        faults.add(("stages",), "no-stages", "there is no stage", "Remove the key for one stage.")


def _check_settlement(section: CaseSection, faults: SectionFaults) -> None:
    """The stages of a settlement law are days, and its dates those of the readings."""
    for key in ("stages", "dates"):
        if getattr(section, key):
            message = "the stages of a settlement law are the days of reading"
            hint = "Remove it; days to be predicted go to 'model.forecast'."
            faults.add((key,), "no-stages", message, hint)


def _check_seasonal(section: CaseSection, faults: SectionFaults) -> None:
    """A seasonal model has no stages, zeros, parameters and methods."""
    own = "a seasonal model has a constant of its own for each gauge, so this would change nothing"
    if [stage.name for stage in section.stages] != [IN_SERVICE]:
        message = "a structure in service has no stages: its readings have dates"
        faults.add(("stages",), "no-stages", message, "Remove it.")
    for name, gauge in section.gauges.items():
        if gauge.zero != VIRGIN:
            faults.add(("gauges", name, "zero"), "no-zero", own, "Remove it.")
    if section.parameters:
        message = "a seasonal model has coefficients of each gauge, and no parameters"
        faults.add(("parameters",), "no-parameters", message, "Remove them.")
    _refuse_decision(section, faults)
    if section.fit.method not in (None, "gauss-newton", ["gauss-newton"]):  # the default
        message = "a seasonal model is fitted by restricted likelihood, gauge by gauge"
        faults.add(("fit", "method"), "no-method", message, "Remove it.")


def _refuse_decision(section: CaseSection, faults: SectionFaults) -> None:
    if section.decision is not None:
        message = "a decision is on the reading of a stage, and a structure in service has none"
        hint = f"Remove it. 'limits' of gauges are judged by {Term.CONTROL}."
        faults.add(("decision",), "no-stages", message, hint)


def _check_series(section: CaseSection, faults: SectionFaults) -> None:
    """Loads that change in time are those that the model uses."""
    model = section.model
    used = model.used_loads() if isinstance(model, SeasonalModelSection) else []
    for name, load in section.loads.items():
        if isinstance(load, SeriesSection) and name not in used:
            message = f"the model does not depend on '{name}'"
            hint = "Remove it."
            if name in DIMENSION_OF and isinstance(model, SeasonalModelSection):
                example = "3" if name == "level" else "[3 d, 20 d]"
                hint = f"Add model: {{{name}: {example}}}, or remove it."
            faults.add(("loads", name), "unused-load", message, hint)


def build_case(
    section: CaseSection, times: Timetable, faults: Faults, wrong: Collection[str] = ()
) -> Case:
    """The case in SI units, without mesh and readings; what does not fit its axes is a fault.

    Args:
        section: the case.
        times: of its stages.
        faults: takes the faults.
        wrong: sections that are left out because they are wrong.
    """
    context = Context((), Analysis(section.analysis), faults)
    ties = [(path, given) for path, given in numbers_with_paths(section) if given.parameter]
    in_situ, zones = build_in_situ(section.in_situ, context.at("in_situ"))
    materials = build_materials(section.materials, section.parameters, context.at("materials"))
    if section.mesh is None and section.model is None and "mesh" not in wrong:
        _refuse_fields(materials, context)
    structures = {
        name: part.for_model(context.at("structures", name))
        for name, part in section.structures.items()
    }
    if section.mesh is not None or "mesh" in wrong:
        _refuse_opening_supports(section.structures, context)
    interfaces = build_interfaces(
        section.interfaces, materials, section.parameters, context.at("interfaces")
    )
    channels = build_channels(section.gauges, structures, context.at("gauges"))
    gauges_wrong = bool(section.gauges) and not channels  # nobody knows the channels
    known = dict.fromkeys(name for c in channels for name in (c.gauge, c.name))
    if not gauges_wrong:
        for n, name in enumerate(section.fit.predict_gauges or ()):
            if name not in known:
                faults.add_unknown(("fit", "predict_gauges", n), "gauge", name, known)
        if section.report is not None and "stages" not in wrong:
            check_curves(section.report, known, [stage.name for stage in section.stages], faults)
    return section.to_model(
        Case,
        context,
        analysis=context.analysis,
        mesh_file=None,
        mesh_order=1 if section.mesh is None else section.mesh.order,
        parameters=with_periods(
            [p.parameter(name) for name, p in section.parameters.items()], ties
        ),
        materials=materials,
        groups={group: None if m == ABSENT else m for group, m in section.groups.items()},
        supports=tuple(build_supports(section.supports, context.at("supports")).values()),
        in_situ=in_situ,
        loads={
            name: load.for_model(context.at("loads", name))
            for name, load in section.loads.items()
            if isinstance(load, LoadSection)
        },
        gravity=_gravity(section.gravity, context.at("gravity")),
        channels=channels,
        readings=(),
        dates={},
        service=None,
        fit=replace(
            section.fit.settings(
                strengths=_seek_strengths(materials)
                and all(stage.lasts is None for stage in section.stages)
            ),
            ladder=build_ladder(
                section.fit.ladder or (),
                section.materials,
                section.parameters,
                ties,
                context.at("fit", "ladder"),
            ),
        ),
        source=faults.places.source(),
        in_situ_of=zones,
        imbalance_accepted=section.in_situ is not None and section.in_situ.equilibrium == "accept",
        structures=structures,
        interfaces=interfaces,
        face=build_face(section.face, section.stages, circle_of(section), context.at("face")),
        decisions=build_decisions(
            None if {"gauges", "stages"} & {*wrong} or gauges_wrong else section.decision,
            channels,
            times,
            context.at("decision"),
        ),
    )


def circle_of(section: CaseSection) -> float | None:
    """Radius of an opening without mesh, m; None where there is a mesh, or no radius."""
    given: CaseNumber | None = getattr(section.fit.options("closed-form"), "radius", None)
    return None if given is None or section.mesh is not None else given.factor


def _refuse_fields(materials: Mapping[str, Material], context: Context) -> None:
    """Without a mesh the ground is the same everywhere."""
    for material in materials.values():
        for field in material.fields:
            message = f"{field.name} varies from place to place, and there is no mesh"
            hint = "Closed forms are of uniform ground: write one number."
            context.at(*field.path).refuse("no-mesh", message, hint, key=True)
        for growth in material.growths:
            message = f"{growth.words}, and there is no mesh"
            hint = "Closed forms are of uniform ground: write one number."
            context.at(*growth.path).refuse("no-mesh", message, hint, key=True)


def _refuse_opening_supports(structures: Mapping[str, StructureSection], context: Context) -> None:
    """On a mesh linings and bolts have their lines and points."""
    for name, part in structures.items():
        if isinstance(part, OpeningSupportSection):
            message = f"'{part.kind}' supports the opening of a closed form, and there is a mesh"
            hint = f"On a mesh write '{name}: {{{part.instead}}}'."
            context.at("structures", name, "kind").refuse("wrong-structure", message, hint)


def _gravity(given: Gravity | None, context: Context) -> tuple[float, ...] | None:
    if given is None:
        return None
    if isinstance(given, list):
        return context.vector(given)
    if given.factor < 0:
        hint = "A single value is downwards; write it positive, or as a vector."
        context.refuse("out-of-range", f"'{given.text}' is negative", hint)
    return (*(0.0,) * (context.dim - 1), -given.factor)


def _seek_strengths(materials: Mapping[str, Material]) -> bool:
    """Whether strengths of yield limits are parameters."""
    return any(
        number.parameter is not None
        for material in materials.values()
        for numbers in (
            *(surface.numbers for surface in material.yields),
            *(scalars_of(g.law).values() for g in material.growths if g.surface is not None),
        )
        for number in numbers
    )


def numbers_with_paths(node: object, path: KeyPath = ()) -> list[tuple[KeyPath, CaseNumber]]:
    """Every number of a case, or of a part of it that stands at a path, with its path."""
    numbers: list[tuple[KeyPath, CaseNumber]] = []
    _add_numbers(node, path, numbers)
    return numbers


_PLAIN = frozenset([type(None), str, float, int, bool])
"""Most of what a case holds: it is no number with a unit, and has none inside."""


def _add_numbers(node: object, path: KeyPath, numbers: list[tuple[KeyPath, CaseNumber]]) -> None:
    if type(node) in _PLAIN:
        return
    if isinstance(node, CaseNumber) and isinstance(
        node.varied_by, GrowthBase | RockMassModulusSection
    ):
        _add_numbers(node.varied_by, path, numbers)
    elif isinstance(node, CaseNumber):
        numbers.append((path if node.varied_by is None else (*path, "field", "mean"), node))
    elif isinstance(node, BaseModel):
        for name, key in _keys_of(type(node)):
            _add_numbers(getattr(node, name), (*path, key), numbers)
    elif isinstance(node, Mapping):
        for key, value in node.items():
            _add_numbers(value, (*path, key), numbers)
    elif isinstance(node, list):
        for n, value in enumerate(node):
            _add_numbers(value, (*path, n), numbers)


@cache
def _keys_of(section: type[BaseModel]) -> tuple[tuple[str, str], ...]:
    """Names of what a section has, and the keys under which users write it."""
    return tuple((name, info.alias or name) for name, info in section.model_fields.items())


def tied_parameters(section: CaseSection) -> frozenset[str]:
    """Names of the parameters that the case itself refers to by ``$NAME``."""
    names = (given.parameter for _, given in numbers_with_paths(section))
    return frozenset(name for name in names if name is not None)

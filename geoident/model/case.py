"""One case: what `case.yaml`, read and resolved, says. All numbers in SI units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property

import numpy as np

from geoident.errors import Fault, Location
from geoident.model.actions import (
    Contraction,
    FaceProfile,
    Load,
    MotionField,
    Temperature,
    Water,
)
from geoident.model.arrays import Floats
from geoident.model.creep import Ageing, CreepElement
from geoident.model.decision import Decision
from geoident.model.external import ExternalSource
from geoident.model.gauges import Channel, Reading, StageReadings, taken_together
from geoident.model.ground import Elastic, Growth, RandomField, elastic_scalars
from geoident.model.heat import HeatFace, Hydration
from geoident.model.hydraulic import Drained, Hydraulic
from geoident.model.in_service import SeasonalModel, StructureInService, TimeCurve
from geoident.model.in_situ import InSitu
from geoident.model.interfaces import Interface
from geoident.model.methods import (
    ClosedFormOptions,
    LossOptions,
    MethodOptions,
    ModelErrorOptions,
    SquaredOptions,
)
from geoident.model.parameter import Parameter, Scalar, scalars_of
from geoident.model.structures import Structure, ages
from geoident.model.yielding import HardeningSoil, YieldSurface

KeyPath = tuple[str | int, ...]

VIRGIN = "virgin"
"""Reserved name of stage 0, the state before the first stage of the case."""


class Analysis(Enum):
    """Kind of analysis, named as users write it."""

    PLANE_STRAIN = "plane-strain"
    AXISYMMETRIC = "axisymmetric"
    SOLID = "solid"

    @property
    def dim(self) -> int:
        """Space dimensions of the mesh it needs."""
        return 3 if self is Analysis.SOLID else 2


@dataclass(frozen=True)
class Source:
    """Where each key of the case is written in its file, so that later faults can name it.

    Args:
        file: path of the file.
        positions: key to line and column.
        stages: for each stage of the case the number of that in the file of which it is a moment;
            empty where they are the same.
        made_of: see `path_in_file`.
    """

    file: str = ""
    positions: Mapping[KeyPath, tuple[int, int]] = field(default_factory=dict)
    stages: tuple[int, ...] = ()
    made_of: Mapping[KeyPath, KeyPath] = field(default_factory=dict)

    def has(self, path: KeyPath) -> bool:
        """Whether the file has a key of the case."""
        return self._written(path) in self.positions

    def locate(self, path: KeyPath) -> Location:
        """Line and column of a key; of its nearest enclosing key if it is not written."""
        path = self._written(path)
        for end in range(len(path), -1, -1):
            if path[:end] in self.positions:
                return Location(self.file, *self.positions[path[:end]])
        return Location(self.file)

    def fault(self, path: KeyPath, code: str, message: str, hint: str = "") -> Fault:
        """A fault at a key of the case.

        Args:
            path: of the key.
            code: what kind of fault it is, for programs.
            message: what is wrong, half a sentence.
            hint: what would be right; empty for nothing to say.
        """
        return Fault(code, message, hint, self.locate(path), format_path(self._written(path)))

    def _written(self, path: KeyPath) -> KeyPath:
        """The path of a key in the file, whose stages may be fewer than those of the case."""
        if self.stages and path[:1] == ("stages",) and len(path) > 1:
            return ("stages", self.stages[int(path[1])], *path[2:])
        return path_in_file(path, self.made_of)


def path_in_file(path: KeyPath, made_of: Mapping[KeyPath, KeyPath]) -> KeyPath:
    """The path in the file of a key of a case, which reading may have made of another.

    Args:
        path: of the key.
        made_of: where paths begin that reading has made, to what that is in the file; the longest
            beginning counts.

    >>> path_in_file(("materials", "copy", "E"), {("materials", "copy"): ("materials", "clay")})
    ('materials', 'clay', 'E')
    """
    for end in range(len(path), 0, -1):
        if path[:end] in made_of:
            return (*made_of[path[:end]], *path[end:])
    return path


def format_path(path: KeyPath) -> str:
    """The path of a key as users write it.

    >>> format_path(("stages", 1, "excavate", 0))
    'stages[1].excavate[0]'
    """
    text = ""
    for key in path:
        text += f"[{key}]" if isinstance(key, int) else f".{key}" if text else str(key)
    return text


@dataclass(frozen=True)
class Material:
    """A material: elasticity, density in kg/m3, thermal expansion in 1/K (0 if not given).

    Of heat: conductivity in W/mK, and capacity in J/m3K, or in J/kgK as specific heat; what it sets
    free as it hardens (hydration).

    Its yield surfaces hold together; none: it does not yield. A constant of which there is a field
    varies from place to place; the constant itself is then the mean. One that grows is the number
    from which it grows.

    Under load it creeps by a chain of elements, and its modulus grows with its age (ageing). In
    service it creeps by one share of its elastic strain, and its modulus grows or falls (softening)
    by a share with the time under load.

    As a ``soil`` it has stiffness and strength by a law with a state, and no yield surfaces.

    Its water: without ``hydraulic`` it leaves at once.
    """

    name: str
    elastic: Elastic
    density: Scalar = Scalar(0.0)
    expansion: Scalar = Scalar(0.0)
    yields: tuple[YieldSurface, ...] = ()
    fields: tuple[RandomField, ...] = ()
    growths: tuple[Growth, ...] = ()
    conductivity: Scalar | None = None
    heat_capacity: Scalar | None = None
    specific_heat: Scalar | None = None
    hydration: Hydration | None = None
    creep: tuple[CreepElement, ...] = ()
    ageing: Ageing | None = None
    softening: TimeCurve | None = None
    hydraulic: Hydraulic | None = None
    soil: HardeningSoil | None = None

    @property
    def is_elastic(self) -> bool:
        """Whether it neither yields nor hardens."""
        return not self.yields and self.soil is None

    @property
    def in_time(self) -> dict[str, TimeCurve]:
        """How it changes in service: ``creep``, ``ageing`` or ``softening`` to its curve."""
        creep = self.creep[0] if self.creep else None
        curves = {"creep": creep, "ageing": self.ageing, "softening": self.softening}
        return {name: curve for name, curve in curves.items() if isinstance(curve, TimeCurve)}

    @property
    def consolidates(self) -> bool:
        """Whether water takes time to leave it."""
        return self.hydraulic is not None and not self.hydraulic.impervious

    @property
    def conducts(self) -> bool:
        """Whether conductivity and heat capacity are given."""
        return self.conductivity is not None and (
            self.heat_capacity is not None or self.specific_heat is not None
        )

    @property
    def scalars(self) -> tuple[Scalar, ...]:
        """All its numbers."""
        return (
            *elastic_scalars(self.elastic).values(),
            self.density,
            self.expansion,
            *(
                number
                for number in (self.conductivity, self.heat_capacity, self.specific_heat)
                if number is not None
            ),
            *(() if self.hydration is None else self.hydration.scalars),
            *(() if self.hydraulic is None else self.hydraulic.scalars),
            *(number for surface in self.yields for number in surface.numbers),
            *(() if self.soil is None else self.soil.numbers),
            *(number for element in self.creep for number in scalars_of(element).values()),
            *(() if self.ageing is None else self.ageing.numbers),
            *(() if self.softening is None else self.softening.numbers),
            *(field.mean for field in self.fields),
            *(number for g in self.growths for number in (g.base, *scalars_of(g.law).values())),
        )


@dataclass(frozen=True)
class Support:
    """A group (of facets, nodes or elements) or a node that is held, or moved by what is given.

    A motion is counted from the state on which the stage builds that gives it first; supports of
    the case itself begin to move at the stages that build on the virgin state.

    Args:
        group: name of the group in the mesh, or of the support where it is at a point.
        components: directions that are held, 0 for x, 1 for y, 2 for z.
        at: (dim,) a node in place of a group, m; None: the group.
        motions: of directions (0, 1 or 2), m; those that are held and not here are still.
        measured: motions from points, or None.
        contraction: of a wall, or None.
    """

    group: str
    components: tuple[int, ...]
    at: tuple[float, ...] | None = None
    motions: tuple[tuple[int, Scalar], ...] = ()
    measured: MotionField | None = None
    contraction: Contraction | None = None

    @property
    def moves(self) -> bool:
        """Whether any motion is given."""
        return bool(self.motions) or self.measured is not None or self.contraction is not None


@dataclass(frozen=True)
class Stage:
    """One step of construction. Things happen together, in one state of equilibrium.

    Args:
        name: unique name.
        excavate: groups that leave.
        install: group to material: enters free of stress (lift, backfill, lining). A group
            that is present is replaced: its old stress is released.
        change: group to material: the material changes, the stress stays (hardening of
            shotcrete, softening of rock).
        release: group to the part (0 to 1) of its stress that is released, for a group that leaves
            now or left before with part of it; the rest acts on until a later stage says more.
        distance: how far the section is behind the tunnel face, m, which says what the tunnel's
            groups release; None for a stage that does not say it.
        loads: name to load: acts from this stage until removed; a name used again replaces.
        remove: names of loads that end with this stage.
        build: names of structures that are built, free of stress or with their prestress.
        dismantle: names of structures that leave.
        prestress: structure to the force of each of its bars, N, to which it is brought at this
            stage and at which it is locked off; overrides that of building.
        water: water in the pores from this stage on; None: as before.
        drained: group of faces at which water leaves from this stage on; None for those that close.
        heat: group of faces or nodes to the heat that flows there from this stage on; None for
            those that become adiabatic.
        placed_at: group to its temperature, degC, of those that it places.
        temperature: group to change of temperature, counted from the initial state or from its
            placing, from this stage on.
        supports: supports that begin to hold at this stage, or move otherwise from it on; None for
            those that let go.
        relaxed: groups that lose the stress that they have had since the virgin state, or since
            their placing.
        independent: a load case on its own: nothing builds on it but stages that name it.
        base: name of the earlier stage on which this one builds; None: the last one before it
            that is not independent.
        lasts: how long the stage lasts, s; None: as long as all that takes time needs; 0: no time
            passes, and no water moves.
        over: the time in which all that it does comes evenly, s; 0: at its beginning.
        at: which moment of a stage that lasts this is, s since its beginning; None: its end.
        goes_on: a later moment of the stage before it, in which nothing else happens.
        moment_of: name of the stage that lasts of which it is a moment; None for an end.
    """

    name: str
    excavate: tuple[str, ...] = ()
    install: Mapping[str, str] = field(default_factory=dict)
    change: Mapping[str, str] = field(default_factory=dict)
    release: Mapping[str, Scalar] = field(default_factory=dict)
    distance: Scalar | None = None
    loads: Mapping[str, Load] = field(default_factory=dict)
    remove: tuple[str, ...] = ()
    build: tuple[str, ...] = ()
    dismantle: tuple[str, ...] = ()
    prestress: Mapping[str, Scalar] = field(default_factory=dict)
    water: Water | None = None
    drained: Mapping[str, Drained | None] = field(default_factory=dict)
    heat: Mapping[str, HeatFace | None] = field(default_factory=dict)
    placed_at: Mapping[str, Scalar] = field(default_factory=dict)
    temperature: Mapping[str, Temperature] = field(default_factory=dict)
    supports: Mapping[str, Support | None] = field(default_factory=dict)
    relaxed: tuple[str, ...] = ()
    independent: bool = False
    base: str | None = None
    lasts: float | None = None
    over: float = 0.0
    at: float | None = None
    goes_on: bool = False
    moment_of: str | None = None

    @property
    def whole(self) -> str:
        """Name of the stage of which it is the end, or a moment."""
        return self.moment_of or self.name


@dataclass(frozen=True)
class Rung:
    """A model of a ladder: the case with some changes.

    Args:
        name: what people call it.
        overrides: changes to the case, texts ``path=value``.
        origins: new parameter to those of simpler models from which it begins, the nearest first,
            with factors; None where it has none.
    """

    name: str
    overrides: tuple[str, ...] = ()
    origins: Mapping[str, tuple[tuple[str, float], ...]] | None = None


@dataclass(frozen=True)
class FitSettings:
    """How the parameters are identified.

    Args:
        methods: the chain of methods, each with its options, run one after the other.
        stages: names of the stages whose readings are used; None for all stages.
        predict_gauges: names of gauges, or of channels, whose readings are not used but predicted.
        until: the last time, s as `Case.times`, of the readings that are used; None for all.
        loss: how much a large residual counts.
        closed_form: the opening of a case without mesh, among the options of closed-form.
        model_error: how far the ground may differ from the model.
        backtest: whether the last fitted stage is predicted from those before it, too.
        mesh_error: whether the error of the mesh is estimated, and counts.
        reduced: whether a reduced model may be used.
        keep_reduced: whether a fit keeps one in its result.
        ladder: models that are fitted one after the other, from the simplest on; none for the one
            that the case describes.
    """

    methods: tuple[MethodOptions, ...]
    stages: tuple[str, ...] | None = None
    predict_gauges: tuple[str, ...] = ()
    until: float | None = None
    loss: LossOptions = field(default_factory=SquaredOptions)
    closed_form: ClosedFormOptions = field(default_factory=ClosedFormOptions)
    model_error: ModelErrorOptions = field(default_factory=ModelErrorOptions)
    backtest: bool = True
    mesh_error: bool = True
    reduced: bool = True
    keep_reduced: bool = False
    ladder: tuple[Rung, ...] = ()


@dataclass(frozen=True)
class Case:
    """One case.

    Args:
        title: free text.
        analysis: kind of analysis.
        mesh_file: path of the mesh, resolved against the folder of the case; None for a case that
            is computed in closed form.
        mesh_order: 2 where elements of first order get nodes on their edges.
        parameters: what is identified, in the order of the file.
        materials: by name.
        groups: element group to material name at stage 0, or None for absent.
        supports: what is held from the beginning.
        in_situ: in-situ stress, before the first stage, or None for none.
        gravity: (dim,) acceleration vector in m/s2, or None for none.
        loads: loads that act from the beginning, by name.
        stages: construction in its order.
        channels: one for every quantity that the gauges read.
        readings: what was read, in the order of the file.
        fit: how to identify.
        source: where the keys are written in the file.
        in_situ_of: element group to its own in-situ stress, where it differs.
        imbalance_accepted: a virgin state whose weight and stress do not agree is taken knowingly.
        water: water in the pores in the initial state, or None for none.
        dates: stage to the date of its end, seconds since 1970, where dates are given.
        notes: what is to be known of how the readings were understood.
        when_read: when the dated readings were taken, stage by stage; empty without dates.
        structures: linings, bolts, struts and anchors by name; stages build them.
        elsewhere: the program or function that gives the readings, in place of all ground; None
            for a case that geoident computes.
        face: how distances to the tunnel face become released stress, or None.
        decisions: what is to be done if a reading is beyond a value.
        service: what acts day by day from the last stage on, or None.
        drained: group of faces at which water leaves from the beginning.
        initial_temperature: of all ground before the first stage, degC; None for a case whose
            stages conduct no heat.
        heat: group of faces or nodes to the heat that flows there from the beginning.
        time_steps: steps in time of each length in stages that last; None for the usual number.
        interfaces: along which the mesh is split, by name.
        of_tests: the mesh is that of tests, of unit size: results have readings and no fields.
    """

    title: str
    analysis: Analysis
    mesh_file: str | None
    parameters: tuple[Parameter, ...]
    materials: Mapping[str, Material]
    groups: Mapping[str, str | None]
    supports: tuple[Support, ...]
    in_situ: InSitu | None
    gravity: tuple[float, ...] | None
    loads: Mapping[str, Load]
    stages: tuple[Stage, ...]
    channels: tuple[Channel, ...]
    readings: tuple[Reading, ...]
    fit: FitSettings
    source: Source = Source()
    in_situ_of: Mapping[str, InSitu] = field(default_factory=dict)
    water: Water | None = None
    dates: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    when_read: tuple[StageReadings, ...] = ()
    structures: Mapping[str, Structure] = field(default_factory=dict)
    imbalance_accepted: bool = False
    elsewhere: ExternalSource | None = None
    face: FaceProfile | None = None
    mesh_order: int = 1
    decisions: tuple[Decision, ...] = ()
    service: StructureInService | None = None
    drained: Mapping[str, Drained] = field(default_factory=dict)
    initial_temperature: Scalar | None = None
    heat: Mapping[str, HeatFace] = field(default_factory=dict)
    time_steps: int | None = None
    interfaces: Mapping[str, Interface] = field(default_factory=dict)
    of_tests: bool = False

    @property
    def in_time(self) -> SeasonalModel | StructureInService | None:
        """What acts on a structure in service day by day; None for a case of stages."""
        if isinstance(self.elsewhere, SeasonalModel):
            return self.elsewhere
        return self.service

    @property
    def yields(self) -> bool:
        """Whether any material or structure has yield limits."""
        return any(one.yields for part in self._limited.values() for one in part.values())

    @property
    def what_yields(self) -> tuple[str, ...]:
        """Which of ground, structures and interfaces have yield limits, or harden."""
        return tuple(
            name
            for name, part in self._limited.items()
            if any(one.yields for one in part.values()) or (name == "ground" and self.hardens)
        )

    @property
    def _limited(self) -> Mapping[str, Mapping[str, Material | Structure | Interface]]:
        return {
            "ground": self.materials,
            "structures": self.structures,
            "interfaces": self.interfaces,
        }

    @property
    def hardens(self) -> bool:
        """Whether any material is a hardening soil."""
        return any(material.soil is not None for material in self.materials.values())

    @property
    def consolidates(self) -> bool:
        """Whether water takes time to leave some ground, in stages that last, or flows steadily."""
        drained = [*self.drained.values(), *(d for s in self.stages for d in s.drained.values())]
        flows = any(one is not None and one.head is not None for one in drained)
        flows = flows or any(stage.lasts is not None for stage in self.stages)
        return flows and any(material.consolidates for material in self.materials.values())

    @property
    def conducts(self) -> bool:
        """Whether its ground conducts heat in stages that last."""
        return self.initial_temperature is not None and self.service is None

    @property
    def creeps(self) -> bool:
        """Whether any ground creeps or ages in its stages; in service that comes after them."""
        return self.service is None and bool(self._in_time)

    @property
    def ages(self) -> bool:
        """Whether the stiffness of anything grows with its age in its stages."""
        materials = any(one.ageing is not None for one in self.materials.values())
        return self.creeps and (materials or any(ages(one) for one in self.structures.values()))

    @cached_property
    def _in_time(self) -> tuple[str, ...]:
        """Materials and structures that creep or age, clauses."""
        materials, structures = self.materials.values(), self.structures
        return (
            *(f"{one.name} creeps" for one in materials if one.creep),
            *(f"{one.name} ages" for one in materials if one.ageing is not None),
            *(f"'{name}' ages" for name, one in structures.items() if ages(one)),
        )

    @property
    def in_steps(self) -> str | None:
        """Why its stages take steps in time, a clause; None where each is one equilibrium."""
        if self.creeps:
            return f"{self._in_time[0]}: a stage that lasts has many steps in time"
        if self.conducts:
            return "the ground conducts heat, in many steps in time where a stage lasts"
        if not self.consolidates:
            return None
        name = next(one.name for one in self.materials.values() if one.consolidates)
        return f"water flows in {name}, in many steps in time where a stage lasts"

    @property
    def stage_names(self) -> tuple[str, ...]:
        """Names of all stages, the initial state first."""
        return (VIRGIN, *(stage.name for stage in self.stages))

    @property
    def lasts(self) -> bool:
        """Whether any stage lasts, so that it may have moments."""
        return any(stage.lasts is not None for stage in self.stages)

    @cached_property
    def times(self) -> Mapping[str, float]:
        """State to when it is, s: since 1970 where the case has dates, else since its beginning.

        Without dates durations say it, and stages without one count as none; empty where no stage
        lasts either.
        """
        if self.dates or not self.lasts:
            return self.dates
        times, trunk = {VIRGIN: 0.0}, VIRGIN
        begun = dict[str, float]()
        for stage in self.stages:
            begin = begun[stage.whole] if stage.goes_on else times[stage.base or trunk]
            begun[stage.whole] = begin
            times[stage.name] = begin + (stage.at or 0.0)
            trunk = trunk if stage.independent else stage.name
        return times

    def reading_at(self, channel: Channel, stage: str) -> Reading:
        """What was read of a channel at a stage, several good readings taken together.

        Where none was, a reading without value, as accurate as the gauge states.
        """
        good = self._good_readings.get((channel.name, stage))
        return taken_together(channel, good) if good else Reading(channel.name, stage, None)

    @cached_property
    def _good_readings(self) -> Mapping[tuple[str, str], Sequence[Reading]]:
        """The readings of channels at stages that have a value and are not flagged as bad."""
        readings: dict[tuple[str, str], list[Reading]] = {}
        for reading in self.readings:
            if reading.value is not None and not reading.bad:
                readings.setdefault((reading.channel, reading.stage), []).append(reading)
        return readings

    @cached_property
    def accuracies(self) -> Floats:
        """(n_channels, n_stages) standard deviation of what is read of each channel, SI."""
        each = [[c.sd(self.reading_at(c, s.name)) for s in self.stages] for c in self.channels]
        return np.array(each, dtype=np.float64).reshape(len(self.channels), len(self.stages))

    @property
    def start(self) -> dict[str, float]:
        """Start values of the parameters by name, SI."""
        return {parameter.name: parameter.start for parameter in self.parameters}

    @property
    def fields(self) -> tuple[RandomField, ...]:
        """The constants of all materials that vary from place to place."""
        return tuple(each for material in self.materials.values() for each in material.fields)

    def unused_materials(self, parameter: str) -> tuple[str, ...]:
        """Materials that depend on a parameter and of which no ground ever is."""
        used = {*self.groups.values()}
        for stage in self.stages:
            used |= {*stage.install.values(), *stage.change.values()}
        return tuple(
            name
            for name, material in self.materials.items()
            if name not in used
            and any(parameter in scalar.parameters for scalar in material.scalars)
        )

    @property
    def growths(self) -> tuple[Growth, ...]:
        """The elastic constants of all materials that grow with depth or stress."""
        return tuple(each for material in self.materials.values() for each in material.growths)

    def zero_of(self, channel: Channel) -> int:
        """The state at which a channel reads zero; the virgin state is 0."""
        return self.stage_names.index(channel.zero)

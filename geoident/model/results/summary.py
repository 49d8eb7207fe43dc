"""What a case amounts to on its mesh, before anything is computed: for ``geoident check``.

What a mesh holds, in the numbers that help to write a case for it.

What planned gauges could tell, before any reading exists.
"""

from __future__ import annotations

from dataclasses import dataclass

from geoident.model.arrays import Floats
from geoident.model.gauges import StageReadings
from geoident.model.results.findings import Finding
from geoident.model.results.result import ParameterTable
from geoident.model.results.surface import SurfaceTable


@dataclass(frozen=True)
class GroupSummary:
    """An element group.

    Args:
        name: of the group.
        material: at stage 0; None: absent.
        elements: their number.
        volume: m3; of a unit thickness in plane strain, of the whole turn in a body of revolution.
    """

    name: str
    material: str | None
    elements: int
    volume: float


@dataclass(frozen=True)
class StageSummary:
    """A stage.

    Args:
        name: of the stage.
        leaves: groups that are excavated.
        enters: group to material for what is installed.
        changes: group to material for what changes.
        loads: names of loads that begin here.
        removed: names of loads that end here.
        dofs: unknowns of its system of equations.
        used: readings that take part in the fit.
        base: the stage on which it builds, where that is not the one before.
        warmed: groups whose temperature changes.
        water: whether the water in the pores changes.
        drained: groups of faces at which water begins to leave, or to another head.
        heated: groups of faces or nodes through which heat flows otherwise from then on.
        closed: groups of faces at which it no longer does.
        heads: pairs of a group of `drained` and the head of the water there, in words.
        built: names of structures that are built.
        dismantled: names of structures that are removed.
        stressed: names of structures whose bars are stressed anew.
        released: group to the part of its stress that is released by now, in words.
        supported: names of supports that begin to hold or move here.
        freed: names of supports that let go here.
        lasts: how long it lasts, s; None for a stage that takes no time.
        moments: at how many moments it is computed, its end among them; 0 where it does not last.
    """

    name: str
    leaves: tuple[str, ...]
    enters: tuple[tuple[str, str], ...]
    changes: tuple[tuple[str, str], ...]
    loads: tuple[str, ...]
    removed: tuple[str, ...]
    dofs: int
    used: int
    base: str | None = None
    warmed: tuple[str, ...] = ()
    water: bool = False
    drained: tuple[str, ...] = ()
    heated: tuple[str, ...] = ()
    closed: tuple[str, ...] = ()
    built: tuple[str, ...] = ()
    dismantled: tuple[str, ...] = ()
    stressed: tuple[str, ...] = ()
    released: tuple[tuple[str, str], ...] = ()
    supported: tuple[str, ...] = ()
    freed: tuple[str, ...] = ()
    lasts: float | None = None
    moments: int = 0
    heads: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class GaugeSummary:
    """A channel of a gauge.

    Args:
        name: of the channel.
        kind: of the gauge.
        zero: stage at whose end it reads zero; empty where it reads a value, not a change.
        accuracy: standard deviation of one reading, SI.
        used: how many readings take part in the fit.
        unused: how many do not.
        dimension: of its readings, a key of `geoident.units.DIMENSIONS`.
        unit: in which people want to see them.
        estimated: the accuracy is to be estimated, beginning with what stands here.
    """

    name: str
    kind: str
    zero: str
    accuracy: float
    used: int
    unused: int
    dimension: str = "length"
    unit: str = "mm"
    estimated: bool = False


@dataclass(frozen=True)
class PlaceSummary:
    """A point of gauges on the mesh.

    Args:
        channels: names of the channels that end there.
        point: coordinates, m.
        element: number of its element in the mesh file.
        group: of the element.
        distance: from the excavation, m; None if nothing is excavated.
    """

    channels: tuple[str, ...]
    point: tuple[float, ...]
    element: int
    group: str
    distance: float | None


@dataclass(frozen=True)
class ReadingSummary:
    """The readings at the end of a stage.

    Args:
        stage: its name.
        used: channels whose readings take part in the fit.
        unused: reason and the channels whose readings do not, for it.
        moments: at how many moments of a stage that lasts; 0 where it does not.
    """

    stage: str
    used: tuple[str, ...]
    unused: tuple[tuple[str, tuple[str, ...]], ...]
    moments: int = 0


@dataclass(frozen=True)
class CostEstimate:
    """What one evaluation of the model costs: all stages, with the derivatives.

    Args:
        solver: name of the sparse solver.
        factor_entries: of the largest factor, counted on its pattern.
        factor_flops: multiplications and additions of all factorizations, counted likewise.
        memory: estimate of the peak, bytes.
        seconds: estimate of the time.
        newton_steps: factorizations of a stage that were reckoned with; 1 where nothing yields.
        time_steps: steps in time of all stages that last.
        constant: part of the seconds that does not grow with the mesh.
        yielding: which of ``ground``, ``structures`` and ``interfaces`` yield.
    """

    solver: str
    factor_entries: int
    factor_flops: float
    memory: float
    seconds: float
    newton_steps: int = 1
    time_steps: int = 0
    constant: float = 0.0
    yielding: tuple[str, ...] = ()


@dataclass(frozen=True)
class CaseSummary:
    """A case that is ready to be computed.

    Args:
        case: its path as the user named it.
        title: of the case.
        analysis: kind of analysis as users write it.
        mesh: path of the mesh; empty for a closed form, which has no groups, places and cost.
        nodes, elements: their numbers.
        groups: the element groups.
        stages: of construction.
        gauges: the channels.
        places: where the points of the gauges stand.
        readings: which are used at which stage, and why the others are not.
        parameters: names of the unknowns.
        methods: names of the identifiers in their order.
        evaluations: about how often they evaluate the model, in words.
        used: number of readings that take part.
        unused: reason to number of readings that do not, for it.
        cost: estimate of what the computation needs, or None.
        notes: what else the user should know.
        when_read: when the dated readings were taken, stage by stage; empty without dates.
        resolved: the case as YAML, with overrides and defaults filled in.
        surface: response surfaces of a table of runs; None for none.
        limits: of interfaces whose strength is a part of that of a material: name, cohesion (Pa)
            and friction angle (rad) at the start values.
    """

    case: str
    title: str
    analysis: str
    mesh: str
    nodes: int
    elements: int
    groups: tuple[GroupSummary, ...]
    stages: tuple[StageSummary, ...]
    gauges: tuple[GaugeSummary, ...]
    places: tuple[PlaceSummary, ...]
    readings: tuple[ReadingSummary, ...]
    parameters: tuple[str, ...]
    methods: tuple[str, ...]
    used: int
    unused: tuple[tuple[str, int], ...]
    cost: CostEstimate | None
    notes: tuple[str, ...]
    when_read: tuple[StageReadings, ...] = ()
    resolved: str = ""
    evaluations: str = ""
    elsewhere: str = ""
    surface: SurfaceTable | None = None
    limits: tuple[tuple[str, float, float], ...] = ()


@dataclass(frozen=True)
class PartSummary:
    """A group of the mesh.

    Args:
        name: of the group.
        count: its elements, facets or nodes.
        low: (dim,) smallest coordinates, m.
        high: (dim,) largest coordinates, m.
        volume: of a group of elements, m3 (of a unit thickness in plane strain); else None.
        sides: the axis along which it has nodes at both ends of the mesh and none between; None
            where there is none.
    """

    name: str
    count: int
    low: tuple[float, ...]
    high: tuple[float, ...]
    volume: float | None = None
    sides: int | None = None

    @property
    def plane(self) -> int | None:
        """The axis along which the group has no extent, such as an edge of the model."""
        extent = [high - low for low, high in zip(self.low, self.high, strict=True)]
        flat = [axis for axis, size in enumerate(extent) if size <= 1e-9 * max(extent)]
        return flat[0] if len(flat) == 1 else None


@dataclass(frozen=True)
class MeshSummary:
    """A mesh.

    Args:
        file: its path.
        nodes: number of nodes.
        kinds: kind to number of its elements.
        low: (dim,) smallest coordinates, m.
        high: (dim,) largest coordinates, m.
        groups: of elements.
        facet_groups: of lines (in the plane) or surfaces.
        node_groups: of nodes.
        ungrouped: number of elements that are in no group.
        shared: number of elements that are in several groups.
        inside: two points (dim,) well inside, m.
        suspicion: why its coordinates may be no metres; empty where they may well be.
    """

    file: str
    nodes: int
    kinds: tuple[tuple[str, int], ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    groups: tuple[PartSummary, ...]
    facet_groups: tuple[PartSummary, ...]
    node_groups: tuple[PartSummary, ...]
    ungrouped: int
    shared: int
    inside: tuple[tuple[float, ...], ...]
    suspicion: str = ""

    @property
    def dim(self) -> int:
        """Number of space dimensions."""
        return len(self.low)

    @property
    def elements(self) -> int:
        """Number of elements."""
        return sum(number for _, number in self.kinds)


@dataclass(frozen=True)
class Identifiability:
    """What the planned readings could determine.

    Args:
        parameters: the parameters at their start values, with the intervals to expect.
        findings: what would stay undetermined.
        singular_values: (min(g, n),) of the scaled sensitivities of the readings.
        readings: number g of planned readings: all channels at all stages of the fit.
        read: the case has readings already.
        listed: the planned readings are those of the list of the case, at their dates.
    """

    parameters: ParameterTable
    findings: tuple[Finding, ...]
    singular_values: Floats
    readings: int
    read: bool = True
    listed: bool = False

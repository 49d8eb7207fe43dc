"""What a case amounts to on its mesh, before anything is computed: for ``geoident check``."""

from __future__ import annotations

from dataclasses import dataclass


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


@dataclass(frozen=True)
class GaugeSummary:
    """A channel of a gauge: its kind, where it is zeroed, and how many readings are used."""

    name: str
    kind: str
    zero: str
    accuracy: float
    used: int
    unused: int


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
    """

    stage: str
    used: tuple[str, ...]
    unused: tuple[tuple[str, tuple[str, ...]], ...]


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
    """

    solver: str
    factor_entries: int
    factor_flops: float
    memory: float
    seconds: float
    newton_steps: int = 1


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
        used: number of readings that take part.
        unused: reason to number of readings that do not, for it.
        cost: estimate of what the computation needs, or None.
        notes: what else the user should know.
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

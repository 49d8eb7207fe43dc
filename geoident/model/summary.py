"""What a case amounts to on its mesh, before anything is computed: for ``geoident check``."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class GroupSummary:
    """An element group: its material at stage 0 (None: absent) and its number of elements."""

    name: str
    material: str | None
    elements: int


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
class CaseSummary:
    """A case that is ready to be computed.

    Args:
        case: its path as the user named it.
        title: of the case.
        analysis: kind of analysis as users write it.
        mesh: path of the mesh.
        nodes, elements: their numbers.
        groups: the element groups.
        stages: of construction.
        gauges: the channels.
        parameters: names of the unknowns.
        methods: names of the identifiers in their order.
        used: number of readings that take part.
        unused: reason to number of readings that do not, for it.
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
    parameters: tuple[str, ...]
    methods: tuple[str, ...]
    used: int
    unused: tuple[tuple[str, int], ...]
    notes: tuple[str, ...]

"""What a mesh holds, in the numbers that help to write a case for it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PartSummary:
    """A group of the mesh.

    Args:
        name: of the group.
        count: its elements, facets or nodes.
        low: (dim,) smallest coordinates, m.
        high: (dim,) largest coordinates, m.
        volume: of a group of elements, m3 (of a unit thickness in plane strain); else None.
    """

    name: str
    count: int
    low: tuple[float, ...]
    high: tuple[float, ...]
    volume: float | None = None

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

    @property
    def dim(self) -> int:
        """Number of space dimensions."""
        return len(self.low)

    @property
    def elements(self) -> int:
        """Number of elements."""
        return sum(number for _, number in self.kinds)

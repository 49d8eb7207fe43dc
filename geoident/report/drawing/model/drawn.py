"""A case on its mesh with what its pictures share: colours, loads, windows, legends."""

from __future__ import annotations

from collections.abc import Collection
from functools import cached_property
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.patches import Patch

from geoident.model.arrays import Floats, Ints
from geoident.model.case import Analysis, Case
from geoident.model.mesh import Mesh, element_centres
from geoident.model.parameter import Values
from geoident.model.results.result import ParameterTable
from geoident.report.drawing.model.actions import ShownLoad, shown_loads
from geoident.report.drawing.model.construction import (
    Colour,
    construction_of,
    material_colours,
    material_label,
    values_of,
)
from geoident.report.drawing.sheets import SheetMaker
from geoident.report.drawing.space import Box
from geoident.report.drawing.structures import structure_lines
from geoident.report.drawing.style import key, short

_CLOSER = 0.45  # part of the model that the gauges take at most where they are drawn closer
_PALE = 0.62  # how far the colour of what is excavated goes towards white
_EDGE = (0.25, 0.25, 0.25)
_MOST_STAGES = 16
_WIDEST = 32  # of a label in a legend, letters
_SLIMMEST = np.array([0.6, 0.3, 0.0])  # least sides of a window, of the largest one


class DrawnModel:
    """A case on its mesh, with what its pictures share.

    Args:
        case: the case.
        mesh: its mesh.
        identified: identified values, None before a fit.
        marked: names of gauges in another colour.
    """

    def __init__(
        self,
        case: Case,
        mesh: Mesh,
        identified: ParameterTable | None = None,
        marked: Collection[str] = (),
    ) -> None:
        self.case = case
        self.marked = marked
        self.mesh = mesh
        self.identified = identified
        self.values: Values = values_of(case.parameters, identified)
        self.made = construction_of(case, mesh)
        self.maker = SheetMaker(mesh)

    @cached_property
    def colours(self) -> dict[str, Colour]:
        """Material to colour."""
        return material_colours(self.case)

    @cached_property
    def element_colours(self) -> Floats:
        """(n_elements, 3) the colour of each element; pale where it is excavated in the end."""
        table = np.array([*self.colours.values(), (1.0, 1.0, 1.0)])
        colour = table[self.made.material]
        dug = self.made.dug > 0
        colour[dug] += _PALE * (1.0 - colour[dug])
        return np.asarray(colour)

    @cached_property
    def zones(self) -> Ints:
        """(n_elements,) a number for what is drawn alike and moves together."""
        stages = len(self.case.stages) + 1
        zone = (self.made.material + 1) * stages**2 + self.made.dug * stages + self.made.placed
        return np.asarray(zone)

    @cached_property
    def loads(self) -> tuple[ShownLoad, ...]:
        """The loads, those of one name and place together."""
        return shown_loads(self.case, self.mesh, self.made, self.values)

    @cached_property
    def gauges(self) -> dict[str, list[Floats]]:
        """Lines (2, dim) or points (1, dim), m, of each gauge."""
        lines: dict[str, list[Floats]] = {}
        for channel in self.case.channels:
            ends = [point for point in (channel.first, channel.second) if point is not None]
            lines.setdefault(channel.gauge, []).append(np.array(ends, dtype=np.float64))
        return lines

    @property
    def gauge_points(self) -> Floats:
        """(k, dim) points of all gauges, m."""
        lines = [line for lines in self.gauges.values() for line in lines]
        return np.vstack([np.empty((0, self.mesh.dim)), *lines])

    @cached_property
    def box(self) -> Box:
        """Lower and upper corner of the mesh, m."""
        return self.mesh.points.min(axis=0), self.mesh.points.max(axis=0)

    @cached_property
    def near(self) -> Box:
        """The box around gauges, structures and all that moves, with a margin, in the mesh, m."""
        points = [self.gauge_points] if self.gauges else []
        for structure in self.case.structures.values():
            points += structure_lines(structure, self.mesh)
        if self.made.moved.any():
            points.append(element_centres(self.mesh)[self.made.moved])
        low, high = self.box
        if not points:
            return low, high
        inner = np.vstack(points)
        margin = 0.15 * float(np.ptp(inner, axis=0).max()) + 1e-9
        margin = max(margin, 0.02 * float((high - low).max()))
        first, last = inner.min(axis=0) - margin, inner.max(axis=0) + margin
        if self.case.analysis is Analysis.AXISYMMETRIC:
            low = np.array([min(low[0], first[0]), low[1]])  # beyond the axis is room for names
        for part in (0.5, 1.0):  # at first on both sides, then where there is room
            least = _SLIMMEST[: len(low)] * float((last - first).max())
            lack = part * np.maximum(least - (last - first), 0.0)
            first, last = np.maximum(low, first - lack), np.minimum(high, last + lack)
        return first, last

    @cached_property
    def has_closer(self) -> bool:
        """Whether the gauges take so little of the model that they are drawn by themselves."""
        part = np.prod(self.near[1] - self.near[0]) / np.prod(self.box[1] - self.box[0])
        return bool(part < _CLOSER)

    @property
    def axis_names(self) -> tuple[str, str, str]:
        """What the coordinates are called."""
        turned = self.case.analysis is Analysis.AXISYMMETRIC
        return ("radius r", "height y", "") if turned else ("x", "y", "z")

    def legend(self) -> list[Any]:
        """Materials, with what was found of them; what is excavated; gauges; stages come apart."""
        drawn = set(np.unique(self.made.material))
        handles: list[Any] = [
            Patch(
                facecolor=self.colours[name],
                edgecolor=_EDGE,
                lw=0.5,
                label=_wrapped(material_label(material, self.case.parameters, self.identified)),
            )
            for k, (name, material) in enumerate(self.case.materials.items())
            if k in drawn
        ]
        if (self.made.dug > 0).any():
            pale = np.array([0.7, 0.7, 0.7]) * (1 - _PALE) + _PALE
            style: dict[str, Any] = {"facecolor": pale, "edgecolor": "black", "lw": 1.0}
            handles.append(Patch(label="n: excavated in stage n", **style))
        if (self.made.placed > 0).any():
            handles.append(key("+n: placed in stage n", color="none"))
        return handles

    def stage_keys(self) -> list[Any]:
        """The numbers of the stages with their names."""
        names = self.case.stage_names[1:]
        words = [f"{n}  {short(name, 26)}" for n, name in enumerate(names, start=1)]
        if len(names) > _MOST_STAGES:
            words[_MOST_STAGES - 2 : -1] = ["..."]
        return [key(text, color="none") for text in words]


def _wrapped(label: str) -> str:
    """A label of a legend on two lines at most, as wide as there is room."""
    lines = wrap(label, _WIDEST, subsequent_indent="  ")
    return "\n".join([*lines[:1], *(short(line, _WIDEST) for line in lines[1:2])])

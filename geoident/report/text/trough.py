"""Settlement troughs over tunnels: largest settlement, width, volume, volume loss.

A trough is that of the ground surface of a plane model, as far as that is free and nothing is
excavated from it, or that of gauges on a line. Its width i is the distance from its middle to its
steepest place, from the Gauss curve that meets it best (Peck 1969; theory 2.10),

    s(x) = s_max exp(-(x - x_0)^2 / (2 i^2)) ,      V = sqrt(2 pi) i s_max .

The volume of a surface is the integral of its settlement; that of gauges is that of their curve.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from geoident.fem.faces import face_table
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.cells import CELLS
from geoident.model.mesh import ElementBlock, element_centres, nodes_in
from geoident.model.results.columns import Record, column
from geoident.model.results.result import FieldSeries, Result
from geoident.report.text.instruments import TROUGH, Instrument, lines
from geoident.report.text.layout import TextTable, decimals, number

NAME = "Settlement troughs"
_WIDTH_NOTE = (
    "i: distance from the middle of the trough to its steepest place, by the Gauss curve "
    "s = s_max exp(-x2 / 2 i2) that meets the settlements best. There is none where it explains "
    "less than {:.0f} % of their scatter, or where they are not known as far as {:g} i on both "
    "sides."
)
_LOSS_NOTE = "Volume loss: volume of the trough by the area of what is excavated."
SURFACE = "ground surface"
_EXPLAINED = 0.9
"""Part of the scatter of the settlements that a Gauss curve must explain to have a width."""

_COVERED = 1.5
"""Distance from the middle, in i, as far as settlements must be known."""

_LEAST_POINTS = 4
_MOST_STAGES = 6
_FLAT = 1e-6
_LOADED = 4.0
"""Stress under the top by that of the ground above: more means that ground is left out there."""

_MM = 1e3


class Trough(Record):
    """One trough at one stage; NaN where something is not known.

    Args:
        line: what settles: `SURFACE`, or the names of the first and last gauge.
        stage: name of the stage.
        of: ``computed``, ``predicted`` or ``measured``.
        settlement: the largest, m, downwards.
        at: where that is along the line, m.
        i: width, m.
        volume: per metre of tunnel, m2; of both halves of a symmetric model.
        volume_loss: volume by the area of what is excavated.
    """

    line: str
    stage: str
    of: str
    settlement: float = column(dimension="length", shown="m")
    at: float = column(dimension="length", shown="m")
    i: float = column(dimension="length", shown="m")
    volume: float = column(dimension="area", shown="m2")
    volume_loss: float


def troughs(result: Result) -> list[Trough]:
    """All troughs: that of the ground surface of the model, then those of gauges."""
    if result.plan is not None:  # of gauges, not of the ground
        return []
    tunnel = None if result.fields is None else _Tunnel.of(result.fields)
    rows = [] if tunnel is None else list(_of_surface(result, tunnel))
    for line in lines(result):
        if line.line == TROUGH:
            rows += _of_gauges(result, line, tunnel)
    return rows


def trough_table(result: Result) -> TextTable:
    """The troughs; of many stages some, always the last."""
    every = troughs(result)
    stages = [s for s in result.gauges.stages if any(one.stage == s for one in every)]
    step = np.linspace(0, len(stages) - 1, min(len(stages), _MOST_STAGES)).round().astype(int)
    kept = {stages[k] for k in step}
    rows = [
        [
            one.line, one.stage, one.of, decimals(_MM * one.settlement, 1), number(one.at, 3),
            number(one.i, 3), number(one.volume, 3),
            "-" if math.isnan(one.volume_loss) else f"{decimals(100.0 * one.volume_loss, 2)} %",
        ]
        for one in every
        if one.stage in kept
    ]  # fmt: skip
    header = ("of", "stage", "", "largest (mm)", "at (m)", "i (m)", "volume (m3/m)", "volume loss")
    return TextTable(header, rows, right="lllrrrrr")


def trough_sentence(result: Result) -> str:
    """The settlement and the volume loss after the last stage; empty where there is no trough."""
    every = troughs(result)
    if not every:
        return ""
    first = [one for one in every if one.line == every[0].line and one.of != "measured"]
    last = (first or every)[-1]
    of = "the ground surface" if last.line == SURFACE else last.line
    text = f"The largest settlement of {of} is {decimals(_MM * last.settlement, 1)} mm"
    text += f" ({last.of}, {last.stage})"
    if math.isfinite(last.volume_loss):
        text += f", the volume loss {decimals(100.0 * last.volume_loss, 2)} %"
    return f"{text}."


def trough_note(table: TextTable) -> str:
    """What the columns mean that have anything in a table of troughs."""
    notes = {"i (m)": _WIDTH_NOTE.format(100.0 * _EXPLAINED, _COVERED), "volume loss": _LOSS_NOTE}
    return " ".join(notes[name] for name in table.filled.header if name in notes)


def _of_surface(result: Result, tunnel: _Tunnel) -> Iterator[Trough]:
    fields = result.fields
    last = np.flatnonzero(result.gauges.used.any(axis=0))
    shown = _shown_stages(result)
    for state in tunnel.states:
        assert fields is not None
        if not shown[state - 1]:
            continue
        settled = fields.displacement[0, :, 1] - fields.displacement[state, :, 1]
        if not np.isfinite(settled).all() or not tunnel.area(state) > 0.0:
            continue
        x, s = tunnel.along(settled)
        predicted = last.size and state - 1 > last[-1]
        row = _trough(SURFACE, result.gauges.stages[state - 1], x, s, tunnel.middle)
        volume = tunnel.parts * float(np.trapezoid(s, x))
        of = "predicted" if predicted else "computed"
        yield replace(row, of=of, volume=volume, volume_loss=volume / tunnel.area(state))


def _of_gauges(result: Result, line: Instrument, tunnel: _Tunnel | None) -> Iterator[Trough]:
    gauges, rows, x = result.gauges, list(line.rows), np.array(line.places)
    predicted = None if result.prediction is None else result.prediction.mean
    middle = math.nan if tunnel is None or not line.along.startswith("x") else tunnel.middle
    shown = _shown_stages(result)
    for j, stage in enumerate(gauges.stages):
        if not shown[j]:
            continue
        computed, of = gauges.computed[rows, j], "computed"
        if predicted is not None and np.isfinite(predicted[rows, j]).any():
            computed, of = predicted[rows, j], "predicted"
        area = _area(result, tunnel, j + 1)
        for values, source in ((computed, of), (gauges.measured[rows, j], "measured")):
            known = np.isfinite(values)
            if not np.any(np.abs(values[known]) > 0.0):
                continue
            one = replace(_trough(line.name, stage, x[known], values[known], middle), of=source)
            if area == 0.0:  # what settles is over no tunnel
                yield replace(one, i=math.nan, volume=math.nan)
            else:
                yield replace(one, volume_loss=one.volume / area)


def _shown_stages(result: Result) -> Bools:
    """(n_stages,) the ends of stages, and the last moment that was fitted."""
    shown = result.gauges.ends.copy()
    shown[np.flatnonzero(result.gauges.used.any(axis=0))[-1:]] = True
    return shown


def _area(result: Result, tunnel: _Tunnel | None, state: int) -> float:
    """Area of what is excavated below the ground, m2; 0 for none, NaN where nobody knows."""
    if tunnel is not None:
        return tunnel.area(state) if state in tunnel.states else 0.0
    if result.reaction is not None:
        return math.pi * result.reaction.radius**2
    return 0.0 if result.fields is not None and result.fields.mesh.dim == 2 else math.nan


def _trough(line: str, stage: str, x: Floats, s: Floats, middle: float) -> Trough:
    """A trough with the Gauss curve through settlements (k,), m, at places (k,), m.

    Args:
        line: what settles.
        stage: when.
        x: the places.
        s: the settlements.
        middle: where its middle is known to be; NaN for to be found.
    """
    from scipy.optimize import least_squares  # noqa: PLC0415 - 0.3 s, and most cases have no trough

    k = int(np.argmax(s))
    row = Trough(line, stage, "", float(s[k]), float(x[k]), math.nan, math.nan, math.nan)
    if len(x) < _LEAST_POINTS or not s[k] > 0.0:
        return row
    size, length = float(s[k]), float(np.ptp(x))

    def residual(q: Floats) -> Floats:
        at = middle if math.isfinite(middle) else x[k] + length * q[2]
        return np.asarray(q[0] * np.exp(-0.5 * ((x - at) / (length * q[1])) ** 2) - s / size)

    start = np.array([1.0, 0.25] if math.isfinite(middle) else [1.0, 0.25, 0.0])
    met = least_squares(residual, start, x_scale=0.1)
    left = float(np.sum(met.fun**2)) * size**2
    i, top = abs(float(met.x[1])) * length, float(met.x[0]) * size
    at = middle if math.isfinite(middle) else float(x[k]) + length * float(met.x[2])
    sides = (x.max() - at, at - x.min())
    covered = max(sides) if math.isfinite(middle) else min(sides)
    explained = left <= (1.0 - _EXPLAINED) * float(np.sum((s - s.mean()) ** 2))
    if not (met.success and explained and _COVERED * i <= covered):
        return row
    return replace(row, i=i, volume=math.sqrt(2.0 * math.pi) * i * top)


@dataclass(frozen=True)
class _Tunnel:
    """A plane model in which something is excavated below a free ground surface.

    Args:
        fields: of the model.
        nodes: (k,) corners of the surface, from left to right.
        middle: place x of a plane of symmetry through what is excavated, m; NaN for none.
        states: after whose stage the whole surface is there, free, and something is excavated.
    """

    fields: FieldSeries
    nodes: Ints
    middle: float
    states: tuple[int, ...]

    @classmethod
    def of(cls, fields: FieldSeries) -> _Tunnel | None:
        """What a model shows; None where there is no such surface, or nothing is excavated."""
        mesh = fields.mesh
        if mesh.dim != 2 or len(fields.displacement) < 2:
            return None
        table, points = face_table(mesh), mesh.points
        faces = [
            (nodes[:, :2], table.element[at], at)
            for _, _, at, nodes in table.by_place(mesh, table.free(fields.present[0]))
        ]
        ends, elements, rows = (np.concatenate(part) for part in zip(*faces, strict=True))
        top = _upward(points[ends], element_centres(mesh)[elements])
        ends, elements, rows = ends[top], elements[top], rows[top]
        if not len(ends) or not _is_free(fields, points[ends], elements):
            return None
        gone = fields.present[0] & ~fields.present
        states = tuple(
            state
            for state in range(1, len(fields.present))
            if gone[: state + 1].any() and np.isin(rows, table.free(fields.present[state])).all()
        )
        if not states:
            return None
        nodes = np.unique(ends)
        nodes = nodes[np.argsort(points[nodes, 0], kind="stable")]
        return cls(fields, nodes, _symmetry(fields, gone.any(axis=0)), states)

    @property
    def parts(self) -> int:
        """1; 2 where the model is half of what it stands for."""
        return 2 if math.isfinite(self.middle) else 1

    @cached_property
    def _areas(self) -> Floats:
        """(n_elements,) m2."""
        mesh = self.fields.mesh
        return np.concatenate([_areas_within(mesh.points, block) for block in mesh.blocks])

    def area(self, state: int) -> float:
        """Area of all that has been excavated until a state, m2; both halves."""
        gone = (self.fields.present[0] & ~self.fields.present[: state + 1]).any(axis=0)
        return self.parts * float(self._areas[gone].sum())

    def along(self, values: Floats) -> tuple[Floats, Floats]:
        """Places x (k,), m, of the surface, and what nodes (n_nodes,) have there."""
        return self.fields.mesh.points[self.nodes, 0], values[self.nodes]


def _areas_within(points: Floats, block: ElementBlock) -> Floats:
    """(n,) areas of plane elements, m2, whose edges may be parabolas through three nodes."""
    k = CELLS[block.kind].n_corners
    corners, middles = points[block.nodes[:, :k]], points[block.nodes[:, k:]]
    areas = _polygon_areas(corners)
    if CELLS[block.kind].edges:  # a parabola cuts off 4/3 of the triangle of its three nodes
        around = np.stack([corners, middles], axis=2).reshape(len(corners), -1, 2)
        areas = areas + 4.0 / 3.0 * (_polygon_areas(around) - areas)
    return np.abs(areas)


def _polygon_areas(corners: Floats) -> Floats:
    """(n,) signed areas of polygons (n, k, 2)."""
    x, y = np.moveaxis(corners, -1, 0)
    return np.asarray(0.5 * (x * np.roll(y, -1, 1) - y * np.roll(x, -1, 1)).sum(axis=1))


def _upward(ends: Floats, behind: Floats) -> Bools:
    """Which outer faces are the top of the ground: level rather than steep, with nothing above.

    Args:
        ends: (n, 2, 2) of the faces, m.
        behind: (n, 2) centres of the elements behind them.
    """
    middle = ends.mean(axis=1)
    level = np.abs(ends[:, 1, 0] - ends[:, 0, 0]) > np.abs(ends[:, 1, 1] - ends[:, 0, 1])
    up = level & (middle[:, 1] > behind[:, 1])
    low, high = ends[up, :, 0].min(axis=1), ends[up, :, 0].max(axis=1)
    over = (low < middle[:, None, 0]) & (middle[:, None, 0] < high)
    covered = (over & (middle[up, 1] > middle[:, None, 1] + 1e-9)).any(axis=1)
    return np.asarray(up & ~covered)


def _is_free(fields: FieldSeries, ends: Floats, elements: Ints) -> bool:
    """Whether the top bears no ground that is left out: its vertical stress goes to zero.

    In an element it is that of the ground over its centre, if nothing lies on the top.

    Args:
        fields: of the model.
        ends: (n, 2, 2) of the faces of the top, m.
        elements: (n,) behind them.
    """
    centres, stress = element_centres(fields.mesh), -fields.stress[0, :, 1]
    depth = float(ends[..., 1].max()) - centres[:, 1]
    known = np.isfinite(stress)
    if not known.any() or not stress[known].max() > 0.0:
        return False
    unit_weight = float(stress[known].max() / depth[known].max())
    cover = ends.mean(axis=1)[:, 1] - centres[elements, 1]
    return bool(np.nanmedian(stress[elements] / (unit_weight * cover)) < _LOADED)


def _symmetry(fields: FieldSeries, gone: Bools) -> float:
    """Place x of the side of the model that an excavation touches, m; NaN for none or both."""
    mesh = fields.mesh
    x = mesh.points[nodes_in(mesh.blocks, gone), 0]
    low, high = float(mesh.points[:, 0].min()), float(mesh.points[:, 0].max())
    near = _FLAT * (high - low)
    left, right = x.min() <= low + near, x.max() >= high - near
    return math.nan if left == right else low if left else high

"""Pictures of a result by matplotlib, as files.

Made for print and for colour-blind readers: one hue, light to dark, for magnitudes; measured as
dots, computed as lines, predicted as lines in a band.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.tri import Triangulation

from geoident.fem.elements import reference_element
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.mesh import Mesh
from geoident.model.result import FieldSeries, Result

_PANELS = 6
_MM = 1e3
_DATES = {"svg": "Date", "pdf": "CreationDate", "png": "Creation Time"}


def overview_figure(result: Result) -> Figure:
    """The displacements of the last stage that was fitted, and the gauges that moved most.

    A three-dimensional result has the gauges only.
    """
    figure = Figure(figsize=(11, 5.6), layout="constrained")
    rows = _busiest(result)
    fields = result.fields if result.fields is not None and result.fields.mesh.dim == 2 else None
    gauge_part: Figure | SubFigure = figure
    if fields is not None:
        parts = figure.subfigures(1, 2, width_ratios=[1, 1.35], squeeze=False)
        draw_displacement(parts[0, 0].subplots(), result, fields)
        gauge_part = parts[0, 1]
    panels = gauge_part.subplots(-(-len(rows) // 2), 2, sharex=True, squeeze=False)
    for axes, row in zip(panels.ravel(), rows, strict=False):
        draw_gauge(axes, result, row)
    for axes in panels.ravel()[len(rows) :]:
        axes.set_visible(False)
    if rows:
        panels.ravel()[0].legend(fontsize=7, loc="best", framealpha=0.8)
    return figure


def save_figures(result: Result, paths: Mapping[str, str], *, suffix: str) -> None:
    """Save figures of a result; the same result gives the same bytes.

    Args:
        result: what to draw.
        paths: name of a figure (of `FIGURES`) to the file to write.
        suffix: the format, ``svg``, ``png`` or ``pdf``.
    """
    with rc_context({"svg.hashsalt": "geoident", "svg.fonttype": "path"}):
        for name, path in paths.items():
            FIGURES[name](result).savefig(
                path, format=suffix, dpi=110, metadata={_DATES[suffix]: None}
            )


def draw_gauge(axes: Axes, result: Result, row: int) -> None:
    """Measured and computed readings of a channel over the stages, the predicted ones in a band."""
    table = result.gauges
    x = np.arange(len(table.stages))
    computed = _MM * table.computed[row]
    last_fitted = int(np.flatnonzero(table.used.any(axis=0)).max(initial=-1))
    fitted, later = x <= last_fitted, x >= last_fitted
    axes.plot(x[fitted], computed[fitted], "-", color="#1f4e79", lw=1.4, label="computed")
    axes.plot(x[later], computed[later], "--", color="#1f4e79", lw=1.4, label="predicted")
    if result.prediction is not None:
        low, high = _MM * result.prediction.lower95[row], _MM * result.prediction.upper95[row]
        known = np.isfinite(low)
        axes.fill_between(x[known], low[known], high[known], color="#9ecae1", alpha=0.6, lw=0,
                          label="95 % band")  # fmt: skip
    error = 1.96 * _MM * table.sd[row]
    axes.errorbar(x, _MM * table.measured[row], yerr=error, fmt="o", ms=3.2, lw=0.8,
                  color="#d95f02", label="measured")  # fmt: skip
    axes.set_title(table.channels[row], fontsize=9, loc="left")
    axes.set_ylabel("mm", fontsize=8)
    axes.set_xticks(x, table.stages, rotation=60, fontsize=7)
    axes.tick_params(axis="y", labelsize=7)
    axes.grid(alpha=0.3, lw=0.5)


def draw_displacement(axes: Axes, result: Result, fields: FieldSeries) -> None:
    """Size of the displacement at the last fitted stage around the gauges, in the plane."""
    state = 1 + int(np.flatnonzero(result.gauges.used.any(axis=0)).max(initial=-1))
    size = _MM * np.linalg.norm(fields.displacement[state], axis=1)
    x, y = fields.mesh.points.T
    ground = Triangulation(x, y, _triangles(fields.mesh, fields.present[state]))
    shading = axes.tripcolor(ground, size, shading="gouraud", cmap="Blues", rasterized=True)
    bar = axes.figure.colorbar(shading, ax=axes, shrink=0.75, location="bottom")
    bar.set_label("displacement (mm)", fontsize=8)
    bar.ax.tick_params(labelsize=7)
    for first, second in zip(result.gauges.first, result.gauges.second, strict=True):
        ends = np.array([e for e in (first, second) if np.all(np.isfinite(e))])
        axes.plot(ends[:, 0], ends[:, 1], "-o", color="#d95f02", lw=0.7, ms=2)
    axes.set_title(f"after {result.gauges.stages[state - 1]}" if state else "virgin", fontsize=9)
    axes.set_aspect("equal")
    low, high = _window(result)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_xlabel("x (m)", fontsize=8)
    axes.set_ylabel("y (m)", fontsize=8)
    axes.tick_params(labelsize=7)


def _busiest(result: Result) -> list[int]:
    """Rows of the channels that moved most for their accuracy, one of each gauge."""
    moved = np.abs(np.nan_to_num(result.gauges.computed)) / np.nan_to_num(result.gauges.sd, nan=1.0)
    gauges: dict[str, int] = {}
    for row in np.argsort(-moved.max(axis=1, initial=0.0), kind="stable"):
        gauges.setdefault(result.gauges.channels[row].split(".")[0], int(row))
    return list(gauges.values())[:_PANELS]


def _window(result: Result) -> tuple[Floats, Floats]:
    """The part of the plane that holds the gauges, with a margin."""
    ends = np.vstack([result.gauges.first, result.gauges.second])
    ends = ends[np.all(np.isfinite(ends), axis=1)]
    low, high = ends.min(axis=0), ends.max(axis=0)
    margin = 0.35 * float((high - low).max()) + 1e-9
    return low - margin, high + margin


def _triangles(mesh: Mesh, present: Bools) -> Ints:
    """(n, 3) triangles between the corners of the present elements."""
    parts, first = [], 0
    for block in mesh.blocks:
        n_corners = reference_element(block.kind).n_corners
        nodes = block.nodes[present[first : first + len(block)]]
        for k in range(1, n_corners - 1):
            parts.append(nodes[:, [0, k, k + 1]])
        first += len(block)
    return np.vstack(parts)


FIGURES: Mapping[str, Callable[[Result], Figure]] = {"overview": overview_figure}
"""Every figure by its name."""

"""Scans of the misfit, on the scales of the parameters, with the regions that they leave.

Between the points of the grid the misfit is interpolated by quintic splines on the scales of the
parameters, on which it is nearly a square of what the readings see. A valley narrower than the
grid, as that of a modulus and the stress over it, so stays one valley: drawn from the points alone
it falls into islands around those that happen to lie near its floor.
"""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter
from scipy.sparse import csr_array, identity, vstack
from scipy.sparse.linalg import spsolve
from scipy.special import chdtri

from geoident.model.arrays import Bools, Floats
from geoident.model.results.result import Grid, ParameterTable, Result
from geoident.report.drawing.fields.panels import bands
from geoident.report.drawing.parameters.scale import (
    logarithmic,
    scaled,
    set_scale,
    unscaled,
    with_unit,
)
from geoident.report.drawing.style import (
    ACCENT,
    COMPUTED,
    FAINT,
    LENGTHS,
    SMALL,
    WIDTH,
    Picture,
    key,
)
from geoident.report.text.layout import number
from geoident.report.text.parameters import unit_of
from geoident.units import in_unit

if TYPE_CHECKING:
    from scipy.interpolate import RectBivariateSpline

SHARES = (0.68, 0.95)
"""Of the probability in a region."""

_DEGREE = 5
_PROFILE_TOP = 9.0
"""Up to which increase of the misfit profiles are shown."""


def scan_pictures(result: Result) -> tuple[Picture, ...]:
    """The misfit over its grid, if the result is that of a scan."""
    grid = result.grid
    if grid is None or not np.isfinite(grid.objective).any():
        return ()
    others = len(result.parameters.names) - len(grid.names)
    fixed = " All other parameters keep their start values." if others else ""
    if len(grid.names) == 1:
        words = (
            "Left: the whole scan; right: around its lowest place. Horizontal: rise of the misfit "
            "at the ends of the intervals of 68 and 95 %, as a normal parameter would have them."
        )
    else:
        words = (
            "Left: the whole scan. Right: the regions of 68 and 95 % of the probability, as two "
            "normal parameters would have them; above and beside them the rise of the misfit over "
            "its least value for each value of one parameter, the other at its best, with the "
            "limits of one parameter. Star: lowest point of the grid."
        )
    return (
        Picture(
            "scan",
            "Misfit over the parameters",
            f"Weighted squares, priors included; blank where the model has no solution. {words}"
            f"{fixed}",
            lambda: scan_figure(result.parameters, grid, logarithmic(result)),
        ),
    )


def region_levels(count: int) -> tuple[float, ...]:
    """Increase of the misfit on the border of the regions that hold `SHARES`.

    Args:
        count: of normal parameters together, 1 or 2.

    >>> [round(level, 2) for level in (*region_levels(1), *region_levels(2))]
    [0.99, 3.84, 2.28, 5.99]
    """
    return tuple(float(chdtri(count, 1.0 - share)) for share in SHARES)


@dataclass(frozen=True)
class FineGrid:
    """The misfit between the points of a grid over two parameters.

    Args:
        at: (2, k, k) values of both parameters, SI.
        objective: (k, k) interpolated; NaN where a corner around has no solution.
    """

    at: Floats
    objective: Floats

    @property
    def rise(self) -> Floats:
        """(k, k) the misfit less its least value; NaN everywhere if there is none."""
        known = self.objective[np.isfinite(self.objective)]
        return np.asarray(self.objective - known.min(initial=np.inf))

    def profile(self, k: int) -> tuple[Floats, Floats]:
        """Least rise over the other parameter: values (m,) of the k-th parameter, and it."""
        values, rise = self.at[k].ravel(), np.nan_to_num(self.rise.ravel(), nan=np.inf)
        place = np.linspace(values.min(), values.max(), _PROFILE_BINS + 1)
        numbers = np.clip(np.searchsorted(place, values, side="right") - 1, 0, _PROFILE_BINS - 1)
        order = np.lexsort((rise, numbers))
        first = order[np.r_[True, np.diff(numbers[order]) > 0]]
        first = first[np.isfinite(rise[first])]
        along = first[np.argsort(values[first], kind="stable")]
        return values[along], rise[along]


@dataclass(frozen=True)
class _Surface:
    """The misfit as a function of two parameters on their scales.

    Args:
        nodes: places of the grid on both scales.
        misfit: (n_0, n_1) at the places; infinite where there is no solution.
        cells: (n_0 - 1, n_1 - 1) of the grid in which it is to be believed.
        spline: through the misfit.
        log: whether each scale is that of the logarithm.
    """

    nodes: tuple[Floats, Floats]
    misfit: Floats
    cells: Bools
    spline: RectBivariateSpline
    log: tuple[bool, bool]

    @property
    def box(self) -> Floats:
        """(2, 2) lower and upper ends of both axes."""
        return np.array([[axis[0], axis[-1]] for axis in self.nodes]).T

    def at(self, x: Floats, y: Floats) -> FineGrid:
        """The misfit at places (k, k) on the scales."""
        objective = np.maximum(self.spline.ev(x, y), 0.0)
        objective[~_inside(self.nodes, (x, y), self.cells)] = np.nan
        pairs = zip((x, y), self.log, strict=True)
        return FineGrid(np.stack([unscaled(own, log=log) for own, log in pairs]), objective)


def _surface(grid: Grid, logs: Set[str]) -> _Surface:
    from scipy.interpolate import RectBivariateSpline  # noqa: PLC0415 - 0.3 s, and few results scan

    first, second = (name in logs for name in grid.names)
    scales = [scaled(axis, log=own) for axis, own in zip(grid.axes, (first, second), strict=True)]
    order = [np.argsort(axis) for axis in scales]
    x, y = (axis[own] for axis, own in zip(scales, order, strict=True))
    phi = grid.objective[np.ix_(*order)]
    known = np.isfinite(phi)
    kx, ky = (min(_DEGREE, n - 1) for n in phi.shape)
    spline = RectBivariateSpline(x, y, _filled(phi, known), kx=kx, ky=ky)
    cells = known[:-1, :-1] & known[1:, :-1] & known[:-1, 1:] & known[1:, 1:]
    return _Surface((x, y), np.where(known, phi, np.inf), cells, spline, (first, second))


def _away_from_holes(surface: _Surface) -> _Surface:
    """The same without cells beside one without solution, where what is filled in bears.

    Unless the lowest point itself lies beside one.
    """
    from scipy.ndimage import binary_erosion  # noqa: PLC0415 - 0.2 s, and few results scan

    cells = binary_erosion(surface.cells, np.ones((3, 3), dtype=np.bool_), border_value=1)
    i, j = np.unravel_index(np.argmin(surface.misfit), surface.misfit.shape)
    beside = cells[max(i - 1, 0) : i + 1, max(j - 1, 0) : j + 1]
    return replace(surface, cells=np.asarray(cells)) if beside.any() else surface


def refined(grid: Grid, logs: Set[str]) -> FineGrid:
    """The misfit of a grid over two parameters on a finer one.

    Args:
        grid: over two parameters.
        logs: names of the parameters that are identified on the logarithm.
    """
    surface = _surface(grid, logs)
    return surface.at(*_places(surface.box.T))


def _places(ends: Floats) -> list[Floats]:
    """(k, k) both coordinates of places all over a box, given by the ends (2, 2) of its sides."""
    sides = (np.linspace(low, high, _FINE) for low, high in ends)
    return list(np.meshgrid(*sides, indexing="ij"))


def region(grid: Grid, logs: Set[str]) -> FineGrid:
    """The misfit around its region of 95 %, on a fine grid along the region, however narrow it is.

    From the whole scan the frame is turned to the principal axes of what lies below a bound, and
    narrowed to it, while the bound falls: so a valley is found by its sides first, and its floor is
    sampled along and across.

    Args:
        grid: over two parameters.
        logs: names of the parameters that are identified on the logarithm.
    """
    surface = _away_from_holes(_surface(grid, logs))
    if not surface.cells.any():
        return refined(grid, logs)  # between the places that have a solution there is nothing
    low, high = surface.box
    size, origin, axes = high - low, np.zeros(2), np.eye(2)
    ends = np.array([[0.0, 1.0], [0.0, 1.0]])
    for times in (*_NARROWING, 0.0):
        s, t = _places(ends)
        places = origin + s[..., None] * axes[0] + t[..., None] * axes[1]
        values = surface.at(*np.moveaxis(low + size * places, -1, 0))
        if times == 0.0:
            break
        below = np.nan_to_num(values.rise, nan=np.inf) <= times * _PROFILE_TOP
        inside = places[below]
        spread = float(np.ptp(ends, axis=1).max()) / (_FINE - 1)
        origin = inside.mean(axis=0)
        if len(inside) > _LEAST_INSIDE:
            axes = np.linalg.svd(inside - origin, full_matrices=False)[2]
        along = (inside - origin) @ axes.T
        margin = 3.0 * spread + 0.05 * np.ptp(along, axis=0)
        ends = np.stack([along.min(axis=0) - margin, along.max(axis=0) + margin], axis=1)
    return values


_FINE = 401
_LEAST_INSIDE = 10
_PROFILE_BINS = 150
_NARROWING = (300.0, 100.0, 30.0, 10.0, 3.0, 1.0)
"""Parts of the highest rise that is drawn by which the frame is narrowed."""


def _filled(phi: Floats, known: Bools) -> Floats:
    """The misfit (n_0, n_1), continued smoothly where there is no solution.

    What is filled in makes the third differences along both axes least, so that it goes on as a
    square does: a step there would make a spline swing far around.
    """
    if known.all():
        return phi
    numbers = np.arange(phi.size).reshape(phi.shape)
    blocks = []
    for axis in (0, 1):
        order = min(3, phi.shape[axis] - 1)
        weights = np.diff(np.eye(order + 1), order, axis=0)[0]
        runs = np.lib.stride_tricks.sliding_window_view(numbers, order + 1, axis=axis)
        runs = runs.reshape(-1, order + 1)
        rows = np.repeat(np.arange(len(runs)), order + 1)
        blocks.append(csr_array((np.tile(weights, len(runs)), (rows, runs.ravel())),
                               shape=(len(runs), phi.size)))  # fmt: skip
    rough = vstack(blocks).tocsc()
    size = float(np.abs(phi[known]).max()) or 1.0
    filled = np.where(known, phi, 0.0).ravel() / size
    missing = np.flatnonzero(~known.ravel())
    at = rough[:, missing]
    normal = (at.T @ at + 1e-12 * identity(len(missing))).tocsc()
    filled[missing] = np.atleast_1d(spsolve(normal, -(at.T @ (rough @ filled))))
    return np.asarray(size * filled.reshape(phi.shape))


def _inside(nodes: tuple[Floats, Floats], at: tuple[Floats, Floats], cells: Bools) -> Bools:
    """(k, k) whether places lie in one of some cells."""
    cell, inside = [], np.ones(at[0].shape, dtype=np.bool_)
    for axis, own in zip(nodes, at, strict=True):
        cell.append(np.clip(np.searchsorted(axis, own, side="right") - 1, 0, len(axis) - 2))
        tolerance = 1e-9 * (axis[-1] - axis[0])
        inside &= (own >= axis[0] - tolerance) & (own <= axis[-1] + tolerance)
    return np.asarray(cells[cell[0], cell[1]] & inside)


def scan_figure(parameters: ParameterTable, grid: Grid, logs: Set[str] = frozenset()) -> Figure:
    """A line over one parameter; bands of colour, regions and profiles over two.

    Args:
        parameters: with the units of the axes.
        grid: the misfit.
        logs: names of the parameters that are identified on the logarithm.
    """
    if len(grid.names) == 1:
        return _line_figure(parameters, grid, logs)
    return _plane_figure(parameters, grid, logs)


def _line_figure(parameters: ParameterTable, grid: Grid, logs: Set[str]) -> Figure:
    """The whole scan on a logarithmic axis, and what is around its lowest place."""
    figure = Figure(figsize=(WIDTH, 3.6))
    whole, near = figure.subplots(1, 2)
    (name,), (axis,) = grid.names, grid.axes
    unit, log = unit_of(parameters, name), name in logs
    size = in_unit(1.0, *unit)
    order = np.argsort(axis)
    at, phi = axis[order], _known(grid)[order]
    fine, line = _fine_line(at, phi, log=log)
    least = float(np.nanmin(line))
    for axes in (whole, near):
        axes.plot(size * at, phi, "o", ms=3, color=COMPUTED)
        axes.plot(size * fine, line, "-", color=COMPUTED, lw=1.1)
        _level_lines(axes.axhline, least)
        axes.set_xlabel(with_unit(name, unit))
        axes.set_ylabel("misfit")
        axes.grid()
    if least > 0.0 and np.nanmax(phi) > 10.0 * least:
        whole.set_yscale("log")
        whole.yaxis.set_major_formatter(FuncFormatter(lambda y, _: number(y)))
    set_scale(whole.xaxis, low=float(size * at[0]), high=float(size * at[-1]), log=log)
    inside = fine[np.nan_to_num(line, nan=np.inf) <= least + _PROFILE_TOP]
    low, high = float(inside.min()), float(inside.max())
    set_scale(near.xaxis, low=size * low, high=size * (high if high > low else 1.01 * high + 1e-12),
              log=log)  # fmt: skip
    near.set_ylim(least - 0.04 * _PROFILE_TOP, least + _PROFILE_TOP)
    near.legend(handles=_region_keys())
    return figure


def _fine_line(at: Floats, phi: Floats, *, log: bool) -> tuple[Floats, Floats]:
    """The misfit (k,) between the points (n,) of a scan over one parameter."""
    if not np.isfinite(phi).all() or len(at) <= _DEGREE:
        return at, phi
    from scipy.interpolate import make_interp_spline  # noqa: PLC0415 - 0.3 s, and few results scan

    nodes = scaled(at, log=log)
    fine = np.linspace(nodes[0], nodes[-1], 20 * _FINE)
    line = make_interp_spline(nodes, phi, k=_DEGREE)(fine)
    return unscaled(fine, log=log), np.maximum(line, 0.0)


def _level_lines(draw: Any, least: float) -> None:
    for level, style in zip(region_levels(1), _REGION_STYLES, strict=True):
        draw(least + level, color="black", lw=0.8, ls=style)


_REGION_STYLES = ("-", "--")


def _region_keys() -> list[Line2D]:
    return [
        key(f"{100 * share:.0f} %", color="black", lw=1.0, ls=style)
        for share, style in zip(SHARES, _REGION_STYLES, strict=True)
    ]


def _plane_figure(parameters: ParameterTable, grid: Grid, logs: Set[str]) -> Figure:
    """The whole scan, and the regions with the profiles of both parameters."""
    figure = Figure(figsize=(WIDTH, 4.2))
    parts: Any = figure.subfigures(1, 2, width_ratios=[1.0, 1.15])
    whole, part = parts
    units = [unit_of(parameters, name) for name in grid.names]
    size = np.array([in_unit(1.0, *unit) for unit in units])
    near = region(grid, logs)
    axes = whole.subplots()
    _draw_whole(whole, axes, grid, logs, size)
    panels: Any = part.subplots(
        2, 2, sharex="col", sharey="row", width_ratios=[1.0, 0.28], height_ratios=[0.28, 1.0],
        squeeze=False,
    )  # fmt: skip
    top, around, side = panels[0, 0], panels[1, 0], panels[1, 1]
    panels[0, 1].remove()
    best = np.unravel_index(np.nanargmin(_known(grid)), grid.objective.shape)
    for each in (axes, around):
        _draw_regions(each, near, size)
        each.plot(*(size * [axis[k] for axis, k in zip(grid.axes, best, strict=True)]), "*", ms=8,
                  color=ACCENT, mec="white")  # fmt: skip
    for k, panel in enumerate((top, side)):
        values, rise = near.profile(k)
        _draw_profile(panel, values * size[k], rise, upright=panel is side)
    shown = near.at[:, np.nan_to_num(near.rise, nan=np.inf) <= _PROFILE_TOP]
    for k, (name, unit) in enumerate(zip(grid.names, units, strict=True)):
        log, name_axis = name in logs, "xy"[k]
        whole_axis = (grid.axes[k].min(), grid.axes[k].max())
        ends = whole_axis, (shown[k].min(), shown[k].max()) if shown.size else whole_axis
        for each, (low, high) in zip((axes, around), ends, strict=True):
            axis = getattr(each, f"{name_axis}axis")
            set_scale(axis, low=size[k] * low, high=size[k] * high, log=log, most=5)
            axis.set_label_text(with_unit(name, unit, 24))
    around.legend(handles=_region_keys(), loc="best")
    around.grid()
    return figure


def _draw_regions(axes: Axes, near: FineGrid, size: Floats) -> None:
    """Borders of the regions of two parameters, where there is a misfit between the places."""
    if not np.isfinite(near.objective).any():
        return
    at = size[:, None, None] * near.at
    axes.contour(*at, np.ma.masked_invalid(near.rise), levels=list(region_levels(2)),
                 colors="black", linewidths=1.0, linestyles=list(_REGION_STYLES))  # fmt: skip


def _draw_whole(figure: SubFigure, axes: Axes, grid: Grid, logs: Set[str], size: Floats) -> None:
    """Bands of colour over the whole scan: decades of the misfit above the least."""
    fine = refined(grid, logs)
    floor = float(np.nanmin(_known(grid)))
    decades = np.log10(np.maximum(fine.objective, 1e-12) / max(floor, 1e-12))
    known = np.maximum(decades[np.isfinite(decades)], 0.0)
    scale = bands(np.stack([known, np.ones_like(known)]), LENGTHS)
    at = size[:, None, None] * fine.at
    shown = axes.contourf(*at, np.ma.masked_invalid(np.maximum(decades, 0.0)), **scale)
    label = f"log10 (misfit / least misfit {number(floor)})"
    figure.colorbar(shown, ax=axes, location="bottom", shrink=0.9, aspect=30, label=label)


def _known(grid: Grid) -> Floats:
    return np.where(np.isfinite(grid.objective), grid.objective, np.nan)


def _draw_profile(axes: Axes, at: Floats, rise: Floats, *, upright: bool) -> None:
    """The least misfit over the other parameter, less the least of all."""
    shown = np.where(rise <= 2.0 * _PROFILE_TOP, rise, np.nan)
    if upright:
        axes.plot(shown, at, color=COMPUTED, lw=1.1)
        axes.set_xlim(0.0, _PROFILE_TOP)
        _level_lines(axes.axvline, 0.0)
        axes.set_xlabel("rise", fontsize=SMALL)
    else:
        axes.plot(at, shown, color=COMPUTED, lw=1.1)
        axes.set_ylim(0.0, _PROFILE_TOP)
        _level_lines(axes.axhline, 0.0)
        axes.set_ylabel("rise", fontsize=SMALL)
    axes.grid(color=FAINT)

"""Pairs of parameters: ellipses of a fit, draws of a sample, with what was known before.

Everything is drawn on the scales on which the parameters are identified, on which the posterior of
a fit is normal: an ellipse there, cut at the bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from geoident.model.arrays import Floats
from geoident.model.parameter import Prior
from geoident.model.results.bands import NORMAL_95
from geoident.model.results.posterior import PosteriorDraws
from geoident.model.results.result import ParameterTable, Result
from geoident.report.drawing.parameters.scale import (
    logarithmic,
    scaled,
    set_scale,
    shown_bounds,
    unscaled,
    with_unit,
)
from geoident.report.drawing.parameters.scan import SHARES
from geoident.report.drawing.style import ACCENT, FAINT, WIDTH, Picture, colour, key
from geoident.report.text.parameters import Unit, unit_of
from geoident.units import in_unit

_MOST = 8  # parameters in one plot
_MOST_POINTS = 3000
_LEVELS = (0.5, 0.95)  # of the draws inside a contour
_MOST_KERNELS = 1000
_PLACES = 60  # along each side, at which the density of draws is known
_KERNELS_BEYOND = 0.6  # standard deviations beyond the draws, where their density is known too
_REACH = 3.3  # standard deviations that are shown on each side of an estimate
_TURN = np.linspace(0.0, 2.0 * np.pi, 181)


@dataclass(frozen=True)
class _Axis:
    """One parameter of a corner plot.

    Args:
        name: of the parameter.
        unit: of its values.
        log: it is identified on the logarithm.
        row: of the table of parameters.
        low: lower end of its axis, in the unit.
        high: upper end.
        prior: what was known before, SI.
    """

    name: str
    unit: Unit
    log: bool
    row: int
    low: float
    high: float
    prior: Prior | None

    @property
    def size(self) -> float:
        """The SI unit in the unit."""
        return in_unit(1.0, *self.unit)

    def on_scale(self, values: Floats) -> Floats:
        """SI values (...) on the scale of the unit."""
        return scaled(self.size * values, log=self.log)

    def normal(self, mean: float, sd: float) -> tuple[float, float]:
        """A mean and a standard deviation, SI, on the scale, as those of a normal distribution."""
        mean, sd = self.size * mean, self.size * sd
        return (float(np.log(mean)), sd / mean) if self.log else (mean, sd)

    def shown(self, places: Floats) -> Floats:
        """Places (...) on the scale as values in the unit."""
        return unscaled(places, log=self.log)


def pair_pictures(result: Result) -> tuple[Picture, ...]:
    """The corner plot of a fit, or of a sample where there are draws; none for one parameter."""
    draws = result.posterior
    if draws is not None and draws.names:
        return (_draws_picture(result, draws),)
    rows = _known_rows(result.parameters)
    if len(rows) < 2:
        return ()
    more = f" The first {_MOST} parameters of {len(rows)}." if len(rows) > _MOST else ""
    rival = " Crosses: other minima that are nearly as low." if len(_rivals(result)) else ""
    return (
        Picture(
            "pairs",
            "Parameters in pairs",
            "Ellipses that hold 68 and 95 % of the posterior of each pair; on the diagonal the "
            "density of each parameter with its 95 % interval, and of its prior (dashed). "
            f"An ellipse along a diagonal: the readings see a combination of the two.{rival}{more}",
            lambda: pair_figure(result),
        ),
    )


def _known_rows(table: ParameterTable) -> list[int]:
    variance = np.diag(table.covariance) if table.covariance.size else np.empty(0)
    return np.flatnonzero(table.determined & (variance > 0.0) & np.isfinite(variance)).tolist()


def _rivals(result: Result) -> Floats:
    """(k, n_parameters) values of the other minima, SI."""
    return np.empty((0, 0)) if result.rivals is None else result.rivals.values[1:]


def pair_figure(result: Result) -> Figure:
    """Densities on the diagonal, ellipses below it."""
    table, logs = result.parameters, logarithmic(result)
    axes = [_axis_of_fit(table, row, log=table.names[row] in logs) for row in
            _known_rows(table)[:_MOST]]  # fmt: skip

    def alone(panel: Axes, one: _Axis) -> None:
        _draw_density(panel, table, one)

    def pair(panel: Axes, x: _Axis, y: _Axis) -> None:
        _draw_ellipses(panel, table, x, y)
        for values in _rivals(result):
            panel.plot(values[x.row] * x.size, values[y.row] * y.size, "x", ms=5, color=ACCENT)

    handles = [
        key("estimate, 68 and 95 %", color=colour(0), marker="o", ms=3),
        *([key("prior, 95 %", color=FAINT, ls="--")] if any(a.prior for a in axes) else []),
    ]
    return _corner(axes, alone, pair, handles)


def _axis_of_fit(table: ParameterTable, row: int, *, log: bool) -> _Axis:
    """The axis around an estimate, not beyond the bounds."""
    unit = unit_of(table, table.names[row])
    low, high = shown_bounds(table, row, unit, log=log)
    axis = _Axis(table.names[row], unit, log, row, low, high, table.priors[row])
    middle, sd = axis.normal(float(table.values[row]), float(np.sqrt(table.covariance[row, row])))
    first, last = axis.shown(np.array([middle - _REACH * sd, middle + _REACH * sd]))
    return replace(axis, low=max(low, float(first)), high=min(high, float(last)))


def ellipse(middle: Floats, covariance: Floats, share: float) -> Floats:
    """The ellipse that holds a share of a normal distribution of two numbers.

    Args:
        middle: (2,) its mean.
        covariance: (2, 2).
        share: of the probability inside.

    Returns:
        (2, 181) points on it, the last that of the beginning.
    """
    size, turned = np.linalg.eigh(covariance)
    radius = np.sqrt(-2.0 * np.log1p(-share) * np.maximum(size, 0.0))
    circle = np.stack([np.cos(_TURN), np.sin(_TURN)])
    return np.asarray(middle[:, None] + turned @ (radius[:, None] * circle))


def _draw_ellipses(panel: Axes, table: ParameterTable, x: _Axis, y: _Axis) -> None:
    rows = [x.row, y.row]
    middle, slope = np.transpose([one.normal(float(table.values[one.row]), 1.0) for one in (x, y)])
    covariance = table.covariance[np.ix_(rows, rows)] * np.outer(slope, slope)
    for share, opacity in zip(SHARES[::-1], (0.15, 0.3), strict=True):
        border = ellipse(middle, covariance, share)
        panel.fill(x.shown(border[0]), y.shown(border[1]), color=colour(0), alpha=opacity, lw=0)
        panel.plot(x.shown(border[0]), y.shown(border[1]), color=colour(0), lw=0.9)
    panel.plot(table.values[x.row] * x.size, table.values[y.row] * y.size, "o", ms=3,
               color=colour(0))  # fmt: skip
    _draw_prior_limits(x, panel.axvline)
    _draw_prior_limits(y, panel.axhline)


def _draw_prior_limits(one: _Axis, line: Callable[..., Any]) -> None:
    """The ends of the 95 % interval of a prior."""
    if one.prior is None:
        return
    middle, sd = one.normal(one.prior.mean, one.prior.sd)
    for side in (-NORMAL_95, NORMAL_95):
        end = float(one.shown(np.array([middle + side * sd]))[0])
        if one.low < end < one.high:
            line(end, color=FAINT, lw=0.8, ls="--")


def _draw_density(panel: Axes, table: ParameterTable, one: _Axis) -> None:
    """Density of an estimate and of its prior, both by their largest value."""
    sd_of_value = float(np.sqrt(table.covariance[one.row, one.row]))
    middle, sd = one.normal(float(table.values[one.row]), sd_of_value)
    places = scaled(np.linspace(one.low, one.high, 301), log=one.log)
    height = np.exp(-0.5 * ((places - middle) / sd) ** 2)
    panel.fill_between(one.shown(places), 0.0, height, color=colour(0), alpha=0.3, lw=0)
    panel.plot(one.shown(places), height, color=colour(0), lw=1.1)
    for end in (table.lower95[one.row], table.upper95[one.row]):
        if np.isfinite(end):
            panel.axvline(end * one.size, color=colour(0), lw=0.8, ls=":")
    if one.prior is not None:
        before, wide = one.normal(one.prior.mean, one.prior.sd)
        panel.plot(one.shown(places), np.exp(-0.5 * ((places - before) / wide) ** 2), "--",
                   color=FAINT, lw=1.1)  # fmt: skip
    panel.set_ylim(0.0, 1.08)


def _draws_picture(result: Result, posterior: PosteriorDraws) -> Picture:
    count = len(posterior.names)
    more = f" The first {_MOST} parameters of {count}." if count > _MOST else ""
    return Picture(
        "posterior",
        "Posterior of the parameters",
        "On the diagonal the draws of each parameter, with their median and 95 % interval, and "
        "the prior (dashed); below it the draws of each pair with contours that hold 50 and "
        f"95 % of them, and (dotted) the ellipse of 95 % by their covariance.{more}",
        lambda: corner_figure(result, posterior),
    )


def corner_figure(result: Result, posterior: PosteriorDraws) -> Figure:
    """Histograms on the diagonal, draws of pairs below it.

    Args:
        result: of a sample.
        posterior: its draws.
    """
    table, logs = result.parameters, logarithmic(result)
    axes = [
        _axis_of_draws(table, name, posterior.flat[:, i], log=name in logs)
        for i, name in enumerate(posterior.names[:_MOST])
    ]
    bins = int(np.clip(2.0 * posterior.least_effective ** (1 / 3), 10, 50))  # Rice's rule

    def drawn(one: _Axis) -> Floats:
        return one.on_scale(posterior.flat[:, posterior.names.index(one.name)])

    def alone(panel: Axes, one: _Axis) -> None:
        _draw_histogram(panel, one, drawn(one), bins)

    def pair(panel: Axes, x: _Axis, y: _Axis) -> None:
        _draw_pair(panel, (x, y), drawn(x), drawn(y))

    handles = [
        key(
            "median; dotted: 95 %" if len(axes) == 1 else "median; contours of 50 and 95 %",
            color=colour(0),
        ),
        *([key("prior", color=FAINT, ls="--")] if any(a.prior for a in axes) else []),
        *([key("ellipse, 95 %", color="black", ls=":")] if len(axes) > 1 else []),
    ]
    return _corner(axes, alone, pair, handles)


def _axis_of_draws(table: ParameterTable, name: str, values: Floats, *, log: bool) -> _Axis:
    row, unit = table.names.index(name), unit_of(table, name)
    shown = values * in_unit(1.0, *unit)
    log = log and bool(shown.min() > 0.0)
    places = scaled(np.array([shown.min(), shown.max()]), log=log)
    margin = 0.1 * float(np.ptp(places)) or 0.05 * abs(float(places[0])) or 0.05
    low, high = unscaled(places + np.array([-margin, margin]), log=log)
    return _Axis(name, unit, log, row, float(low), float(high), table.priors[row])


def _draw_histogram(panel: Axes, one: _Axis, places: Floats, bins: int) -> None:
    counts, edges = np.histogram(places, bins=bins, density=True)
    panel.stairs(counts, one.shown(edges), fill=True, color=colour(0), alpha=0.35, lw=0)
    low, middle, high = np.quantile(places, (0.025, 0.5, 0.975))
    panel.axvline(float(one.shown(middle)), color=colour(0), lw=1.4)
    for end in (low, high):
        panel.axvline(float(one.shown(end)), color=colour(0), lw=0.8, ls=":")
    top = float(counts.max())
    if one.prior is not None:
        before, wide = one.normal(one.prior.mean, one.prior.sd)
        low_end, high_end = scaled(np.array([one.low, one.high]), log=one.log)
        x = np.linspace(float(low_end), float(high_end), 200)
        density = np.exp(-0.5 * ((x - before) / wide) ** 2) / (wide * np.sqrt(2.0 * np.pi))
        panel.plot(one.shown(x), density, "--", color=FAINT, lw=1.2)
        top = max(top, float(density.max()))
    panel.set_ylim(0.0, 1.05 * top)


def _draw_pair(panel: Axes, axes: tuple[_Axis, _Axis], x: Floats, y: Floats) -> None:
    step = max(1, len(x) // _MOST_POINTS)
    at = axes[0].shown(x[::step]), axes[1].shown(y[::step])
    panel.plot(*at, ".", ms=1.5, color=colour(0), alpha=0.25, rasterized=True)
    if np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        return
    border = ellipse(np.array([x.mean(), y.mean()]), np.cov(x, y), SHARES[-1])
    panel.plot(axes[0].shown(border[0]), axes[1].shown(border[1]), ":", color="black", lw=0.9)
    places, density, levels = draws_density(np.stack([x, y]))
    if levels:
        lines = (one.shown(place) for one, place in zip(axes, places, strict=True))
        panel.contour(*lines, density, levels=levels, colors=[colour(0)], linewidths=0.9)


def draws_density(draws: Floats) -> tuple[tuple[Floats, Floats], Floats, list[float]]:
    """The density of draws of two numbers, and the levels above which given parts of them lie.

    A kernel with the covariance of the draws, so that a narrow valley is not made wide, on places
    beyond the draws, so that contours close. Levels are those of the draws themselves: what the
    kernel widens is not counted.

    Args:
        draws: (2, n).

    Returns:
        Places along x (m,) and y (m,), the density (m, m) with y along its rows, and the levels,
        rising; none if all draws lie on a line.
    """
    from scipy.stats import gaussian_kde  # noqa: PLC0415 - takes a second; draws are rare

    step = max(1, draws.shape[1] // _MOST_KERNELS)
    thinned = draws[:, ::step]
    reach = _KERNELS_BEYOND * thinned.std(axis=1)
    low, high = thinned.min(axis=1) - reach, thinned.max(axis=1) + reach
    across, up = (np.linspace(a, b, _PLACES) for a, b in zip(low, high, strict=True))
    try:
        kernel = gaussian_kde(thinned)
    except np.linalg.LinAlgError:
        return (across, up), np.zeros((_PLACES, _PLACES)), []
    grid = np.stack(np.meshgrid(across, up))
    density = kernel(grid.reshape(2, -1)).reshape(_PLACES, _PLACES)
    levels = np.quantile(kernel(thinned), [1.0 - share for share in _LEVELS])
    return (across, up), density, sorted({float(level) for level in levels})


def _corner(
    axes: Sequence[_Axis],
    alone: Callable[[Axes, _Axis], None],
    pair: Callable[[Axes, _Axis, _Axis], None],
    handles: Sequence[Any],
) -> Figure:
    """Panels of each parameter on the diagonal, of each pair below it.

    Args:
        axes: n parameters.
        alone: draws one of them.
        pair: draws two of them, x and y.
        handles: of the legend.
    """
    n = len(axes)
    size = max(4.0, min(WIDTH, 1.75 * n))
    figure = Figure(figsize=(size, size))
    panels: Any = figure.subplots(n, n, squeeze=False, sharex="col")
    for i, j in np.ndindex(n, n):
        panel: Axes = panels[i, j]
        if j > i:
            panel.remove()
            continue
        if i == j:
            alone(panel, axes[i])
            panel.set_yticks([])
        else:
            pair(panel, axes[j], axes[i])
            one = axes[i]
            set_scale(panel.yaxis, low=one.low, high=one.high, log=one.log, most=3)
            if j == 0:
                panel.set_ylabel(with_unit(one.name, one.unit, 14))
            else:
                panel.tick_params(labelleft=False)
        if i == n - 1:
            panel.set_xlabel(with_unit(axes[j].name, axes[j].unit, 14))
    for j, one in enumerate(axes):
        set_scale(panels[n - 1, j].xaxis, low=one.low, high=one.high, log=one.log, most=3)
    figure.align_labels()
    figure.legend(handles=list(handles), loc="outside upper right")
    return figure

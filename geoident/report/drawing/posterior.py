"""Draws of a posterior: each parameter alone and each pair, as a corner plot."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.ndimage import gaussian_filter

from geoident.model.arrays import Floats
from geoident.model.parameter import Prior
from geoident.model.results.posterior import PosteriorDraws
from geoident.model.results.result import ParameterTable, Result
from geoident.report.drawing.style import FAINT, Picture, colour, key, short
from geoident.report.text.parameters import Unit, unit_of
from geoident.units import in_unit, shown_unit

_MOST = 8  # parameters in one plot
_MOST_POINTS = 3000
_LEVELS = (0.5, 0.95)  # of the draws inside a contour


def posterior_pictures(result: Result) -> tuple[Picture, ...]:
    """The corner plot, if the result has draws."""
    found = result.posterior
    if found is None or not found.names:
        return ()
    count = len(found.names)
    more = f" The first {_MOST} parameters of {count}." if count > _MOST else ""
    return (
        Picture(
            "posterior",
            "Posterior of the parameters",
            "On the diagonal the draws of each parameter, with their median and 95 % interval, and "
            "the prior (dashed); below it the draws of each pair with contours that hold 50 and "
            f"95 % of them.{more}",
            lambda: corner_figure(result.parameters, found),
        ),
    )


def corner_figure(parameters: ParameterTable, found: PosteriorDraws) -> Figure:
    """Histograms on the diagonal, draws of pairs below it."""
    numbers = range(min(_MOST, len(found.names)))
    names = [found.names[i] for i in numbers]
    units = [unit_of(parameters, name) for name in names]
    values = np.stack(
        [found.flat[:, i] * in_unit(1.0, *unit) for i, unit in zip(numbers, units, strict=True)]
    )
    bins = int(np.clip(2.0 * found.least_effective ** (1 / 3), 10, 50))  # Rice's rule
    n = len(numbers)
    size = max(4.0, min(8.5, 2.1 * n))
    figure = Figure(figsize=(size, size))
    panels = figure.subplots(n, n, squeeze=False, sharex="col")
    for i in range(n):
        for j in range(n):
            axes = panels[i, j]
            if j > i:
                axes.set_visible(False)
            elif i == j:
                _alone(axes, values[i], parameters.priors[numbers[i]], units[i], bins)
            else:
                _pair(axes, values[j], values[i], bins)
            if i == n - 1:
                axes.set_xlabel(_label(names[j], units[j]))
            if j == 0 and i > 0:
                axes.set_ylabel(_label(names[i], units[i]))
            elif j < i:
                axes.tick_params(labelleft=False)
    figure.align_labels()
    handles = [key("median, 95 %", color=colour(0)), key("prior", color=FAINT, ls="--")]
    figure.legend(handles=handles, loc="outside upper right")
    return figure


def _label(name: str, unit: Unit) -> str:
    word = shown_unit(*unit)
    return f"{short(name, 14)} ({word})" if word else short(name, 14)


def _alone(axes: Axes, values: Floats, prior: Prior | None, unit: Unit, bins: int) -> None:
    axes.hist(values, bins=bins, density=True, color=colour(0), alpha=0.35, lw=0)
    low, middle, high = np.quantile(values, (0.025, 0.5, 0.975))
    axes.axvline(middle, color=colour(0), lw=1.4)
    for end in (low, high):
        axes.axvline(end, color=colour(0), lw=0.8, ls=":")
    axes.set_yticks([])
    if prior is not None:
        x = np.linspace(values.min(), values.max(), 200)
        axes.plot(x, _prior_density(prior, x, in_unit(1.0, *unit)), "--", color=FAINT, lw=1.2)


def _prior_density(prior: Prior, x: Floats, size: float) -> Floats:
    """Density of a prior at x in the shown unit, of which the SI unit has ``size``."""
    mean, sd = prior.mean * size, prior.sd * size
    if prior.kind == "normal":
        return np.asarray(np.exp(-0.5 * ((x - mean) / sd) ** 2) / (sd * np.sqrt(2 * np.pi)))
    spread = sd / mean
    inside = np.where(x > 0.0, x, np.nan)
    z = np.log(inside / mean) / spread
    return np.asarray(np.exp(-0.5 * z**2) / (inside * spread * np.sqrt(2 * np.pi)))


def _pair(axes: Axes, x: Floats, y: Floats, bins: int) -> None:
    step = max(1, len(x) // _MOST_POINTS)
    axes.plot(x[::step], y[::step], ".", ms=1.5, color=colour(0), alpha=0.25, rasterized=True)
    if np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        return
    counts, xs, ys = np.histogram2d(x, y, bins=bins)
    counts = gaussian_filter(counts, 1.0)  # contours of draws, not of their noise
    ranked = np.sort(counts.ravel())[::-1]
    share = np.cumsum(ranked) / ranked.sum()
    levels = sorted({float(ranked[np.searchsorted(share, level)]) for level in _LEVELS})
    levels = [level for level in levels if counts.min() < level < counts.max()]
    if levels:
        middle = [0.5 * (edges[1:] + edges[:-1]) for edges in (xs, ys)]
        axes.contour(*middle, counts.T, levels=levels, colors=[colour(0)], linewidths=0.9)

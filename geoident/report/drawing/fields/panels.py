"""What figures of fields have in common: panels, bands of colour, lines of the ground, gauges.

Colours are in bands, so that a value can be read in print. Fields and lines of the mesh are images
inside the figure, letters are not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.colors import BoundaryNorm, ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, MaxNLocator
from matplotlib.tri import Triangulation

from geoident.model.arrays import Bools, Floats
from geoident.report.drawing.labels import place_labels
from geoident.report.drawing.lines import add_segments
from geoident.report.drawing.scene import SheetView, Window
from geoident.report.drawing.style import (
    ACCENT,
    DIVERGING,
    GAUGE,
    WIDTH,
    Picture,
    hide_unused,
    lay_out,
)
from geoident.report.text.layout import number

_SIDE = 0.15
_NEGATIVE: Any = (0, (0.6, 2.2))
"""Lines between bands on the negative side, where signs differ: dots."""
_BANDS = 12
_TOP = (0.5, 1.0)
"""Where a panel stands in its room over a scale of colours: under the title, which else is cut."""

_LEAST = 1e-6  # mm that is marked as the largest: less is rounding
_HALF_PAGE = 4.6  # height of a figure of which two with their captions fill a page, inches
_NARROW = 20  # letters over a panel, of four in a row
_FEW = 5  # numbers along a narrow scale of colours
_ENDS = (0.005, 0.995)

_FAINT_ON_WHITE: dict[str, Any] = {"color": "#b5b5b5", "lw": 0.4}
_FAINT_ON_FIELD: dict[str, Any] = {"color": "white", "lw": 0.3, "alpha": 0.6}


@dataclass(frozen=True)
class ColouredField:
    """Something that is shown in colours.

    Args:
        label: what it is, with its unit.
        at: its values (n,) at the points of a sheet in a state.
        colours: map from light for 0 to dark for large sizes.
        unit: of the largest value, which is printed at its place; empty for not to be printed.
    """

    label: str
    at: Callable[[SheetView, int], Floats]
    colours: str
    unit: str = ""


def contours(
    view: SheetView, name: str, title: str, caption: str, quantity: ColouredField
) -> Picture:
    """The picture of a quantity stage by stage.

    Args:
        view: what is drawn.
        name: of the picture.
        title: what it shows.
        caption: what has to be known.
        quantity: at the points of the sheet.
    """
    shown, stages = len(view.scene.states), view.scene.n_states - 1
    more = f" Drawn are {shown} of {stages} stages." if 1 < shown < stages else ""
    draw = partial(field_figure, view, quantity, view.scene.states)
    title = f"{title}{view.where}, stage by stage"
    return Picture(f"{view.tag}{name}", title, caption + more, draw)


def field_figure(view: SheetView, quantity: ColouredField, states: Sequence[int]) -> Figure:
    """A quantity in some states, one scale of colours for all; laid out once a view and number."""
    figure, panels = panel_figure(view, len(states))
    colour_bar(figure, _draw_all(panels, view, quantity, states), panels, quantity.label)
    if len(states) not in view.layouts:
        lay_out(figure)
        view.layouts[len(states)] = [axes.get_position() for axes in figure.axes]
    figure.set_layout_engine("none")
    for axes, place in zip(figure.axes, view.layouts[len(states)], strict=True):
        axes.set_position(place)
    return figure


def table_figure(view: SheetView, columns: Sequence[ColouredField]) -> Figure:
    """Several quantities side by side, each with its own colours, at the key states."""
    aspect, states = view.window.aspect, view.scene.key_states
    across = 2 if aspect < 0.45 else len(columns)
    down = len(columns) // across
    width = WIDTH / across
    height = down * (len(states) * ((width - 0.35) * aspect + 0.36) + 0.95)
    figure = Figure(figsize=(WIDTH, height))
    grid = figure.subplots(down * len(states), across, squeeze=False)
    for k, quantity in enumerate(columns):
        first = k // across * len(states)
        panels = list(grid[first : first + len(states), k % across])
        for n, axes in enumerate(panels):
            axes.tick_params(labelbottom=n == len(states) - 1, labelleft=k % across == 0)
        shading = _draw_all(panels, view, quantity, states)
        style = {"shrink": 0.95, "aspect": 22, "format": "%g"}
        below = colour_bar(figure, shading, panels, quantity.label, **style)
        below.ax.xaxis.set_major_locator(FixedLocator(_few(shading.norm)))
    return figure


def colour_bar(
    figure: Figure, shading: ScalarMappable, panels: Sequence[Axes], label: str, **style: Any
) -> Colorbar:
    """The scale of colours below panels, which stand at the top of their room.

    Args:
        figure: of the panels.
        shading: the colours.
        panels: that have them.
        label: what they mean.
        style: other than that of one scale for a whole figure.
    """
    look = {"location": "bottom", "panchor": _TOP, "shrink": 0.6, "aspect": 45, **style}
    bar = figure.colorbar(shading, ax=panels, **look)
    bar.set_label(label)
    return bar


def _few(norm: Any) -> list[float]:
    """Some of the limits of the bands, zero among them where it is one."""
    limits = [float(level) for level in norm.boundaries]
    every = -(-len(limits) // _FEW)
    start = min(range(len(limits)), key=lambda k: abs(limits[k])) % every
    return limits[start::every]


def _draw_all(
    panels: Sequence[Axes], view: SheetView, quantity: ColouredField, states: Sequence[int]
) -> ScalarMappable:
    """A quantity in one panel for each of some states, in one scale of colours."""
    values = [quantity.at(view, state) for state in states]
    scale = common_bands(view, states, values, quantity.colours)
    for axes, state, value in zip(panels, states, values, strict=True):
        shade(axes, view, state, value, scale)
        draw_lines(axes, view, state)
        finish(axes, view, state)
        if quantity.unit:
            mark_largest(axes, view, state, value, quantity.unit)
    return ScalarMappable(scale["norm"], scale["cmap"])


def mark_largest(axes: Axes, view: SheetView, state: int, value: Floats, unit: str) -> None:
    """A cross at the largest value in the window, with its number.

    Args:
        axes: where to draw.
        view: what is drawn.
        state: number of the state.
        value: (n,) at the points of the sheet, in the unit.
        unit: of it.
    """
    points = np.unique(view.areas(state)[0])
    points = points[np.isfinite(value[points])]
    if not len(points) or not value[points].max() > _LEAST:
        return
    place = view.sheet.xy[points[np.argmax(value[points])]]
    axes.plot(*place, "x", color=ACCENT, ms=4.0, mew=1.2, zorder=4, clip_on=False)
    place_labels(axes, [place], [f"max {number(float(value[points].max()), 3)} {unit}"])


def common_bands(
    view: SheetView, states: Sequence[int], values: Sequence[Floats], colours: str
) -> dict[str, Any]:
    """The bands of a quantity in some states.

    Args:
        view: what is drawn.
        states: the states.
        values: (n,) at the points of the sheet in each of them.
        colours: as `bands` has them.
    """
    shown = [view.weighted(state, value) for state, value in zip(states, values, strict=True)]
    return bands(np.hstack(shown), colours)


def panel_figure(
    view: SheetView, n: int, *, extra: float = 0.9, aspect: float | None = None
) -> tuple[Figure, list[Axes]]:
    """A figure with panels of the aspect of a window.

    Args:
        view: what each panel shows.
        n: number of panels.
        extra: height beside the panels, inches.
        aspect: height by width; None for that of the view.
    """
    aspect = aspect or view.window.aspect
    longest = max((len(view.scene.title(state)) for state in view.scene.states), default=0)
    few = aspect < 0.6 or n in (3, 5, 6, 9) or longest > _NARROW
    columns = min(n, 2 if aspect < 0.45 or (n == 4 and few) else 3 if few else 4)
    rows = -(-n // columns)
    width = min(WIDTH / columns, 6.0)
    panel = width - 0.6 / columns - 0.08  # numbers along y stand beside the first one only
    height = rows * (panel * aspect + 0.32) + extra
    if rows > 1:  # two such figures on a page, as long as that leaves the panels large enough
        height = max(min(height, _HALF_PAGE), 0.75 * height)
    figure = Figure(figsize=(max(width * columns, 4.5), height), layout="compressed")
    panels = list(figure.subplots(rows, columns, squeeze=False).ravel())
    hide_unused(panels, n)
    for k, axes in enumerate(panels[:n]):
        axes.tick_params(labelbottom=k // columns == rows - 1, labelleft=k % columns == 0)
    return figure, panels[:n]


def bands(shown: Floats, colours: str) -> dict[str, Any]:
    """Limits of the bands of colour, which ends are open, and the colours, as `tricontourf` wants.

    A few extreme values at corners must not take the whole scale: it ends where less than half a
    percent of the area lies beyond. Dark is far from zero. Where a good part lies on each side of
    zero, each side has its hue.

    Args:
        shown: (2, m) values and their weights.
        colours: the map, light to dark.
    """
    low, high = _ends(shown)
    levels = np.asarray(MaxNLocator(_BANDS, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high))
    low, high = float(levels[0]), float(levels[-1])
    known = shown[0] if shown.size else np.zeros(1)
    below, above = bool(known.min() < low), bool(known.max() > high)
    extend: Literal["neither", "both", "min", "max"] = (
        ("both" if above else "min") if below else ("max" if above else "neither")
    )
    middles = (levels[:-1] + levels[1:]) / 2
    step = levels[1] - levels[0]
    middles = np.r_[[low - step / 2] * below, middles, [high + step / 2] * above]
    if _two_sided(levels):
        reach = max(-low, high)
        shades = colormaps[DIVERGING](Normalize(-reach, reach)(middles))
    else:
        part = np.linspace(0.0, 1.0, len(middles))
        shades = colormaps[colours if high > -low else f"{colours}_r"](part)
    norm = BoundaryNorm(levels, len(middles), extend=extend)
    return {"levels": levels, "extend": extend, "cmap": ListedColormap(shades), "norm": norm}


def _ends(shown: Floats) -> tuple[float, float]:
    """Where the scale begins and ends."""
    if not shown.size:
        return 0.0, 1.0
    order = np.argsort(shown[0], kind="stable")
    value, share = shown[0, order], np.cumsum(shown[1, order])
    places = np.searchsorted(share, np.array(_ENDS) * share[-1])
    low, high = value[np.minimum(places, len(value) - 1)]
    low = 0.0 if value[0] >= 0 else float(low)
    return low, max(float(high), low + 1e-6 * max(abs(low), 1.0))


def _two_sided(levels: Floats) -> bool:
    """A good part of some limits of bands lies on each side of zero, so that each has its hue."""
    low, high = float(levels[0]), float(levels[-1])
    return low < 0 < high and min(-low, high) > _SIDE * max(-low, high)


def shade(
    axes: Axes,
    view: SheetView,
    state: int,
    value: Floats,
    scale: dict[str, Any],
    *,
    xy: Floats | None = None,
) -> ScalarMappable:
    """Colour the present part of a sheet by values at its points.

    Args:
        axes: where to draw.
        view: what is drawn.
        state: number of the state.
        value: (n,) at the points of the sheet; NaN stays white.
        scale: of `bands`.
        xy: (n, 2) where the points are drawn, m; None for where they are.
    """
    known = np.asarray(np.isfinite(value[view.sheet.triangles]).all(axis=1))
    ground = ground_of(view, state, known, xy=xy)
    values, levels = np.nan_to_num(value), scale["levels"]
    if ground is not None:
        beyond = {**scale, "extend": "both"}  # beyond its ends it has the colours of these
        axes.tricontourf(ground, values, zorder=0, **beyond).set_rasterized(True)
        if levels[0] < 0.0 < levels[-1]:  # two hues are one in grey
            add_levels(axes, ground, values, [0.0], linewidths=0.6, linestyles="dashed")
            if _two_sided(levels):
                negative, dots = levels[levels < 0.0], [_NEGATIVE]
                add_levels(axes, ground, values, negative, linewidths=0.5, linestyles=dots)
    return ScalarMappable(scale["norm"], scale["cmap"])


def ground_of(
    view: SheetView, state: int, known: Bools | bool = True, *, xy: Floats | None = None
) -> Triangulation | None:
    """The triangles of a sheet in the window that are present in a state; None without any.

    Args:
        view: what is drawn.
        state: number of the state.
        known: (m,) which of the m triangles may be shown.
        xy: (n, 2) where the points are drawn, m; None for where they are.
    """
    sheet = view.sheet
    present = view.scene.fields.present[state][sheet.element] & known
    points = sheet.xy if xy is None else xy
    corners, window = points[sheet.triangles], view.window
    present &= (corners.max(axis=1) >= window.low).all(axis=1)
    present &= (corners.min(axis=1) <= window.high).all(axis=1)
    x, y = points.T
    return Triangulation(x, y, sheet.triangles[present]) if present.any() else None


def add_levels(
    axes: Axes,
    ground: Triangulation,
    values: Floats,
    levels: Sequence[float] | Floats,
    **style: Any,
) -> None:
    """The lines along which something has some values, as far as it has them.

    Args:
        axes: where to draw.
        ground: triangles of n points.
        values: (n,) at the points.
        levels: the values of the lines.
        style: of the lines; black if it says no colours.
    """
    known = values[ground.triangles]
    here = [float(level) for level in levels if known.min() < level < known.max()]
    if here:
        axes.tricontour(ground, values, levels=here, zorder=2, **{"colors": "black", **style})


def draw_lines(axes: Axes, view: SheetView, state: int, *, on_white: bool = False) -> None:
    """Where the ground ends, and faintly where groups meet; on colours or on white."""
    points = view.scene.fields.mesh.points
    borders, outline = view.lines(state)
    add_lines(axes, view, borders.at(points), **(_FAINT_ON_WHITE if on_white else _FAINT_ON_FIELD))
    add_lines(axes, view, outline.at(points), color="black", lw=0.7)


def add_lines(axes: Axes, view: SheetView, ends: Floats, **style: Any) -> None:
    """Line segments (k, 2, dim), m, as far as they lie in the window."""
    window = view.window
    add_segments(axes, ends[:, :, view.across], (window.low, window.high), **style)


def finish(axes: Axes, view: SheetView, state: int, window: Window | None = None) -> None:
    """Title, limits, equal scales and names of the axes.

    Args:
        axes: where to draw.
        view: what is drawn.
        state: number of the state.
        window: what is shown; None for that of the view.
    """
    (x0, y0), (x1, y1) = (window or view.window).low, (window or view.window).high
    axes.set_title(view.scene.title(state))
    axes.set_aspect("equal")
    axes.set_xlim(x0, x1)
    axes.set_ylim(y0, y1)
    across, up = (f"{view.scene.axis_names[k]} (m)" for k in view.across)
    ticks = axes.xaxis.get_tick_params(), axes.yaxis.get_tick_params()
    axes.set_xlabel(across if ticks[0].get("labelbottom", True) else "")
    axes.set_ylabel(up if ticks[1].get("labelleft", True) else "")
    axes.xaxis.set_major_locator(MaxNLocator(4))
    axes.yaxis.set_major_locator(MaxNLocator(5))


def draw_gauge_lines(axes: Axes, view: SheetView) -> None:
    """The gauges as lines between their points, as far as they lie on the sheet."""
    for _, ends in view.gauges():
        axes.plot(*ends.T, "-o", color=GAUGE, lw=0.7, ms=1.8)

"""What counts as positive, in a drawing for each kind of gauge."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from geoident.model.result import Result
from geoident.report.drawing.style import (
    COMPUTED,
    FAINT,
    MEASURED,
    SMALL,
    Picture,
    image,
    panel_grid,
)
from geoident.report.text.case import gauge_entry

_ARROW = {"arrowstyle": "-|>", "color": MEASURED, "lw": 1.4, "shrinkA": 0, "shrinkB": 0}
_SKY, _GROUND = 0.75, (0.95, 0.93, 0.88)


def sign_pictures(result: Result) -> tuple[Picture, ...]:
    """One figure for the kinds of gauges that a result has; none where it has no known kind."""
    given = (str(gauge_entry(result, gauge).get("kind")) for gauge in result.gauges.gauges)
    kinds = tuple(kind for kind in dict.fromkeys(given) if kind in SIGNS)
    if not kinds:
        return ()
    caption = "Arrows: what gives a positive reading, if the case does not say otherwise."
    return (Picture("signs", "What counts as positive", caption, partial(signs_figure, kinds)),)


def signs_figure(kinds: Sequence[str]) -> Figure:
    """A panel for each kind of gauge.

    Args:
        kinds: some of `SIGNS`.
    """
    figure, panels = panel_grid(len(kinds), height=1.9, extra=0.1)
    for axes, kind in zip(panels, kinds, strict=True):
        draw, words = SIGNS[kind]
        axes.set_axis_off()
        axes.set_xlim(0.0, 1.6)
        axes.set_ylim(0.0, 1.0)
        axes.set_aspect("equal")
        axes.set_title(f"{kind}: {words}", fontsize=SMALL)
        draw(axes)
    return figure


def _arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float]) -> None:
    axes.annotate("", xy=end, xytext=start, arrowprops=_ARROW)


def _say(axes: Axes, x: float, y: float, words: str) -> None:
    axes.text(x, y, words, fontsize=SMALL, ha="center", va="center", color="black")


def _surface(axes: Axes) -> None:
    axes.fill_between([0.0, 1.6], 0.0, _SKY, color=_GROUND, lw=0)
    axes.plot([0.0, 1.6], [_SKY, _SKY], color=FAINT, lw=1)


def _dots(axes: Axes, *points: tuple[float, float]) -> None:
    axes.plot(*zip(*points, strict=True), "o", color=COMPUTED, ms=5)


def _apart(axes: Axes, first: tuple[float, float], second: tuple[float, float]) -> None:
    """Two points on a line, with arrows away from each other."""
    (x1, y1), (x2, y2) = first, second
    along = np.array([x2 - x1, y2 - y1]) / np.hypot(x2 - x1, y2 - y1) * 0.22
    axes.plot([x1, x2], [y1, y2], color=COMPUTED, lw=1)
    _dots(axes, first, second)
    _arrow(axes, first, (x1 - along[0], y1 - along[1]))
    _arrow(axes, second, (x2 + along[0], y2 + along[1]))


def _extensometer(axes: Axes) -> None:
    _apart(axes, (0.45, 0.55), (1.2, 0.4))
    _say(axes, 0.45, 0.75, "head")
    _say(axes, 1.2, 0.6, "anchor")


def _convergence(axes: Axes) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 80)
    axes.plot(0.8 + 0.45 * np.cos(angle), 0.5 + 0.45 * np.sin(angle), color=FAINT, lw=1)
    _apart(axes, (0.37, 0.42), (1.23, 0.42))


def _displacement(axes: Axes) -> None:
    _dots(axes, (0.5, 0.35))
    _arrow(axes, (0.5, 0.35), (1.05, 0.65))
    _say(axes, 1.1, 0.8, "component or direction")


def _settlement(axes: Axes) -> None:
    _surface(axes)
    for x in (0.4, 0.8, 1.2):
        _dots(axes, (x, _SKY))
        _arrow(axes, (x, _SKY), (x, _SKY - 0.3 * np.exp(-((x - 0.8) ** 2) * 4)))
    _say(axes, 0.8, 0.2, "down; distortion: second point down")


def _inclinometer(axes: Axes) -> None:
    _surface(axes)
    depth = np.linspace(0.1, _SKY, 30)
    axes.plot(np.full(30, 0.5), depth, "--", color=FAINT, lw=1)
    axes.plot(0.5 + 0.5 * (depth - 0.1) ** 2, depth, color=COMPUTED, lw=1.5)
    _dots(axes, (0.5, 0.1))
    _arrow(axes, (0.5, 0.65), (0.85, 0.65))
    _say(axes, 1.1, 0.6, "towards A")
    _say(axes, 0.95, 0.15, "against the bottom")


def _target(axes: Axes) -> None:
    centre = (0.7, 0.4)
    _dots(axes, centre)
    for end, name in (((0.7, 0.85), "up"), ((1.15, 0.4), "across"), ((0.4, 0.15), "along")):
        _arrow(axes, centre, end)
        _say(axes, end[0] + (0.2 if end[0] >= centre[0] else -0.18), end[1], name)


def _tilt(axes: Axes) -> None:
    axes.plot([0.6, 0.6], [0.1, 0.85], "--", color=FAINT, lw=1)
    axes.plot([0.6, 0.85], [0.1, 0.8], color=COMPUTED, lw=3)
    _arrow(axes, (0.6, 0.85), (0.84, 0.82))
    _say(axes, 1.2, 0.6, "top leans towards\nits direction")


def _line_of_sight(axes: Axes) -> None:
    _surface(axes)
    axes.plot([0.6, 1.25], [_SKY, 0.98], ":", color=FAINT, lw=1)
    axes.plot(1.25, 0.98, "s", color=COMPUTED, ms=6, clip_on=False)
    _dots(axes, (0.6, _SKY))
    _arrow(axes, (0.6, _SKY), (0.95, 0.875))
    _say(axes, 0.8, 0.4, "towards the sensor")


def _strain(axes: Axes) -> None:
    _apart(axes, (0.55, 0.65), (1.05, 0.65))
    _say(axes, 0.8, 0.4, "elongation")
    _say(axes, 0.8, 0.2, "fibres: inside is the side without ground")


def _load_cell(axes: Axes) -> None:
    _apart(axes, (0.5, 0.8), (1.1, 0.8))
    _say(axes, 0.8, 0.62, "bolt, anchor: tension")
    axes.plot([0.5, 1.1], [0.35, 0.35], color=COMPUTED, lw=3)
    _arrow(axes, (0.25, 0.35), (0.5, 0.35))
    _arrow(axes, (1.35, 0.35), (1.1, 0.35))
    _say(axes, 0.8, 0.15, "strut: compression\nM: tension on the inside")


def _pressure_cell(axes: Axes) -> None:
    axes.plot([0.8, 0.8], [0.3, 0.9], color=COMPUTED, lw=3)
    for y in (0.45, 0.6, 0.75):
        _arrow(axes, (0.45, y), (0.78, y))
        _arrow(axes, (1.15, y), (0.82, y))
    _say(axes, 0.8, 0.12, "compression, water included")


def _stress(axes: Axes) -> None:
    axes.plot([0.65, 0.95, 0.95, 0.65, 0.65], [0.4, 0.4, 0.7, 0.7, 0.4], color=COMPUTED, lw=1.5)
    for start, end in (
        ((0.95, 0.55), (1.25, 0.55)),
        ((0.65, 0.55), (0.35, 0.55)),
        ((0.8, 0.7), (0.8, 0.97)),
        ((0.8, 0.4), (0.8, 0.13)),
    ):
        _arrow(axes, start, end)
    _say(axes, 1.25, 0.2, "tension")


def _piezometer(axes: Axes) -> None:
    _surface(axes)
    axes.plot([0.78, 0.78, 0.82, 0.82], [_SKY, 0.15, 0.15, _SKY], color=COMPUTED, lw=1)
    axes.fill_between([0.78, 0.82], 0.15, 0.55, color="#56b4e9", lw=0)
    _arrow(axes, (1.0, 0.15), (1.0, 0.55))
    _say(axes, 1.25, 0.35, "pressure head")


SIGNS: Mapping[str, tuple[Callable[[Axes], None], str]] = {
    "extensometer": (_extensometer, "points move apart"),
    "convergence": (_convergence, "points move apart"),
    "displacement": (_displacement, "along the direction"),
    "settlement": (_settlement, "downwards"),
    "levelling": (_settlement, "downwards"),
    "inclinometer": (_inclinometer, "towards the axis"),
    "target": (_target, "along, across, up"),
    "tilt": (_tilt, "top leans that way"),
    "line-of-sight": (_line_of_sight, "nearer to the sensor"),
    "strain": (_strain, "longer"),
    "load-cell": (_load_cell, "as it is loaded"),
    "pressure-cell": (_pressure_cell, "pressed"),
    "stress": (_stress, "tension"),
    "piezometer": (_piezometer, "pressure"),
}
"""Kind of a gauge: its drawing, and what is positive."""


def _main() -> None:
    """Write the drawings of all kinds, for the page of instruments."""
    drawn = image(Picture("signs", "", "", partial(signs_figure, tuple(SIGNS))), "svg")
    sys.stdout.buffer.write(drawn)


if __name__ == "__main__":
    _main()

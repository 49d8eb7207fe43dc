"""What counts as positive: a small drawing for every kind of gauge."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from geoident.model.results.result import Result
from geoident.model.structures import Anchors, Beam, Bolts, Struts
from geoident.report.drawing.scene import case_of
from geoident.report.drawing.style import (
    ACCENT,
    COMPUTED,
    FAINT,
    SMALL,
    Picture,
    arrow,
    image,
    panel_grid,
)
from geoident.report.text.case import gauge_entry

_GROUND = "#e8e8e3"
_STEEL = "#8a9096"


def sign_pictures(result: Result) -> tuple[Picture, ...]:
    """The drawing for the kinds of gauges that a result has; none if it has no such gauge."""
    kinds = {str(gauge_entry(result, g).get("kind", "")) for g in result.gauges.gauges}
    present = [kind for kind in SIGNS if kind in kinds]
    if not present:
        return ()
    caption = (
        "Arrows show what has a positive reading, unless the axis of the gauge says otherwise. "
        "Without a zero the value itself is read, with a zero its change since then."
    )
    title = "What counts as positive"
    absent = _absent(result)
    return (Picture("signs", title, caption, lambda: signs_figure(present, absent)),)


def _absent(result: Result) -> tuple[str, ...]:
    """Titles of panels of structures on which no load cell of a result sits."""
    case = case_of(result)
    if case is None:
        return ()
    cells = {c.structure for c in case.channels if c.kind == "load-cell"} & set(case.structures)
    built = tuple(case.structures[name] for name in cells)
    return tuple(
        title
        for title, kinds in _ON.items()
        if built and not any(isinstance(one, kinds) for one in built)
    )


def signs_figure(kinds: Sequence[str], absent: Sequence[str] = ()) -> Figure:
    """A panel for each of some kinds of gauges.

    Args:
        kinds: keys of `SIGNS`.
        absent: titles of panels that are left out.
    """
    drawn = [sign for kind in kinds for sign in SIGNS[kind] if sign[0] not in absent]
    figure, panels = panel_grid(len(drawn), height=1.9, extra=0.1)
    for axes, (title, draw) in zip(panels, drawn, strict=True):
        axes.set_xlim(-1.5, 1.5)
        axes.set_ylim(-1.0, 1.0)
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set_title(title, fontsize=SMALL + 1)
        draw(axes)
    return figure


def _arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float]) -> None:
    axes.annotate("", xy=end, xytext=start, arrowprops=arrow(ACCENT, 1.4))


def _box(axes: Axes, low: tuple[float, float], size: tuple[float, float], colour: str) -> None:
    axes.add_patch(Rectangle(low, *size, facecolor=colour, edgecolor=FAINT, lw=0.8))


def _word(axes: Axes, x: float, y: float, text: str) -> None:
    axes.text(x, y, text, ha="center", va="center", fontsize=SMALL)


_SKY = 0.75
"""Level of the ground in the drawings of motions, whose frame is 1.6 wide and 1 high."""


def _frame(axes: Axes) -> None:
    axes.set_xlim(0.0, 1.6)
    axes.set_ylim(0.0, 1.0)


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
    _frame(axes)
    _apart(axes, (0.45, 0.55), (1.2, 0.4))
    _word(axes, 0.45, 0.75, "head")
    _word(axes, 1.2, 0.6, "anchor")


def _convergence(axes: Axes) -> None:
    _frame(axes)
    angle = np.linspace(0.0, 2.0 * np.pi, 80)
    axes.plot(0.8 + 0.45 * np.cos(angle), 0.5 + 0.45 * np.sin(angle), color=FAINT, lw=1)
    _apart(axes, (0.37, 0.42), (1.23, 0.42))


def _displacement(axes: Axes) -> None:
    _frame(axes)
    _dots(axes, (0.5, 0.35))
    _arrow(axes, (0.5, 0.35), (1.05, 0.65))
    _word(axes, 1.1, 0.8, "component or direction")


def _going_down(axes: Axes) -> None:
    _frame(axes)
    _surface(axes)
    for x in (0.4, 0.8, 1.2):
        _dots(axes, (x, _SKY))
        _arrow(axes, (x, _SKY), (x, _SKY - 0.3 * np.exp(-((x - 0.8) ** 2) * 4)))
    _word(axes, 0.8, 0.2, "down; distortion: second point down")


def _inclinometer(axes: Axes) -> None:
    _frame(axes)
    _surface(axes)
    depth = np.linspace(0.1, _SKY, 30)
    axes.plot(np.full(30, 0.5), depth, "--", color=FAINT, lw=1)
    axes.plot(0.5 + 0.5 * (depth - 0.1) ** 2, depth, color=COMPUTED, lw=1.5)
    _dots(axes, (0.5, 0.1))
    _arrow(axes, (0.5, 0.65), (0.85, 0.65))
    _word(axes, 1.1, 0.6, "towards A")
    _word(axes, 0.95, 0.15, "against the bottom")


def _target(axes: Axes) -> None:
    _frame(axes)
    centre = (0.7, 0.4)
    _dots(axes, centre)
    for end, name in (((0.7, 0.85), "up"), ((1.15, 0.4), "across"), ((0.4, 0.15), "along")):
        _arrow(axes, centre, end)
        _word(axes, end[0] + (0.2 if end[0] >= centre[0] else -0.18), end[1], name)


def _tilt(axes: Axes) -> None:
    _frame(axes)
    axes.plot([0.6, 0.6], [0.1, 0.85], "--", color=FAINT, lw=1)
    axes.plot([0.6, 0.85], [0.1, 0.8], color=COMPUTED, lw=3)
    _arrow(axes, (0.6, 0.85), (0.84, 0.82))
    _word(axes, 1.2, 0.6, "top leans towards\nits direction")


def _line_of_sight(axes: Axes) -> None:
    _frame(axes)
    _surface(axes)
    axes.plot([0.6, 1.25], [_SKY, 0.98], ":", color=FAINT, lw=1)
    axes.plot(1.25, 0.98, "s", color=COMPUTED, ms=6, clip_on=False)
    _dots(axes, (0.6, _SKY))
    _arrow(axes, (0.6, _SKY), (0.95, 0.875))
    _word(axes, 0.8, 0.4, "towards the sensor")


def _stress(axes: Axes) -> None:
    _box(axes, (-0.35, -0.35), (0.7, 0.7), _GROUND)
    for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        _arrow(axes, (0.35 * x, 0.35 * y), (0.85 * x, 0.85 * y))
    _arrow(axes, (0.5, -0.3), (0.5, 0.3))
    _arrow(axes, (-0.3, 0.5), (0.3, 0.5))
    _word(axes, 1.15, 0.0, "xx")
    _word(axes, 0.0, -0.95, "yy")
    _word(axes, 0.72, 0.42, "xy")


def _pressure(axes: Axes) -> None:
    _box(axes, (-1.0, -0.9), (2.0, 0.8), _GROUND)
    _box(axes, (-1.0, 0.1), (2.0, 0.8), _GROUND)
    _box(axes, (-0.7, -0.1), (1.4, 0.2), _STEEL)
    for x in (-0.4, 0.0, 0.4):
        _arrow(axes, (x, 0.75), (x, 0.12))
        _arrow(axes, (x, -0.75), (x, -0.12))


def _water(axes: Axes) -> None:
    _box(axes, (-0.12, -0.12), (0.24, 0.24), _STEEL)
    for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        _arrow(axes, (0.7 * x, 0.7 * y), (0.15 * x, 0.15 * y))


def _strain(axes: Axes) -> None:
    _box(axes, (-0.6, -0.2), (1.2, 0.4), _GROUND)
    _arrow(axes, (0.6, 0.0), (1.1, 0.0))
    _arrow(axes, (-0.6, 0.0), (-1.1, 0.0))


def _pulled(axes: Axes) -> None:
    _box(axes, (-0.7, -0.07), (1.4, 0.14), _STEEL)
    _arrow(axes, (0.7, 0.0), (1.2, 0.0))
    _arrow(axes, (-0.7, 0.0), (-1.2, 0.0))


def _pushed(axes: Axes) -> None:
    _box(axes, (-0.7, -0.07), (1.4, 0.14), _STEEL)
    _arrow(axes, (1.2, 0.0), (0.72, 0.0))
    _arrow(axes, (-1.2, 0.0), (-0.72, 0.0))


def _beam(axes: Axes) -> None:
    _box(axes, (-1.2, -0.9), (1.1, 1.8), _GROUND)
    _box(axes, (-0.1, -0.7), (0.2, 1.4), _STEEL)
    _word(axes, -0.65, 0.0, "ground")
    _word(axes, 0.95, 0.85, "inside")
    _arrow(axes, (0.0, -0.6), (0.0, 0.95))
    _word(axes, -0.2, 0.85, "s")
    _arrow(axes, (0.18, 0.1), (0.18, 0.6))
    _arrow(axes, (0.18, -0.1), (0.18, -0.6))
    _word(axes, 0.85, 0.0, "M: tension here,\nQ = dM/ds,\nN: tension")


_BOLT, _STRUT, _LINING = "bolt, anchor: tension", "strut: compression", "beam: N, M, Q"
_ON: dict[str, tuple[type, ...]] = {_BOLT: (Bolts, Anchors), _STRUT: (Struts,), _LINING: (Beam,)}
"""Panels of load cells, and the structures that they are of."""

SIGNS: dict[str, tuple[tuple[str, Callable[[Axes], None]], ...]] = {
    "extensometer": (("extensometer: points move apart", _extensometer),),
    "convergence": (("convergence: points move apart", _convergence),),
    "displacement": (("displacement: along the direction", _displacement),),
    "settlement": (("settlement: downwards", _going_down),),
    "levelling": (("levelling: downwards", _going_down),),
    "inclinometer": (("inclinometer: towards the axis", _inclinometer),),
    "target": (("target: along, across, up", _target),),
    "tilt": (("tilt: top leans that way", _tilt),),
    "line-of-sight": (("line of sight: nearer to the sensor", _line_of_sight),),
    "stress": (("stress: tension", _stress),),
    "pressure-cell": (("pressure cell: compression", _pressure),),
    "piezometer": (("piezometer: pressure", _water),),
    "strain": (("strain: elongation", _strain),),
    "load-cell": (
        (_BOLT, _pulled),
        (_STRUT, _pushed),
        (_LINING, _beam),
    ),
}
"""Kind of a gauge to its panels: what counts as positive, and its drawing."""


def _main() -> None:
    """Write the drawings of all kinds, for the page of instruments."""
    picture = Picture("signs", "", "", lambda: signs_figure(tuple(SIGNS)))
    sys.stdout.buffer.write(image(picture, "svg"))


if __name__ == "__main__":
    _main()

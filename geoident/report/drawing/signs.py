"""What counts as positive: a small drawing for every kind of gauge.

``python -m geoident.report.drawing.signs > signs.svg`` writes all of them, for the page of
instruments.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from geoident.model.results.result import Result
from geoident.model.structures import Anchors, Beam, Bolts, GroutedBars, Struts
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
    drawn = [(title, sign) for kind in kinds for title, sign in SIGNS[kind].items()
             if title not in absent]  # fmt: skip
    figure, panels = panel_grid(len(drawn), height=1.9, extra=0.1)
    for axes, (title, (frame, *shapes)) in zip(panels, drawn, strict=True):
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set_title(title, fontsize=SMALL + 1)
        axes.set_xlim(*frame[0])
        axes.set_ylim(*frame[1])
        for draw, *arguments in shapes:
            draw(axes, *arguments)
    return figure


Point = tuple[float, float]
_SKY = 0.75
"""Level of the ground in the drawings of motions."""
_MOTION = (0.0, 1.6), (0.0, 1.0)
_FORCE = (-1.5, 1.5), (-1.0, 1.0)
"""Ends of the axes of drawings of motions, and of those of stresses and forces."""


def _arrow(axes: Axes, start: Point, end: Point) -> None:
    axes.annotate("", xy=end, xytext=start, arrowprops=arrow(ACCENT, 1.4))


def _box(axes: Axes, low: Point, size: Point, colour: str) -> None:
    axes.add_patch(Rectangle(low, *size, facecolor=colour, edgecolor=FAINT, lw=0.8))


def _word(axes: Axes, x: float, y: float, text: str) -> None:
    axes.text(x, y, text, ha="center", va="center", fontsize=SMALL)


def _line(axes: Axes, x: Any, y: Any, style: str, colour: str, width: float) -> None:
    axes.plot(x, y, style, color=colour, lw=width)


def _surface(axes: Axes) -> None:
    axes.fill_between([0.0, 1.6], 0.0, _SKY, color=_GROUND, lw=0)
    axes.plot([0.0, 1.6], [_SKY, _SKY], color=FAINT, lw=1)


def _dots(axes: Axes, *points: Point) -> None:
    axes.plot(*zip(*points, strict=True), "o", color=COMPUTED, ms=5)


def _apart(axes: Axes, first: Point, second: Point) -> None:
    """Two points on a line, with arrows away from each other."""
    (x1, y1), (x2, y2) = first, second
    along = np.array([x2 - x1, y2 - y1]) / np.hypot(x2 - x1, y2 - y1) * 0.22
    axes.plot([x1, x2], [y1, y2], color=COMPUTED, lw=1)
    _dots(axes, first, second)
    _arrow(axes, first, (x1 - along[0], y1 - along[1]))
    _arrow(axes, second, (x2 + along[0], y2 + along[1]))


def _settle(axes: Axes) -> None:
    """Points of the surface that go down, those in the middle most."""
    _surface(axes)
    for x in (0.4, 0.8, 1.2):
        _dots(axes, (x, _SKY))
        _arrow(axes, (x, _SKY), (x, _SKY - 0.3 * np.exp(-((x - 0.8) ** 2) * 4)))


def _all_sides(axes: Axes, start: float, end: float) -> None:
    """Arrows along both axes from one distance of the middle to another."""
    for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        _arrow(axes, (start * x, start * y), (end * x, end * y))


def _satellite(axes: Axes) -> None:
    axes.plot([0.6, 1.25], [_SKY, 0.98], ":", color=FAINT, lw=1)
    axes.plot(1.25, 0.98, "s", color=COMPUTED, ms=6, clip_on=False)


_TURN, _DEPTH = np.linspace(0.0, 2.0 * np.pi, 80), np.linspace(0.1, _SKY, 30)
_BOLT, _STRUT, _LINING = "bolt, anchor: tension", "strut: compression", "beam: N, M, Q"
_ON: dict[str, tuple[type, ...]] = {
    _BOLT: (Bolts, Anchors, GroutedBars),
    _STRUT: (Struts,),
    _LINING: (Beam,),
}
"""Panels of load cells, and the structures that they are of."""

_DOWN: Any = (_MOTION, (_settle,), (_word, 0.8, 0.2, "down; distortion: second point down"))
_BAR: Any = (_box, (-0.7, -0.07), (1.4, 0.14), _STEEL)
SIGNS: dict[str, dict[str, Any]] = {
    "extensometer": {"extensometer: points move apart": (
        _MOTION, (_apart, (0.45, 0.55), (1.2, 0.4)), (_word, 0.45, 0.75, "head"),
        (_word, 1.2, 0.6, "anchor"),
    )},
    "convergence": {"convergence: points move apart": (
        _MOTION,
        (_line, 0.8 + 0.45 * np.cos(_TURN), 0.5 + 0.45 * np.sin(_TURN), "-", FAINT, 1),
        (_apart, (0.37, 0.42), (1.23, 0.42)),
    )},
    "displacement": {"displacement: along the direction": (
        _MOTION, (_dots, (0.5, 0.35)), (_arrow, (0.5, 0.35), (1.05, 0.65)),
        (_word, 1.1, 0.8, "component or direction"),
    )},
    "settlement": {"settlement: downwards": _DOWN},
    "levelling": {"levelling: downwards": _DOWN},
    "inclinometer": {"inclinometer: towards the axis": (
        _MOTION, (_surface,), (_line, np.full(30, 0.5), _DEPTH, "--", FAINT, 1),
        (_line, 0.5 + 0.5 * (_DEPTH - 0.1) ** 2, _DEPTH, "-", COMPUTED, 1.5),
        (_dots, (0.5, 0.1)), (_arrow, (0.5, 0.65), (0.85, 0.65)),
        (_word, 1.1, 0.6, "towards A"), (_word, 0.95, 0.15, "against the bottom"),
    )},
    "target": {"target: along, across, up": (
        _MOTION, (_dots, (0.7, 0.4)),
        (_arrow, (0.7, 0.4), (0.7, 0.85)), (_word, 0.9, 0.85, "up"),
        (_arrow, (0.7, 0.4), (1.15, 0.4)), (_word, 1.35, 0.4, "across"),
        (_arrow, (0.7, 0.4), (0.4, 0.15)), (_word, 0.22, 0.15, "along"),
    )},
    "tilt": {"tilt: top leans that way": (
        _MOTION, (_line, [0.6, 0.6], [0.1, 0.85], "--", FAINT, 1),
        (_line, [0.6, 0.85], [0.1, 0.8], "-", COMPUTED, 3), (_arrow, (0.6, 0.85), (0.84, 0.82)),
        (_word, 1.2, 0.6, "top leans towards\nits direction"),
    )},
    "line-of-sight": {"line of sight: nearer to the sensor": (
        _MOTION, (_surface,), (_satellite,), (_dots, (0.6, _SKY)),
        (_arrow, (0.6, _SKY), (0.95, 0.875)), (_word, 0.8, 0.4, "towards the sensor"),
    )},
    "stress": {"stress: tension": (
        _FORCE, (_box, (-0.35, -0.35), (0.7, 0.7), _GROUND), (_all_sides, 0.35, 0.85),
        (_arrow, (0.5, -0.3), (0.5, 0.3)), (_arrow, (-0.3, 0.5), (0.3, 0.5)),
        (_word, 1.15, 0.0, "xx"), (_word, 0.0, -0.95, "yy"), (_word, 0.72, 0.42, "xy"),
    )},
    "pressure-cell": {"pressure cell: compression": (
        _FORCE, (_box, (-1.0, -0.9), (2.0, 0.8), _GROUND), (_box, (-1.0, 0.1), (2.0, 0.8), _GROUND),
        (_box, (-0.7, -0.1), (1.4, 0.2), _STEEL),
        *((_arrow, (x, 0.75 * up), (x, 0.12 * up)) for x in (-0.4, 0.0, 0.4) for up in (1, -1)),
    )},
    "piezometer": {"piezometer: pressure": (
        _FORCE, (_box, (-0.12, -0.12), (0.24, 0.24), _STEEL), (_all_sides, 0.7, 0.15),
    )},
    "joint-meter": {"joint meter: opening": (
        _FORCE, (_box, (-1.0, -0.7), (0.9, 1.4), _GROUND), (_box, (0.1, -0.7), (0.9, 1.4), _GROUND),
        (_arrow, (-0.15, 0.2), (-0.7, 0.2)), (_arrow, (0.15, 0.2), (0.7, 0.2)),
    )},
    "bar-displacement": {"bar: bolts outwards, piles inwards": (
        _FORCE, (_box, (-0.3, -0.8), (1.5, 1.6), _GROUND), (_box, (-0.7, 0.3), (1.6, 0.14), _STEEL),
        (_arrow, (-0.75, 0.37), (-1.3, 0.37)), (_word, 0.5, 0.65, "bolt"),
        (_box, (-0.7, -0.4), (1.6, 0.14), _STEEL), (_arrow, (-1.3, -0.33), (-0.75, -0.33)),
        (_word, 0.5, -0.6, "pile"),
    )},
    "thermometer": {"thermometer: temperature": (
        _FORCE, (_box, (-0.12, -0.6), (0.24, 1.2), _STEEL), (_word, 0.5, 0.4, "T"),
    )},
    "strain": {"strain: elongation": (
        _FORCE, (_box, (-0.6, -0.2), (1.2, 0.4), _GROUND),
        (_arrow, (0.6, 0.0), (1.1, 0.0)), (_arrow, (-0.6, 0.0), (-1.1, 0.0)),
    )},
    "load-cell": {
        _BOLT: (
            _FORCE, _BAR, (_arrow, (0.7, 0.0), (1.2, 0.0)), (_arrow, (-0.7, 0.0), (-1.2, 0.0)),
        ),
        _STRUT: (
            _FORCE, _BAR, (_arrow, (1.2, 0.0), (0.72, 0.0)), (_arrow, (-1.2, 0.0), (-0.72, 0.0)),
        ),
        _LINING: (
            _FORCE, (_box, (-1.2, -0.9), (1.1, 1.8), _GROUND),
            (_box, (-0.1, -0.7), (0.2, 1.4), _STEEL),
            (_word, -0.65, 0.0, "ground"), (_word, 0.95, 0.85, "inside"),
            (_arrow, (0.0, -0.6), (0.0, 0.95)), (_word, -0.2, 0.85, "s"),
            (_arrow, (0.18, 0.1), (0.18, 0.6)), (_arrow, (0.18, -0.1), (0.18, -0.6)),
            (_word, 0.85, 0.0, "M: tension here,\nQ = dM/ds,\nN: tension"),
        ),
    },
}  # fmt: skip
"""Kind of a gauge to its panels: their titles with the ends of the axes and what is drawn."""


def _main() -> None:
    """Write the drawings of all kinds."""
    picture = Picture("signs", "", "", lambda: signs_figure(tuple(SIGNS)))
    sys.stdout.buffer.write(image(picture, "svg"))


if __name__ == "__main__":
    _main()

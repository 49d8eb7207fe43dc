"""What counts as positive: a small drawing for every kind of gauge of stresses and forces."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from geoident.model.result import Result
from geoident.report.drawing.style import FAINT, MEASURED, SMALL, Picture, panel_grid
from geoident.report.text.case import gauge_entry

_ARROW = {"arrowstyle": "-|>", "color": MEASURED, "lw": 1.4, "shrinkA": 0, "shrinkB": 0}
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
    return (Picture("signs", title, caption, lambda: signs_figure(present)),)


def signs_figure(kinds: Sequence[str]) -> Figure:
    """A panel for each of some kinds of gauges, keys of `SIGNS`."""
    drawn = [sign for kind in kinds for sign in SIGNS[kind]]
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
    axes.annotate("", xy=end, xytext=start, arrowprops=_ARROW)


def _box(axes: Axes, low: tuple[float, float], size: tuple[float, float], colour: str) -> None:
    axes.add_patch(Rectangle(low, *size, facecolor=colour, edgecolor=FAINT, lw=0.8))


def _word(axes: Axes, x: float, y: float, text: str) -> None:
    axes.text(x, y, text, ha="center", va="center", fontsize=SMALL)


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


SIGNS: dict[str, tuple[tuple[str, Callable[[Axes], None]], ...]] = {
    "stress": (("stress: tension", _stress),),
    "pressure-cell": (("pressure cell: compression", _pressure),),
    "piezometer": (("piezometer: pressure", _water),),
    "strain": (("strain: elongation", _strain),),
    "load-cell": (
        ("bolt, anchor: tension", _pulled),
        ("strut: compression", _pushed),
        ("beam: N, M, Q", _beam),
    ),
}
"""Kind of a gauge to its panels: what counts as positive, and its drawing."""

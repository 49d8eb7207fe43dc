"""Drawings of the page of conventions: axes, stages and dates, zero readings."""

from __future__ import annotations

import io
from collections.abc import Callable

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

INK = "#1b2a38"
BLUE = "#1f4e79"
LIGHT = "#c9d6e2"
GROUND = "#e8e8e3"
STYLE = {"svg.hashsalt": "geoident", "svg.fonttype": "none", "font.size": 9.0}
ARROW = {"arrowstyle": "-|>", "color": INK, "lw": 1.3, "shrinkA": 0, "shrinkB": 0}


def svg(draw: Callable[[], Figure]) -> bytes:
    """A drawing as SVG: text as text, the same bytes each time."""
    kept = io.BytesIO()
    with rc_context(STYLE):
        draw().savefig(kept, format="svg", metadata={"Date": None}, bbox_inches="tight")
    return kept.getvalue()


def axes_drawing() -> Figure:
    """Axes in a plane, about an axis, in space; dip and dip direction."""
    figure = Figure(figsize=(8.4, 2.3), layout="constrained")
    panels = figure.subplots(1, 4)
    for axes, draw in zip(panels, (_plane, _revolved, _solid, _dip), strict=True):
        axes.set_xlim(-1.3, 1.5)
        axes.set_ylim(-1.3, 1.3)
        axes.set_aspect("equal")
        axes.set_axis_off()
        draw(axes)
    return figure


def stages_drawing() -> Figure:
    """A line of time with stages, the states at their ends, a gauge and its readings."""
    figure = Figure(figsize=(8.4, 2.7), layout="constrained")
    axes = figure.subplots()
    axes.set_xlim(-0.9, 10.4)
    axes.set_ylim(-2.3, 2.1)
    axes.set_axis_off()
    ends = {"heading": 2.6, "bench 1": 6.0, "bench 2": 9.2}
    axes.annotate("", xy=(10.3, 0), xytext=(-0.6, 0), arrowprops=ARROW)
    axes.text(10.35, 0.0, "time", ha="left", va="center", color=INK)
    start = 0.0
    axes.plot(start, 0, "o", color=INK)
    axes.text(start, -0.45, "virgin", ha="center", color=INK)
    for name, end in ends.items():
        axes.fill_between([start, end], -0.12, 0.12, color=LIGHT, lw=0)
        axes.text(0.5 * (start + end) + 0.1, 0.42, f"stage {name}", ha="center", color=BLUE)
        axes.plot(end, 0, "o", color=INK)
        axes.text(end, -0.45, "its date: complete", ha="center", color=INK)
        start = end
    axes.annotate(
        "zero: heading\n(installed, first reading)", xy=(2.6, 0.1), xytext=(2.6, 1.45),
        ha="center", color=INK, arrowprops=ARROW,
    )  # fmt: skip
    for place in (4.2, 6.4, 7.6):
        axes.plot(place, -1.25, "o", color="white", markeredgecolor=INK)
    axes.text(
        4.2, -1.75, "read before bench 1 is complete:\nof heading, and zero there", ha="center"
    )
    axes.text(7.0, -1.75, "of bench 1: the change\nsince heading", ha="center")
    axes.text(0.0, -1.36, "readings", ha="center", color=INK)
    return figure


def _axis(
    axes: Axes, end: tuple[float, float], name: str, start: tuple[float, float] = (0, 0)
) -> None:
    axes.annotate("", xy=end, xytext=start, arrowprops=ARROW)
    along = "left" if end[0] > start[0] else "center"
    axes.text(end[0] + (end[0] > start[0]) * 0.06, end[1] + 0.12, name, ha=along, color=INK)


def _plane(axes: Axes) -> None:
    axes.set_title("plane strain", fontsize=9)
    axes.fill([-1.1, 1.1, 1.1, -1.1], [-1.1, -1.1, 0.9, 0.9], color=GROUND, lw=0)
    _axis(axes, (0.9, 0), "x")
    _axis(axes, (0, 0.9), "y")
    axes.text(0.0, -0.7, "z: out of plane", ha="center", color=INK)


def _revolved(axes: Axes) -> None:
    axes.set_title("axisymmetric", fontsize=9)
    axes.fill([0, 1.1, 1.1, 0], [-1.1, -1.1, 0.9, 0.9], color=GROUND, lw=0)
    axes.plot([0, 0], [-1.2, 1.2], color=INK, lw=0.8, ls="-.")
    _axis(axes, (0.9, 0), "x")
    _axis(axes, (0, 0.9), "y")
    axes.text(0.6, -0.35, "radius", ha="center", color=INK)
    axes.text(-0.12, 0.3, "axis", ha="right", color=INK)
    axes.text(0.55, -0.85, "stress zz:\nhoop", ha="center", color=INK)


def _solid(axes: Axes) -> None:
    axes.set_title("solid", fontsize=9)
    _axis(axes, (1.0, -0.18), "x, east")
    _axis(axes, (0.62, 0.55), "y, north")
    _axis(axes, (0, 1.0), "z, up")
    axes.text(0.0, -0.85, "gravity along -z", ha="center", color=INK)


def _dip(axes: Axes) -> None:
    axes.set_title("strata in a plane", fontsize=9)
    for k in range(-2, 2):
        axes.plot([-1.1, 1.1], [0.35 * k + 0.35, 0.35 * k - 0.55], color=BLUE, lw=1.0)
    axes.plot([-0.2, 0.9], [-0.02, -0.02], color=INK, lw=0.8, ls=":")
    axes.annotate(
        "",
        xy=(0.72, -0.39),
        xytext=(0.78, -0.02),
        arrowprops={**ARROW, "connectionstyle": "arc3,rad=-0.2"},
    )
    axes.text(0.88, -0.22, "dip", color=INK)
    _axis(axes, (1.15, -1.15), "x", (0.3, -1.15))
    axes.text(0.0, 0.98, "dip > 0: falling towards +x", ha="center", color=INK)


DRAWINGS: dict[str, Callable[[], Figure]] = {"axes": axes_drawing, "stages": stages_drawing}

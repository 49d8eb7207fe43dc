"""Openings: in closed form a sketch, ground reaction and stresses; a tunnel face that advances."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from geoident.model.arrays import Floats
from geoident.model.results.opening import FaceAdvance, GroundReaction
from geoident.model.results.result import Result
from geoident.report.drawing.labels import place_labels
from geoident.report.drawing.style import (
    ACCENT,
    COMPUTED,
    FAINT,
    MEASURED,
    MM,
    SMALL,
    WIDTH,
    Picture,
    arrow,
    colour,
    evenly,
    key,
    short,
    stress_unit,
)
from geoident.report.text.layout import number

_GROUND, _YIELDED, _LOST = "#e8e8e3", "#c9b79c", "#e4e4e4"
_MOST_STAGES = 5


def opening_pictures(result: Result) -> tuple[Picture, ...]:
    """The opening of a closed form and its ground reaction; none of other results."""
    reaction = result.reaction
    if reaction is None:
        return ()
    yields = bool(np.isfinite(reaction.stage_plastic_radius).any())
    supported = "; thick: pressure of all supports" if reaction.supports else ""
    taken = " Orange: the gauges to take." if result.plan is not None else ""
    zone = " The brown ground yields at the last stage with a closed form." if yields else ""
    return (
        Picture(
            "opening",
            "The opening, its gauges and the in-situ stress",
            "Lines and dots: gauges. Arrows: in-situ stress, positive in compression."
            f"{zone}{taken}",
            lambda: sketch_figure(result, reaction),
        ),
        Picture(
            "ground-reaction",
            "Ground reaction",
            "Left: pressure inside the opening against the motion of the wall inwards, by the "
            "identified parameters; dots: the stages; dotted: from there on the wall yields"
            f"{supported}. "
            "Middle: how far the ground yields. Right: radial stress (dashed) and stress around "
            "the opening (solid) at the stages.",
            lambda: reaction_figure(reaction),
        ),
    )


def _unit(reaction: GroundReaction) -> tuple[str, float]:
    """Unit of stresses, and how many Pa it has."""
    return stress_unit(float(np.abs(reaction.in_situ).max()))


def sketch_figure(result: Result, reaction: GroundReaction) -> Figure:
    """The opening with the ground that yields, gauges with their names and the in-situ stress."""
    figure = Figure(figsize=(6.2, 6.2))
    axes = figure.subplots()
    a, (x, y) = reaction.radius, reaction.centre
    known = reaction.stage_plastic_radius[np.isfinite(reaction.stage_plastic_radius)]
    yielded = float(known[-1]) if known.size else np.nan
    points = np.concatenate([result.gauges.first, result.gauges.second])
    points = points[np.isfinite(points).all(axis=1)]
    away = np.abs(points - reaction.centre).max(initial=0.0)
    reach = 1.12 * max(2.0 * a, 1.15 * np.nan_to_num(yielded), away)
    axes.set_facecolor(_GROUND)
    if np.isfinite(yielded):
        axes.add_patch(Circle((x, y), yielded, facecolor=_YIELDED, edgecolor=FAINT, ls="--"))
    axes.add_patch(Circle((x, y), a, facecolor="white", edgecolor="black", lw=1.6))
    edge = 1.28 * reach
    axes.set_xlim(x - edge, x + edge)
    axes.set_ylim(y - edge, y + edge)
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    _draw_stress(axes, reaction, edge)
    _draw_gauges(axes, result, reaction, yielded)
    return figure


def _draw_stress(axes: Axes, reaction: GroundReaction, edge: float) -> None:
    """Arrows from the four sides with the stresses at the centre."""
    unit, size = _unit(reaction)
    x, y = reaction.centre
    for k, name in enumerate(("xx", "yy")):
        stress = float(reaction.in_situ[k])
        for side in (-1.0, 1.0):
            for along in (-0.35, 0.0, 0.35):
                ends = np.full((2, 2), along * edge)
                ends[:, k] = side * edge * np.array([0.985, 0.885])
                if stress < 0.0:
                    ends = ends[::-1]
                tail, head = ends + reaction.centre
                axes.annotate("", xy=tuple(head), xytext=tuple(tail), arrowprops=arrow(ACCENT, 1.6))
        place = np.array([x, y])
        place[k] -= 0.84 * edge
        place[1 - k] += 0.17 * edge
        words = f"{name} {number(stress / size, 3)} {unit}"
        axes.text(float(place[0]), float(place[1]), words, fontsize=SMALL, color=ACCENT,
                  ha="left" if k == 0 else "center", va="center")  # fmt: skip


def _draw_gauges(axes: Axes, result: Result, reaction: GroundReaction, yielded: float) -> None:
    """Gauges as lines and dots with the names of their channels, and the radii."""
    table = result.gauges
    marked = () if result.plan is None else [one.gauge for one in result.plan.chosen]
    anchors: list[Floats] = []
    names: list[str] = []
    lines: list[Floats] = []
    every = zip(table.channels, table.gauges, table.first, table.second, strict=True)
    for channel, gauge, first, second in every:
        if not np.isfinite(second).all():
            continue
        ends = np.stack([first, second]) if np.isfinite(first).all() else second[None]
        colour_of = ACCENT if gauge in marked else MEASURED
        axes.plot(*ends.T, "-o", color=colour_of, lw=1.0, ms=3.2)
        anchors.append(second)
        names.append(short(channel, 16))
        lines.append(ends)
    turn = np.deg2rad(225.0)
    direction = np.array([np.cos(turn), np.sin(turn)])
    for radius, letter in ((reaction.radius, "a"), (yielded, "R")):
        if np.isfinite(radius):
            anchors.append(reaction.centre + radius * direction)
            names.append(f"{letter} = {number(radius, 3)} m")
            lines.append(anchors[-1][None])
    place_labels(axes, anchors, names, avoid=lines)


def reaction_figure(reaction: GroundReaction) -> Figure:
    """Pressure against the motion of the wall, the plastic radius, stresses against the radius."""
    figure = Figure(figsize=(WIDTH, 3.6))
    left, middle, right = figure.subplots(1, 3)
    unit, size = _unit(reaction)
    inward, pressure = MM * reaction.displacement, reaction.pressure / size
    left.plot(inward, pressure, color=COMPUTED, lw=1.4)
    left.set_xlabel("wall inwards (mm)")
    left.set_ylabel(f"pressure inside ({unit})")
    _draw_stages(left, reaction, MM * reaction.stage_displacement, reaction.stage_pressure / size)
    if reaction.support_pressure is not None:
        standing = np.isfinite(reaction.support_pressure)
        first = max(int(np.argmax(standing.any(axis=0))) - 1, 0)  # they begin where the wall was
        pressed = np.where(standing, reaction.support_pressure, 0.0).sum(axis=0)[first:]
        moved = MM * reaction.stage_displacement[first:]
        left.plot(moved, pressed / size, color=ACCENT, lw=2.4)
    if np.isfinite(reaction.plastic_radius).any():
        middle.plot(reaction.plastic_radius, pressure, color=COMPUTED, lw=1.4)
        _draw_stages(
            middle, reaction, reaction.stage_plastic_radius, reaction.stage_pressure / size
        )
    else:
        middle.text(0.5, 0.5, "the ground stays elastic", transform=middle.transAxes, ha="center",
                    fontsize=SMALL, color=FAINT)  # fmt: skip
    middle.axvline(reaction.radius, color="black", lw=1.0)
    middle.set_xlabel("radius of what yields (m)")
    middle.set_ylabel(f"pressure inside ({unit})")
    for axes in (left, middle):
        axes.set_ylim(min(0.0, float(pressure.min())), 1.06 * float(pressure.max()))
        if np.isfinite(reaction.critical) and reaction.critical > float(reaction.pressure.min()):
            axes.axhline(reaction.critical / size, color=FAINT, lw=0.9, ls=":")
        axes.grid()
    left.set_xlim(left=min(0.0, float(inward.min())))
    _draw_stresses(right, reaction)
    return figure


def _draw_stages(axes: Axes, reaction: GroundReaction, x: Floats, y: Floats) -> None:
    known = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    axes.plot(x[known], y[known], "o", color=MEASURED, ms=4.5, clip_on=False)
    drawn = axes.get_lines()[0].get_xydata()
    curve = np.asarray(drawn, dtype=np.float64)
    place_labels(
        axes,
        [np.array([x[k], y[k]]) for k in known],
        [short(reaction.stages[k], 18) for k in known],
        avoid=[curve[np.isfinite(curve).all(axis=1)]],
    )


def _draw_stresses(axes: Axes, reaction: GroundReaction) -> None:
    unit, size = _unit(reaction)
    numbers = evenly(len(reaction.stages), _MOST_STAGES)
    for k, stage in enumerate(numbers):
        axes.plot(reaction.radii, reaction.hoop[stage] / size, color=colour(k), lw=1.2)
        axes.plot(reaction.radii, reaction.radial[stage] / size, "--", color=colour(k), lw=1.2)
    mean = 0.5 * float(reaction.in_situ[0] + reaction.in_situ[1])
    axes.axhline(mean / size, color=FAINT, lw=0.8, ls=":")
    axes.set_xlabel("distance from the centre (m)")
    axes.set_ylabel(f"stress ({unit}, compression)")
    axes.set_xlim(reaction.radius, float(reaction.radii.max()))
    axes.set_ylim(bottom=min(0.0, float(reaction.radial.min() / size)))
    axes.grid()
    axes.legend(handles=[
        *(key(short(reaction.stages[stage], 16), color=colour(k))
          for k, stage in enumerate(numbers)),
        key("radial", color="black", ls="--"), key("around", color="black"),
    ])  # fmt: skip


def advance_pictures(result: Result) -> tuple[Picture, ...]:
    """The profile with the stages on it; none for a case without distances to a face."""
    advance = result.advance
    if advance is None or not advance.stages:
        return ()
    lost = ""
    if advance.lost is not None:
        lost = (
            f" Grey: the {100.0 * advance.lost:.3g} % of the motion before the first gauges read "
        )
        lost += "zero (dashed)."
    caption = (
        "Line: part of its final motion that the wall without support has made, by the distance of "
        "its section behind the face; dots: the stages. Squares: part of the stress that is "
        f"released at each of them.{lost}"
    )
    title = "Motion of the wall and released stress as the face advances"
    return (Picture("face-profile", title, caption, lambda: advance_figure(advance)),)


def advance_figure(advance: FaceAdvance) -> Figure:
    """The profile over the distance, the stages, what they release, and where gauges read zero."""
    figure = Figure(figsize=(7.2, 3.6))
    axes = figure.subplots()
    axes.plot(advance.distance, 100.0 * advance.share, color=COMPUTED, lw=1.4)
    x, share, released = advance.stage_distance, 100.0 * advance.stage_share, advance.stage_released
    axes.plot(x, share, "o", color=MEASURED, ms=4.5)
    axes.plot(x, 100.0 * released, "s", color=ACCENT, ms=4.0, mfc="white")
    axes.axvline(0.0, color=FAINT, lw=0.9, ls=":")
    keys = [
        key(f"profile ({advance.law})", color=COMPUTED, lw=1.4),
        key("motion at the stages", color=MEASURED, marker="o", ls="", ms=4.5),
        key("stress released", color=ACCENT, marker="s", ls="", ms=4.0, mfc="white"),
    ]
    zeros = np.unique(x[advance.stage_zero])
    for at in zeros:
        axes.axvline(at, color=MEASURED, lw=0.8, ls="--")
    if advance.lost is not None:
        axes.axhspan(0.0, 100.0 * advance.lost, color=_LOST, lw=0.0, zorder=0)
        keys.append(key("gauges read zero", color=MEASURED, lw=0.8, ls="--"))
    names = [short(name, 18) for name in advance.stages]
    curve = np.column_stack([advance.distance, 100.0 * advance.share])
    place_labels(axes, np.column_stack([x, share]), names, avoid=[curve])
    axes.set_ylim(0.0, 105.0)
    axes.set_xlabel("section behind the face (m)")
    axes.set_ylabel("part of the whole (%)")
    axes.grid()
    figure.legend(handles=keys, loc="outside upper center", ncols=4)
    return figure

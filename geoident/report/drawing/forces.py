"""What structures bear: N, M and Q along walls and linings, forces in bars, stage by stage.

Of an upright wall against its height, as walls are dimensioned; of a line that bends, such as a
lining, on the line itself: moments on the side in tension, axial and shear forces on the right of
the line where they are positive.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.results.result import MemberForces, Result
from geoident.report.drawing.labels import place_labels
from geoident.report.drawing.style import (
    COMPUTED,
    FAINT,
    SMALL,
    WIDTH,
    Picture,
    colour,
    evenly,
    hide_unused,
    key,
    short,
)
from geoident.report.text.layout import number

_MOST_STAGES = 8
_MOST_DRAWN = 4
"""Stages that are drawn on the line itself."""

_MOST_NAMED = 12
_KILO = 1e3
LINE_STYLES: Sequence[Any] = ("-", (0, (6, 1.5)), (0, (2, 1)), (0, (6, 1, 1, 1)))
_PER_ROW = 3
_REACH = 0.22
"""Largest force as drawn, by the diagonal of the line."""

_POSITIVE = (
    "Per metre. Tension is positive; a moment is positive with tension on the right when one goes "
    "along the line from its beginning (the ring)."
)


def structure_pictures(result: Result) -> tuple[Picture, ...]:
    """Forces along each wall or lining, and in bars along them and from stage to stage."""
    forces = result.members
    if forces is None:
        return ()
    names = np.array(forces.structures)
    beams = [str(n) for n in dict.fromkeys(names[forces.per_metre])]
    bars = [str(n) for n in dict.fromkeys(names[~forces.per_metre])]
    pictures = [_beam_picture(forces, name, count) for count, name in enumerate(beams, start=1)]
    grouted = _grouted(forces)
    for count, name in enumerate(dict.fromkeys(names[grouted].tolist()), start=1):
        pictures.append(
            Picture(
                f"grouted-{count}",
                f"Forces along {name}",
                "N from the head to the toe of the bar that bears most, tension positive; of piles "
                "that bend also M, in a section positive with tension on the right of this way, in "
                "a solid its size. "
                f"{_some_stages(_of(forces, name), _MOST_STAGES)}",
                partial(_grouted_figure, forces, name),
            )
        )
    bars = [name for name in bars if not grouted[names == name].any()]
    if bars:
        pictures.append(
            Picture(
                "bar-forces",
                "Forces in struts, anchors and bolts",
                "Axial force of each bar, tension positive. A ring is the force that a jack gave, "
                "at which the bar was locked off.",
                partial(_bar_figure, forces, bars),
            )
        )
    if (~forces.per_metre).any() and forces.ends.shape[2] == 2:
        pictures.append(
            Picture(
                "bars-along",
                "Bars and their forces where they stand",
                "Axial force of one bar, kN, tension positive. Wide: a large force; solid: "
                "tension, dashed: compression. Faint: walls and linings. "
                f"{_some_stages(_present(forces, ~forces.per_metre), _MOST_DRAWN)}",
                partial(_bars_along_figure, forces),
            )
        )
    return tuple(pictures)


def _of(forces: MemberForces, name: str) -> Ints:
    """Stages at which a structure stands."""
    return _present(forces, np.array(forces.structures) == name)


def _some_stages(stages: Ints, most: int) -> str:
    """Says which stages are drawn, where these are not all.

    Args:
        stages: at which something stands.
        most: of them are drawn.
    """
    n = len(stages)
    return f"Drawn are {most} of the {n} stages with forces." if n > most else ""


def _beam_picture(forces: MemberForces, name: str, count: int) -> Picture:
    line = _line(forces, name)
    stages = _present(forces, line.members)
    if line.upright or forces.ends.shape[2] != 2:
        words = (
            f"{_POSITIVE.replace(' (the ring)', '')} One line a stage. "
            f"{_some_stages(stages, _MOST_STAGES)}"
        )
        draw = partial(_beam_figure, forces, line)
    else:
        words = (
            f"{_POSITIVE} A moment is drawn on the side in tension, other forces on the right "
            "where they are positive, all at the middles of the straight pieces between nodes; the "
            "table has those at their ends. Numbers: the extremes. "
            f"{_some_stages(stages, _MOST_DRAWN)}"
        )
        draw = partial(_along_figure, forces, line)
    return Picture(f"forces-{count}", f"Forces in {name}", words, draw)


@dataclass(frozen=True)
class _Line:
    """The pieces of a wall or lining in their order.

    Args:
        name: of the structure.
        members: (n,) rows of the table of forces, in order.
        turned: (n,) which of them run against the order.
        label: what the coordinate is.
        along: (n, 2) coordinate of the ends.
        ends: (n, 2, dim) of the pieces in the order, m.
    """

    name: str
    members: Ints
    turned: Bools
    label: str
    along: Floats
    ends: Floats

    @property
    def upright(self) -> bool:
        """A wall that stands upright."""
        return self.label == "y (m)"

    def at_ends(self, forces: Floats, stage: int) -> Floats:
        """(n, 2) forces at both ends of the pieces at a stage, in the order.

        Args:
            forces: (n_members, n_stages), constant in a piece, or (n_members, 2, n_stages).
            stage: its number.
        """
        here = forces[self.members][..., stage]
        if here.ndim == 1:
            here = np.stack([here, here], axis=1)
        return np.where(self.turned[:, None], here[:, ::-1], here)

    @property
    def closed(self) -> bool:
        """The line ends where it begins."""
        return bool(np.allclose(self.ends[0, 0], self.ends[-1, 1], atol=1e-6))

    def at_middles(self, forces: Floats, stage: int) -> Floats:
        """(n,) forces at the middles of the pieces at a stage, in the order.

        Args:
            forces: (n_members, n_stages), constant in a piece, or (n_members, 2, n_stages).
            stage: its number.
        """
        return np.asarray(self.at_ends(forces, stage).mean(axis=1))


def _line(forces: MemberForces, name: str) -> _Line:
    members = np.flatnonzero(np.array(forces.structures) == name)
    order, turned, label, along = chain(forces.ends[members])
    ends = forces.ends[members[order]]
    ends = np.where(turned[:, None, None], ends[:, ::-1], ends)
    return _Line(name, members[order], turned, label, along, ends)


def _present(forces: MemberForces, members: Ints | Bools) -> Ints:
    """Stages at which any of some members stands."""
    return np.flatnonzero(np.asarray(np.isfinite(forces.axial[members]).any(axis=0)))


def _spread(stages: Ints, most: int) -> Ints:
    return stages[evenly(len(stages), most)]


def _quantities(forces: MemberForces, members: Ints) -> list[tuple[str, Floats]]:
    panels = [("M (kNm/m)", forces.moment), ("N (kN/m)", forces.axial), ("Q (kN/m)", forces.shear)]
    if np.isfinite(forces.hoop[members]).any():
        panels.append(("hoop N (kN/m)", forces.hoop))
    return panels


def _beam_figure(members: MemberForces, line: _Line) -> Figure:
    """Forces against the coordinate of a line, a line for each stage."""
    stages = _spread(_present(members, line.members), _MOST_STAGES)
    styles = [{"color": colour(k), "ls": LINE_STYLES[k % 4]} for k in range(len(stages))]
    panels = _quantities(members, line.members)
    figure = Figure(figsize=(WIDTH, 3.6))
    for axes, (title, forces) in zip(
        np.atleast_1d(figure.subplots(1, len(panels), sharey=True)), panels, strict=True
    ):
        axes.axvline(0.0, color=FAINT, lw=0.6)
        for style, stage in zip(styles, stages, strict=True):
            here = line.at_ends(forces, int(stage)) / _KILO
            axes.plot(here.ravel(), line.along.ravel(), lw=1.2, **style)
        axes.set_xlabel(title)
        axes.grid(visible=True)
        axes.xaxis.set_major_locator(MaxNLocator(4))
    figure.axes[0].set_ylabel(line.label)
    pairs = zip(styles, stages, strict=True)
    handles = [key(short(members.stages[stage], 24), **style) for style, stage in pairs]
    figure.legend(handles=handles, loc="outside right upper")
    return figure


def _along_figure(members: MemberForces, line: _Line) -> Figure:
    """Forces on the line itself, each quantity on one scale: stages across, or quantities if more.

    Args:
        members: forces of all structures.
        line: of one of them.
    """
    stages = _spread(_present(members, line.members), _MOST_DRAWN)
    panels = _quantities(members, line.members)
    reach = _REACH * float(np.linalg.norm(np.ptp(line.ends.reshape(-1, 2), axis=0)))
    low, high = (end(line.ends.reshape(-1, 2), axis=0) for end in (np.min, np.max))
    low, high = low - 1.3 * reach, high + 1.3 * reach
    rows, columns = sorted((len(panels), len(stages)))
    width = WIDTH / max(columns, 3)
    aspect = float(np.clip((high - low)[1] / (high - low)[0], 0.25, 2.0))
    figure = Figure(figsize=(width * columns, (width * aspect + 0.25) * rows))
    grid: Any = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    grid = grid if rows == len(panels) else grid.T
    for (title, forces), row in zip(panels, grid, strict=True):
        drawn = [line.at_middles(forces, int(s)) / _KILO for s in stages]
        largest = max(float(np.nanmax(np.abs(each))) for each in drawn) or 1.0
        for axes, stage, values in zip(row, stages, drawn, strict=True):
            _draw_on_line(axes, line, values, reach / largest)
            axes.set_title(f"{title}, {short(members.stages[stage], 18)}", fontsize=SMALL)
            axes.set_aspect("equal")
            axes.set_xlim(low[0], high[0])
            axes.set_ylim(low[1], high[1])
            axes.set_axis_off()
    return figure


def _draw_on_line(axes: Axes, line: _Line, values: Floats, size: float) -> None:
    """The line, and forces (n,) at the middles of its pieces across it, with their extremes."""
    middles = line.ends.mean(axis=1)
    tops = middles + size * values[:, None] * _right(line.ends)
    order = np.arange(len(values))
    if line.closed:
        order = np.r_[order, 0]
    for k, m in pairwise(order.tolist()):
        axes.fill(*np.stack([middles[k], middles[m], tops[m], tops[k]]).T, color=COMPUTED,
                  alpha=0.22, lw=0)  # fmt: skip
    for piece in line.ends:
        axes.plot(*piece.T, color="black", lw=1.8, solid_capstyle="round")
    axes.plot(*tops[order].T, color=COMPUTED, lw=0.9)
    axes.plot(*line.ends[0, 0], "o", ms=4, mfc="white", color="black")
    places = sorted({int(np.nanargmax(values)), int(np.nanargmin(values))})
    place_labels(
        axes,
        [tops[k] for k in places],
        [number(float(values[k]), 3) for k in places],
        avoid=[middles, tops],
    )


def _right(ends: Floats) -> Floats:
    """(n, 2) unit vectors to the right of pieces (n, 2, 2) from their first to their second end."""
    along = ends[:, 1] - ends[:, 0]
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    return np.stack([along[:, 1], -along[:, 0]], axis=1)


def _bars_along_figure(members: MemberForces) -> Figure:
    """Bars where they stand, as wide as their force is large, a panel a stage."""
    bars = ~members.per_metre
    stages = _spread(_present(members, bars), _MOST_DRAWN)
    forces = members.axial[bars] / _KILO
    largest = float(np.nanmax(np.abs(forces[:, stages]))) or 1.0
    spread = members.ends[bars].reshape(-1, 2)
    margin = 0.12 * max(float(np.ptp(spread, axis=0).max()), 1e-9)
    low, high = spread.min(axis=0) - margin, spread.max(axis=0) + margin
    columns = max(2, len(stages))
    width = WIDTH / columns
    aspect = float(np.clip((high - low)[1] / (high - low)[0], 0.35, 2.0))
    figure = Figure(figsize=(width * columns, width * aspect + 0.7))
    panels = list(figure.subplots(1, columns, squeeze=False, sharey=True).ravel())
    for axes, stage in zip(panels, stages, strict=False):
        for piece in members.ends[members.per_metre & np.isfinite(members.axial[:, stage])]:
            axes.plot(*piece.T, color=FAINT, lw=1.5)
        _draw_bar_forces(
            axes, members.ends[bars], forces[:, stage], largest, ~_grouted(members)[bars]
        )
        axes.set_title(short(members.stages[stage], 24))
        axes.set_aspect("equal")
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        axes.set_xlabel("x (m)")
    panels[0].set_ylabel("y (m)")
    hide_unused(panels, len(stages))
    return figure


def _grouted(forces: MemberForces) -> Bools:
    """(n_members,) pieces of grouted bars."""
    if forces.grout is None:
        return np.zeros(len(forces.structures), dtype=bool)
    return np.asarray(np.isfinite(forces.grout).any(axis=1))


def _grouted_figure(forces: MemberForces, name: str) -> Figure:
    """N along one bar, and M where it bends, a line a stage."""
    members = np.flatnonzero(np.array(forces.structures) == name)
    ends = forces.ends[members]
    begins = np.flatnonzero((ends[1:, 0] != ends[:-1, 1]).any(axis=1)) + 1
    each = np.split(members, begins)
    bends = bool(np.isfinite(forces.moment[members]).any())
    decides = forces.moment[:, 0] if bends else forces.axial
    most = [float(np.nanmax(np.abs(decides[one]), initial=0.0)) for one in each]
    bar = each[int(np.argmax(most))]
    length = np.linalg.norm(forces.ends[bar, 1] - forces.ends[bar, 0], axis=1)
    end = np.cumsum(length)
    drawn = [("N (kN)", end - length / 2, forces.axial[bar])]
    if bends:
        drawn.append(("M (kNm)", end - length, forces.moment[bar, 0]))
    figure = Figure(figsize=(WIDTH * (1.0 if bends else 0.6), 2.8))
    for axes, (label, along, values) in zip(
        np.ravel(figure.subplots(1, len(drawn))), drawn, strict=True
    ):
        for k, stage in enumerate(_spread(_of(forces, name), _MOST_STAGES)):
            stage_name = short(forces.stages[stage], 24)
            axes.plot(along, values[:, stage] / _KILO, lw=1.3, color=colour(k), label=stage_name)
        axes.axhline(0.0, color=FAINT, lw=0.6)
        axes.set_xlabel("from the beginning of the grout (m)")
        axes.set_ylabel(label)
        axes.grid(visible=True, axis="y")
    axes.legend(fontsize=SMALL)
    return figure


def _draw_bar_forces(
    axes: Axes, ends: Floats, forces: Floats, largest: float, labelled: Bools
) -> None:
    """Bars (n, 2, 2) with their forces (n,), NaN where they do not stand.

    The largest ones of those that are labelled (n,) have their numbers.
    """
    known = np.flatnonzero(np.isfinite(forces))
    for k in known:
        width = 0.8 + 4.2 * abs(float(forces[k])) / largest
        style: Any = "-" if forces[k] >= 0.0 else (0, (2.2, 0.8))
        axes.plot(*ends[k].T, color=COMPUTED, lw=width, ls=style, alpha=0.75,
                  solid_capstyle="butt")  # fmt: skip
    named = known[labelled[known]]
    named = named[np.argsort(-np.abs(forces[named]), kind="stable")][:_MOST_NAMED]
    place_labels(
        axes,
        [ends[k].mean(axis=0) for k in named],
        [number(float(forces[k]), 3) for k in named],
        avoid=[ends[k] for k in known],
    )


def chain(ends: Floats) -> tuple[Ints, Bools, str, Floats]:
    """Pieces of a line in their order along it.

    Args:
        ends: (n, 2, dim) of the pieces, m.

    Returns:
        Order (n,), which of them (in that order) are turned round (n,), what the coordinate is, and
        the coordinate (n, 2) of their ends in the order: y of a wall that stands upright, else the
        length along the line.
    """
    keys = [tuple(point) for point in ends.round(6).reshape(-1, ends.shape[2]).tolist()]
    at: dict[tuple[float, ...], list[int]] = {}
    for n, place in enumerate(keys):
        at.setdefault(place, []).append(n // 2)
    single = [n for n, place in enumerate(keys) if len(at[place]) == 1]
    left, order, turned = set(range(len(ends))), [], []
    here = keys[single[0]] if single else keys[0]
    while left:
        following = next((n for n in at[here] if n in left), None)
        if following is None:
            following = min(left)
            here = keys[2 * following]
        left.discard(following)
        order.append(following)
        turned.append(keys[2 * following] != here)
        here = keys[2 * following] if turned[-1] else keys[2 * following + 1]
    chosen, back = np.array(order), np.array(turned)
    pieces = np.where(back[:, None, None], ends[chosen][:, ::-1], ends[chosen])
    if np.ptp(pieces[..., 0]) <= 1e-3 * np.ptp(pieces[..., 1]):
        return chosen, back, "y (m)", np.asarray(pieces[..., 1])
    length = np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1)
    end = np.cumsum(length)
    return chosen, back, "along the line (m)", np.stack([end - length, end], axis=1)


def _bar_figure(forces: MemberForces, names: list[str]) -> Figure:
    rows = -(-len(names) // _PER_ROW)
    figure = Figure(figsize=(WIDTH, 1.0 + 2.6 * rows))
    grid = figure.subplots(rows, min(len(names), _PER_ROW), squeeze=False)
    panels = list(grid.ravel())
    every = np.array(forces.structures)
    for axes, name in zip(panels, names, strict=False):
        _draw_bars(axes, forces, np.flatnonzero(every == name))
        axes.set_title(short(name, 24))
    hide_unused(panels, len(names))
    return figure


def _draw_bars(axes: Axes, forces: MemberForces, members: Ints) -> None:
    places = np.arange(len(forces.stages))
    for k, member in enumerate(members[:7]):
        axes.plot(places, forces.axial[member] / _KILO, "-o", ms=3, lw=1.2, color=colour(k),
                  label=f"bar {forces.numbers[member]}")  # fmt: skip
        axes.plot(places, forces.prestress[member] / _KILO, ls="", marker="o", ms=8, mfc="none",
                  color=colour(k))  # fmt: skip
    for member in members[7:]:
        axes.plot(places, forces.axial[member] / _KILO, "-", lw=0.6, color=FAINT)
    axes.axhline(0.0, color=FAINT, lw=0.6)
    axes.set_xticks(places, [short(s, 12) for s in forces.stages], rotation=45, ha="right")
    axes.set_xlim(-0.5, len(places) - 0.5)
    axes.set_ylabel("N (kN)")
    axes.grid(visible=True, axis="y")
    if len(members) > 1:
        axes.legend(fontsize=SMALL)

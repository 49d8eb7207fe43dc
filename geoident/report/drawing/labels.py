"""Names in a picture, placed so that they can be read: none cut, none on another, none astray.

What is to be named is known when a figure is made; where there is room only when it is drawn, since
the layout moves the axes. So labels are handed to their axes by `place_labels` and get their places
when these are drawn: each label tries places around its anchors, the near ones first, and takes the
one that costs least. Other labels and the border are never touched; marks and lines are avoided as
far as possible. A label that stands off its anchor has a leader. Where there is no room for all,
letters become smaller. The same picture gives the same places.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from operator import itemgetter
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.lines import Line2D
from matplotlib.text import Text
from mpl_toolkits.mplot3d import proj3d

from geoident.model.arrays import Bools, Floats
from geoident.report.drawing.style import SMALL

_GROUND = {"facecolor": "white", "alpha": 0.6, "edgecolor": "none", "pad": 0.4}
"""Behind the letters, so that they can be read on lines and colours and stay text in an SVG."""

_FIRST, _LAST = -1000.0, 8.0  # zorder: places are found before anything is drawn; letters on top
_INCH = 72.0  # points
_GAP = 3.0  # between an anchor and its label, points
_PAD = 1.0  # kept free around letters, points
_RIM = 2.0  # kept free inside the border, points
_LEADER = 7.0  # from this distance on a label has a leader, points
_RINGS = np.array([0.0, 3.0, 7.0, 12.0, 18.0, 26.0, 36.0, 50.0, 70.0, 95.0, 125.0, 165.0])
_TURNS = np.array([0, 8, 2, 14, 6, 10, 4, 12, 1, 15, 7, 9, 3, 13, 5, 11]) * (np.pi / 8)
_TURN_COST = np.linspace(0.0, 3.0, len(_TURNS))  # to the right is best, then to the left, ...
_SIZES = (1.0, 0.88, 0.78, 0.69, 0.6)  # of the letters, tried until there is room
_NEAR, _FAR = (0, 5), (5, len(_RINGS))  # rings that are tried first, and those after them
_MOST_ANCHORS = 6  # of a label, around which places are tried
_OFF_CENTRE = 6.0  # cost of not standing on the anchor, for a label that would best stand there
_SWEEPS = 2
_ON_LINE, _ON_MARK, _LEADERS_CROSS, _LEADER_ON_LABEL = 8.0, 12.0, 25.0, 60.0


@dataclass
class _Wish:
    """A label that waits for its place.

    Args:
        text: with its letters.
        size: of the letters, points.
        leader: from the letters to the anchor.
        anchors: (k, dim) points of which any may be named, coordinates of the axes.
        centred: it would best stand on its anchor.
    """

    text: Text
    size: float
    leader: Line2D
    anchors: Floats
    centred: bool


def place_labels(
    axes: Any,
    anchors: Iterable[Any],
    texts: Sequence[str],
    *,
    avoid: Iterable[Any] = (),
    centred: bool = False,
    size: float = SMALL,
    colour: str = "black",
    weight: str = "normal",
) -> tuple[Text, ...]:
    """Names for points of a picture; they get their places when it is drawn.

    Labels of several calls for the same axes know of each other; those of the first call choose
    first. Each label is kept off the anchors of all others.

    Args:
        axes: in the plane or in space.
        anchors: of every label a point (dim,), or points (k, dim) of which it may stand at any.
        texts: the labels.
        avoid: points (1, dim) and lines (k, dim) that should stay visible.
        centred: whether a label would best stand on its anchor itself.
        size: of the letters, points; smaller where there is no room.
        colour: of the letters.
        weight: of the letters.

    Returns:
        The labels, without a place yet.
    """
    placer = _placer(axes)
    placer.avoid += [np.atleast_2d(np.asarray(line, dtype=np.float64)) for line in avoid]
    inches = axes.figure.dpi_scale_trans
    made = []
    for points, words in zip(anchors, texts, strict=True):
        text = Text(0, 0, words, fontsize=size, color=colour, weight=weight, zorder=_LAST,
                    ha="center", va="center", bbox=_GROUND, transform=inches)  # fmt: skip
        leader = Line2D([], [], color=colour, lw=0.5, zorder=_LAST - 0.1, transform=inches)
        for artist in (leader, text):
            artist.set_in_layout(False)
            axes.add_artist(artist)
            artist.set_clip_on(False)
        corners = np.atleast_2d(np.asarray(points, dtype=np.float64))
        placer.wishes.append(_Wish(text, size, leader, corners, centred))
        made.append(text)
    return tuple(made)


def _placer(axes: Any) -> _Placer:
    """The one of some axes, made when first asked for."""
    for artist in axes.artists:
        if isinstance(artist, _Placer):
            return artist
    placer = _Placer()
    axes.add_artist(placer)
    return placer


class _Placer(Artist):
    """Gives the labels of its axes their places, before anything of these axes is drawn.

    Places are found in points (1/72 inch), so that a picture has the same ones in every format.
    """

    def __init__(self) -> None:
        super().__init__()
        self.set_zorder(_FIRST)
        self.set_in_layout(False)
        self.wishes: list[_Wish] = []
        self.avoid: list[Floats] = []

    def draw(self, renderer: Any) -> None:
        """Give every label its place; draws nothing itself."""
        axes: Any = self.axes
        scale = _INCH / axes.figure.dpi
        frame = np.array(axes.get_window_extent(renderer).extents) * scale
        anchors = [_on_paper(axes, wish.anchors) * scale for wish in self.wishes]
        lines = [_on_paper(axes, line) * scale for line in self.avoid]
        sizes = np.array([_extent(wish, renderer) for wish in self.wishes]) * scale
        centred = np.array([wish.centred for wish in self.wishes])
        boxes, shrunk = arranged(anchors, sizes, frame, avoid=lines, centred=centred)
        for wish, box, points in zip(self.wishes, boxes, anchors, strict=True):
            _put(wish, box, points, shrunk)


def _on_paper(axes: Any, points: Floats) -> Floats:
    """Points (k, dim) of some axes in pixels (k, 2)."""
    if points.shape[1] == 3:
        points = np.stack(proj3d.proj_transform(*points.T, axes.get_proj())[:2], axis=1)
    return np.asarray(axes.transData.transform(points), dtype=np.float64)


def _extent(wish: _Wish, renderer: Any) -> tuple[float, float]:
    """Width and height of the letters in full size, pixels."""
    wish.text.set_visible(True)
    wish.text.set_fontsize(wish.size)
    shown = wish.text.get_window_extent(renderer)
    return shown.width, shown.height


def _put(wish: _Wish, box: Floats, anchors: Floats, shrunk: float) -> None:
    """Put a label into its box (4,), points, with a leader where that stands off its anchor."""
    placed = bool(np.isfinite(box).all())
    wish.text.set_visible(placed)
    wish.leader.set_visible(False)
    if not placed:
        return
    wish.text.set_fontsize(wish.size * shrunk)
    wish.text.set_position(tuple((box[:2] + box[2:]) / 2 / _INCH))
    leaders, lengths = _leaders(box[None], anchors)
    if lengths[0] > _LEADER:
        wish.leader.set_visible(True)
        wish.leader.set_data(*(leaders[0].T / _INCH))


def arranged(
    anchors: Sequence[Floats],
    sizes: Floats,
    frame: Floats,
    *,
    avoid: Sequence[Floats] = (),
    centred: Bools | None = None,
) -> tuple[Floats, float]:
    """Places of labels in a frame: pairwise apart, inside, off marks and lines where that can be.

    Args:
        anchors: for each of n labels the points (k, 2) of which it may stand at any.
        sizes: (n, 2) width and height of the labels.
        frame: (4,) left, lower, right, upper.
        avoid: points (1, 2) and lines (k, 2) that should stay visible.
        centred: (n,) labels that would best stand on their anchor; None: none of them.

    Returns:
        Boxes (n, 4) left, lower, right, upper, NaN for a label for which there is no room even when
        it is small; and by which factor, at most 1, all labels have to be made smaller.
    """
    on = np.zeros(len(anchors), dtype=bool) if centred is None else centred
    marks = np.vstack([np.empty((0, 2)), *(line for line in avoid if len(line) == 1)])
    lines = np.concatenate(
        [np.empty((0, 2, 2)), *(np.stack([x[:-1], x[1:]], axis=1) for x in avoid if len(x) > 1)]
    )
    boxes = np.full((len(anchors), 4), np.nan)
    for shrunk in _SIZES:
        boxes = _arrange(anchors, sizes * shrunk, frame, (marks, lines), on)
        if np.isfinite(boxes).all():
            return boxes, shrunk
    return boxes, _SIZES[-1]


@dataclass(frozen=True)
class _Choice:
    """Places among which a label chooses.

    Args:
        boxes: (c, 4) that lie inside the frame.
        cost: (c,) of each, but for other labels.
        leaders: (c, 2, 2) to the anchor, NaN where none is drawn.
    """

    boxes: Floats
    cost: Floats
    leaders: Floats


def _arrange(
    anchors: Sequence[Floats],
    sizes: Floats,
    frame: Floats,
    avoid: tuple[Floats, Floats],
    centred: Bools,
) -> Floats:
    """Boxes (n, 4) of labels in one size; those that find none at first may find one later."""
    n = len(anchors)
    boxes, leaders = np.full((n, 4), np.nan), np.full((n, 2, 2), np.nan)
    of = np.concatenate([np.full(len(a), k) for k, a in enumerate(anchors)]) if n else np.empty(0)
    points = np.vstack([np.empty((0, 2)), *anchors])

    @cache
    def choice(k: int, rings: tuple[int, int]) -> _Choice:
        others = np.vstack([points[(of != k) & ~centred[of.astype(np.int64)]], avoid[0]])
        around = _around(anchors[k], sizes[k], rings, centred=bool(centred[k]))
        return _choice(*around, anchors[k], frame, (others, avoid[1]))

    @cache
    def anywhere(k: int) -> _Choice:
        return _choice(*_everywhere(sizes, frame, k, anchors[k]), anchors[k], frame, avoid)

    for sweep in range(_SWEEPS + 1):
        for k in range(n):
            others = np.flatnonzero(np.isfinite(boxes[:, 0]) & (np.arange(n) != k))
            obstacles = boxes[others], leaders[others]
            best = _best(choice(k, _NEAR), *obstacles)
            if best is None or best[2] > _RINGS[_FAR[0]]:
                further = _best(choice(k, _FAR), *obstacles)
                best = min((f for f in (best, further) if f), key=itemgetter(2), default=None)
            if best is None and sweep == _SWEEPS:
                best = _best(anywhere(k), *obstacles)
            boxes[k], leaders[k] = (np.nan, np.nan) if best is None else best[:2]
    return boxes


def _choice(
    boxes: Floats, cost: Floats, anchors: Floats, frame: Floats, avoid: tuple[Floats, Floats]
) -> _Choice:
    """Those of some boxes (c, 4) that lie inside a frame, with what they cost.

    Args:
        boxes: to choose from.
        cost: (c,) of each by itself.
        anchors: (k, 2) of the label.
        frame: (4,) inside which it has to lie.
        avoid: marks (p, 2) and lines (s, 2, 2).
    """
    rim = frame + np.array([_RIM, _RIM, -_RIM, -_RIM])
    kept = (boxes[:, :2] >= rim[:2]).all(axis=1) & (boxes[:, 2:] <= rim[2:]).all(axis=1)
    boxes = boxes[kept]
    padded = boxes + _PAD * np.array([-1, -1, 1, 1])
    marks, lines = avoid
    lines = lines[(lines.max(axis=1) > padded[:, :2].min(axis=0, initial=np.inf)).all(axis=1)]
    lines = lines[(lines.min(axis=1) < padded[:, 2:].max(axis=0, initial=-np.inf)).all(axis=1)]
    total = cost[kept] + _ON_MARK * _holds(padded, marks).sum(axis=1)
    total = total + _ON_LINE * np.minimum(_cut(lines, padded).sum(axis=1), 4)
    leaders, length = _leaders(boxes, anchors)
    leaders[length <= _LEADER] = np.nan
    return _Choice(boxes, total, leaders)


def _around(
    anchors: Floats, size: Floats, rings: tuple[int, int], *, centred: bool
) -> tuple[Floats, Floats]:
    """Boxes (c, 4) around the anchors (k, 2) of a label, and what each costs by itself."""
    direction = np.stack([np.cos(_TURNS), np.sin(_TURNS)], axis=1)
    away = _RINGS[slice(*rings)]
    reach = direction[None] * (_GAP + away)[:, None, None]
    reach = reach + np.clip(1.3 * direction, -1, 1)[None] * size / 2
    every = -(-len(anchors) // _MOST_ANCHORS)
    middles = (anchors[::every, None, None] + reach[None]).reshape(-1, 2)
    cost = np.tile((away[:, None] + _TURN_COST[None]).ravel(), len(anchors[::every]))
    if centred:
        own = 0.1 * np.arange(len(anchors))
        middles, cost = np.vstack([anchors, middles]), np.r_[own, cost + _OFF_CENTRE]
    return _boxes(middles, size), cost


def _everywhere(sizes: Floats, frame: Floats, k: int, anchors: Floats) -> tuple[Floats, Floats]:
    """Boxes (c, 4) of a label all over a frame, and what each costs by its distance."""
    step = max(float(sizes[:, 1].min()), 4.0)
    x, y = (np.arange(frame[i] + step / 2, frame[i + 2], step * (2 - i)) for i in (0, 1))
    middles = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    away = np.linalg.norm(middles[:, None] - anchors[None], axis=2).min(axis=1)
    return _boxes(middles, sizes[k]), away


def _boxes(middles: Floats, size: Floats) -> Floats:
    half = size / 2
    return np.hstack([middles - half, middles + half])


def _best(choice: _Choice, others: Floats, leaders: Floats) -> tuple[Floats, Floats, float] | None:
    """The best box (4,) with its leader (2, 2), NaN for none, and its cost; None if none is free.

    Args:
        choice: to choose from.
        others: (m, 4) boxes of other labels.
        leaders: (m, 2, 2) of other labels.
    """
    free = np.flatnonzero(~_overlap(choice.boxes, others).any(axis=1))
    if not len(free):
        return None
    boxes, own_leaders = choice.boxes[free], choice.leaders[free]
    leaders = leaders[np.isfinite(leaders[:, 0, 0])]
    total = choice.cost[free] + _LEADER_ON_LABEL * _cut(leaders, boxes).sum(axis=1)
    led = np.flatnonzero(np.isfinite(own_leaders[:, 0, 0]))
    total[led] += _LEADER_ON_LABEL * _cut(own_leaders[led], others).sum(axis=0)
    total[led] += _LEADERS_CROSS * _cross(own_leaders[led], leaders).sum(axis=1)
    best = int(total.argmin())
    return boxes[best], own_leaders[best], float(total[best])


def _overlap(boxes: Floats, others: Floats) -> Bools:
    """(c, m) which boxes (c, 4) touch which others (m, 4), with the room kept between letters."""
    overlaps = np.ones((len(boxes), len(others)), dtype=bool)
    for k in (0, 1):  # by columns: reductions over the last, short axis take three times as long
        overlaps &= boxes[:, None, k] - 2 * _PAD < others[None, :, k + 2]
        overlaps &= boxes[:, None, k + 2] + 2 * _PAD > others[None, :, k]
    return overlaps


def _holds(boxes: Floats, points: Floats) -> Bools:
    """(c, p) which boxes (c, 4) have which points (p, 2) inside."""
    inside = np.ones((len(boxes), len(points)), dtype=bool)
    for k in (0, 1):
        inside &= points[None, :, k] > boxes[:, None, k]
        inside &= points[None, :, k] < boxes[:, None, k + 2]
    return inside


def _leaders(boxes: Floats, anchors: Floats) -> tuple[Floats, Floats]:
    """From boxes (c, 4) to the nearest of the anchors (k, 2): lines (c, 2, 2), lengths (c,)."""
    nearest = np.clip(anchors[None], boxes[:, None, :2], boxes[:, None, 2:])
    away = np.linalg.norm(nearest - anchors[None], axis=2)
    which = away.argmin(axis=1)
    rows = np.arange(len(boxes))
    return np.stack([nearest[rows, which], anchors[which]], axis=1), away[rows, which]


def _cut(lines: Floats, boxes: Floats) -> Bools:
    """(c, s) which boxes (c, 4) are cut by which lines (s, 2, 2)."""
    first, last = np.zeros((len(boxes), len(lines))), np.ones((len(boxes), len(lines)))
    for k in (0, 1):
        start, along = lines[None, :, 0, k], (lines[:, 1, k] - lines[:, 0, k])[None]
        with np.errstate(divide="ignore", invalid="ignore"):
            enter = (boxes[:, None, k] - start) / along
            leave = (boxes[:, None, k + 2] - start) / along
        low, high = np.minimum(enter, leave), np.maximum(enter, leave)
        level = np.flatnonzero(along[0] == 0)
        if len(level):
            at = start[:, level]
            between = (at > boxes[:, None, k]) & (at < boxes[:, None, k + 2])
            low[:, level] = np.where(between, -np.inf, np.inf)
            high[:, level] = np.where(between, np.inf, -np.inf)
        np.maximum(first, low, out=first)
        np.minimum(last, high, out=last)
    return np.asarray(first < last)


def _cross(first: Floats, second: Floats) -> Bools:
    """(c, m) which lines (c, 2, 2) cross which others (m, 2, 2)."""
    a, b = first[:, None, 0], first[:, None, 1]
    c, d = second[None, :, 0], second[None, :, 1]
    apart = _side(a, b, c) * _side(a, b, d) < 0
    return np.asarray(apart & (_side(c, d, a) * _side(c, d, b) < 0))


def _side(a: Floats, b: Floats, c: Floats) -> Floats:
    """Positive where c lies on the left of the line from a to b."""
    u, v = b - a, c - a
    return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])

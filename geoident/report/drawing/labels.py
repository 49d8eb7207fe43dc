"""Names in a picture, placed so that they can be read: none cut, none on another, none astray.

What is to be named is known when a figure is made; where there is room only when it is drawn, since
the layout moves the axes. So labels get their places when their axes are drawn: one after the
other, each at the place around its anchors that costs least. The border and other labels are never
touched; marks and lines are avoided as far as possible. A label that stands off its anchor has a
leader. Where there is no room for all, letters become smaller. The same picture gives the same
places.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
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

_FIRST, _LAST = -1000.0, 8.0  # zorder: places are chosen before anything is drawn; letters on top
_INCH = 72.0  # points
_PAD = 1.0  # kept free around letters, points
_RIM = 2.0  # kept free inside the border, points
_LEADER = 7.0  # from this distance on a label has a leader, points
_AWAY = np.array([3.0, 6.0, 10.0, 15.0, 21.0, 29.0, 39.0, 53.0, 73.0, 98.0, 128.0, 168.0, 220.0])
_TURNS = np.array([0, 8, 2, 14, 6, 10, 4, 12, 1, 15, 7, 9, 3, 13, 5, 11]) * (np.pi / 8)
_TURN_COST = np.linspace(0.0, 3.0, len(_TURNS))  # to the right is best, then to the left, ...
_SIZES = (1.0, 0.88, 0.78, 0.69, 0.6)  # of the letters, tried until there is room
_MOST_ANCHORS = 6  # of a label, around which places are tried
_OFF_CENTRE = 6.0  # cost of not standing on the anchor, for a label that would best stand there
_ON_LINE, _ON_MARK, _ON_LEADER = 8.0, 12.0, 60.0


@dataclass
class _Label:
    """A label that gets its place when it is drawn.

    Args:
        text: its letters.
        leader: from the letters to the anchor.
        size: of the letters, points.
        anchors: (k, dim) points of which any may be named, coordinates of the axes.
        centred: it would best stand on its anchor.
    """

    text: Text
    leader: Line2D
    size: float
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
    placer = next((each for each in axes.artists if isinstance(each, _Placer)), None)
    if placer is None:
        placer = _Placer()
        axes.add_artist(placer)
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
        placer.labels.append(_Label(text, leader, size, corners, centred))
        made.append(text)
    return tuple(made)


class _Placer(Artist):
    """Gives the labels of its axes their places, before anything of these axes is drawn.

    Places are chosen in points (1/72 inch), so that a picture has the same ones in every format.
    """

    def __init__(self) -> None:
        super().__init__()
        self.set_zorder(_FIRST)
        self.set_in_layout(False)
        self.labels: list[_Label] = []
        self.avoid: list[Floats] = []

    def draw(self, renderer: Any) -> None:
        """Give every label its place; draws nothing itself."""
        axes: Any = self.axes
        point = _INCH / axes.figure.dpi

        def on_paper(points: Floats) -> Floats:
            if points.shape[1] == 3:
                points = np.stack(proj3d.proj_transform(*points.T, axes.get_proj())[:2], axis=1)
            return np.asarray(point * axes.transData.transform(points))

        sizes = np.empty((len(self.labels), 2))
        for k, label in enumerate(self.labels):
            label.text.set_fontsize(label.size)
            label.text.set_visible(True)
            letters = label.text.get_window_extent(renderer)
            sizes[k] = point * letters.width, point * letters.height
        boxes, shrunk = arranged(
            [on_paper(label.anchors) for label in self.labels],
            sizes,
            point * np.array(axes.get_window_extent(renderer).extents),
            avoid=[on_paper(line) for line in self.avoid],
            centred=np.array([label.centred for label in self.labels]),
        )
        for label, box in zip(self.labels, boxes, strict=True):
            (leader,), (length,) = _leaders(box[None], on_paper(label.anchors))
            label.text.set_visible(bool(np.isfinite(box).all()))
            label.text.set_fontsize(label.size * shrunk)
            label.text.set_position(tuple((box[:2] + box[2:]) / 2 / _INCH))
            label.leader.set_visible(bool(length > _LEADER))
            if length > _LEADER:
                label.leader.set_data(*(leader.T / _INCH))


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
    n = len(anchors)
    on = np.zeros(n, dtype=bool) if centred is None else centred
    marks = [line for line in avoid if len(line) == 1]
    lines = [np.stack([line[:-1], line[1:]], axis=1) for line in avoid if len(line) > 1]
    inside = frame + np.array([_RIM, _RIM, -_RIM, -_RIM])
    boxes = np.full((n, 4), np.nan)
    for shrunk in _SIZES:
        boxes, leaders = np.full((n, 4), np.nan), np.empty((0, 2, 2))
        for k in range(n):
            places, cost = _around(anchors[k], shrunk * sizes[k], centred=bool(on[k]))
            free = (places[:, :2] >= inside[:2]).all(axis=1)
            free &= (places[:, 2:] <= inside[2:]).all(axis=1)
            padded = places + _PAD * np.array([-1, -1, 1, 1])
            others = boxes[:k][np.isfinite(boxes[:k, 0])]
            free &= ~_overlap(padded, others + _PAD * np.array([-1, -1, 1, 1])).any(axis=1)
            if not free.any():
                continue
            places, padded, cost = places[free], padded[free], cost[free]
            named = [points for j, points in enumerate(anchors) if j != k and not on[j]]
            dots = np.vstack([np.empty((0, 2)), *named, *marks])
            cost += _ON_MARK * _overlap(padded, np.hstack([dots, dots])).sum(axis=1)
            crossed = _cut(np.concatenate([np.empty((0, 2, 2)), *lines]), padded).sum(axis=1)
            cost += _ON_LINE * np.minimum(crossed, 4)
            cost += _ON_LEADER * _cut(leaders, padded).sum(axis=1)
            own, length = _leaders(places, anchors[k])
            cost += _ON_LEADER * (length > _LEADER) * _cut(own, others).sum(axis=0)
            best = int(cost.argmin())
            boxes[k] = places[best]
            if length[best] > _LEADER:
                leaders = np.concatenate([leaders, own[best : best + 1]])
        if np.isfinite(boxes).all():
            break
    return boxes, shrunk


def _around(anchors: Floats, size: Floats, *, centred: bool) -> tuple[Floats, Floats]:
    """Boxes (c, 4) around the anchors (k, 2) of a label, and what each costs by itself."""
    direction = np.stack([np.cos(_TURNS), np.sin(_TURNS)], axis=1)
    reach = _AWAY[:, None, None] * direction + np.clip(1.3 * direction, -1, 1) * size / 2
    some = anchors[:: -(-len(anchors) // _MOST_ANCHORS)]
    middles = (some[:, None] + reach.reshape(-1, 2)).reshape(-1, 2)
    cost = np.tile((_AWAY[:, None] + _TURN_COST).ravel(), len(some))
    if centred:
        middles = np.vstack([anchors, middles])
        cost = np.r_[0.1 * np.arange(len(anchors)), cost + _OFF_CENTRE]
    return np.hstack([middles - size / 2, middles + size / 2]), cost


def _overlap(boxes: Floats, others: Floats) -> Bools:
    """(c, m) which boxes (c, 4) overlap which others (m, 4)."""
    first, second = boxes[:, None], others[None]
    return np.asarray(
        (first[..., 0] < second[..., 2]) & (second[..., 0] < first[..., 2])
        & (first[..., 1] < second[..., 3]) & (second[..., 1] < first[..., 3])
    )  # fmt: skip


def _leaders(boxes: Floats, anchors: Floats) -> tuple[Floats, Floats]:
    """From boxes (c, 4) to the nearest of the anchors (k, 2): lines (c, 2, 2), lengths (c,)."""
    nearest = np.clip(anchors[None], boxes[:, None, :2], boxes[:, None, 2:])
    away = np.linalg.norm(nearest - anchors[None], axis=2)
    which, rows = away.argmin(axis=1), np.arange(len(boxes))
    return np.stack([nearest[rows, which], anchors[which]], axis=1), away[rows, which]


def _cut(lines: Floats, boxes: Floats) -> Bools:
    """(c, s) which boxes (c, 4) are cut by which lines (s, 2, 2)."""
    enter, leave = np.zeros((len(boxes), len(lines))), np.ones((len(boxes), len(lines)))
    for k in (0, 1):
        start, along = lines[:, 0, k], lines[:, 1, k] - lines[:, 0, k]
        along = np.where(along == 0.0, 1e-9, along)
        ends = [(boxes[:, k + side, None] - start) / along for side in (0, 2)]
        enter = np.maximum(enter, np.minimum(*ends))
        leave = np.minimum(leave, np.maximum(*ends))
    return np.asarray(enter < leave)

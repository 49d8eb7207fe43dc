"""Axes that cost little: one tick drawn at all places, measured once for each place of the axes.

matplotlib has five artists for each number along an axis, and asks for the room of all of them some
seventeen times until a figure is laid out and drawn. Here an axis has one tick, its lines are drawn
together, the room of a number is kept, and what was measured counts until the axes move.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any, Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis, XAxis, YAxis
from matplotlib.projections import register_projection
from matplotlib.spines import Spine
from matplotlib.text import Text
from matplotlib.ticker import FixedFormatter, FixedLocator, NullLocator
from matplotlib.transforms import Bbox

from geoident.model.arrays import Floats

_known: dict[Any, Floats] = {}
"""The room of words that were measured, from the point at which they stand."""

_DIGITS = 6  # behind the point, of pixels

_CLOSE = 1e-10  # of the length of an axis: a tick so far beyond its end is at its end


class _LeanAxis(Axis):
    """What an axis along x and one along y have in common."""

    _key: Any = None
    _asked: Any = None
    _ticks: tuple[tuple[Any, Floats, list[str]], ...] = ()
    _boxes: tuple[list[Bbox], list[Bbox]] | None = None
    _extents: dict[Any, Bbox]

    def reset_ticks(self) -> None:
        """Forget the ticks; the one of which others are copies is made when it is asked for."""
        these: Any = self
        these.majorTicks, these.minorTicks = [], []
        self._key = self._asked = None
        if hasattr(these.axes, "patch"):
            self.set_clip_path(these.axes.patch)

    def get_major_ticks(self, numticks: int | None = None) -> list[Any]:
        """The one tick, also where matplotlib asks for one at each place that it is given.

        Args:
            numticks: not used.
        """
        return list(super().get_major_ticks(1))

    def _copy_tick_props(self: Any, src: Any, dest: Any) -> None:
        """Give one tick the look of another; the first is asked to look like itself."""
        if src is not dest:
            plain: Any = super()
            plain._copy_tick_props(src, dest)

    def _usual_side(self: Any) -> bool:
        """Whether marks and numbers stand on the usual side alone."""
        on = self._major_tick_kw
        return not (on.get("tick2On") or on.get("label2On"))

    def _measured(self: Any) -> None:
        """Find ticks and forget what was measured, if the axes moved since."""
        view = tuple(self.get_view_interval())
        key = (view, self.axes.bbox.bounds, self.get_figure(root=True).dpi)
        if key == self._key:
            return
        self._key, self._boxes, self._extents = key, None, {}
        self._find_ticks(view)

    def _find_ticks(self: Any, view: tuple[float, float]) -> None:
        """Find places and words of the ticks, if there is room for more or fewer of them now."""
        asked = (
            view, self.get_tick_space(), self.major.locator, self.major.formatter,
            self.minor.locator, self.minor.formatter,
        )  # fmt: skip
        if asked == self._asked:
            return
        self._asked = asked
        found = []
        for major in (True, False):
            ticker = self.major if major else self.minor
            if isinstance(ticker.locator, NullLocator):
                continue
            places = self.get_majorticklocs() if major else self.get_minorticklocs()
            if not len(places):
                continue
            tick = (self.get_major_ticks if major else self.get_minor_ticks)(1)[0]
            labels = ticker.formatter.format_ticks(places)
            there = self._inside(np.asarray(places, dtype=np.float64), view)
            words = [label for label, kept in zip(labels, there, strict=True) if kept]
            found.append((tick, np.asarray(places, dtype=np.float64)[there], words))
        self._ticks = tuple(found)

    def _inside(self: Any, places: Floats, view: tuple[float, float]) -> Any:
        """Which places lie on the axis."""
        transform = self.get_transform()
        low, high = sorted(transform.transform(np.array(view)))
        at, rim = transform.transform(places), _CLOSE * (high - low)
        return (at >= low - rim) & (at <= high + rim)

    def _update_ticks(self: Any) -> list[Any]:
        """The ticks of which all others are copies."""
        self._measured()
        return [tick for tick, places, _ in self._ticks if len(places)]

    def _get_ticklabel_bboxes(
        self: Any, ticks: Any, renderer: Any
    ) -> tuple[list[Bbox], list[Bbox]]:
        """The room of the numbers on either side, of all together: its ends are all that counts."""
        self._measured()
        if self._boxes is None:
            first: list[Floats] = []
            second: list[Floats] = []
            for tick, places, words in self._ticks:
                for label, rooms in ((tick.label1, first), (tick.label2, second)):
                    if label.get_visible() and label.get_in_layout():
                        rooms.extend(_rooms(label, self.axis_name, places, words, renderer))
            self._boxes = _around(first), _around(second)
        return list(self._boxes[0]), list(self._boxes[1])

    def get_tightbbox(
        self: Any, renderer: Any = None, *, for_layout_only: bool = False
    ) -> Bbox | None:
        """The room of numbers, marks and name of the axis."""
        if not self.get_visible() or (for_layout_only and not self.get_in_layout()):
            return None
        if renderer is None:
            renderer = self.get_figure(root=True)._get_renderer()
        self._measured()
        key = (for_layout_only, self.label.get_text(), self.label.get_visible())
        if key not in self._extents:
            found = super().get_tightbbox(renderer, for_layout_only=for_layout_only)
            boxes = [] if found is None else [found]
            self._extents[key] = Bbox.union([*boxes, *self._marks()])
        return Bbox(self._extents[key].get_points().copy())

    def _marks(self: Any) -> list[Bbox]:
        """The room of the marks outside of the axes."""
        box = self.axes.bbox
        ticks = [t for t, places, _ in self._ticks if len(places) and t.tick1line.get_visible()]
        outside = max((tick.get_tick_padding() for tick in ticks), default=0.0)
        reach = outside * self.get_figure(root=True).dpi / 72
        if self.axis_name == "x":
            return [Bbox([[box.x0, box.y0 - reach], [box.x1, box.y0]])]
        return [Bbox([[box.x0 - reach, box.y0], [box.x0, box.y1]])]

    def draw(self: Any, renderer: Any) -> None:
        """Draw grid, marks, numbers and name."""
        if not self.get_visible():
            return
        renderer.open_group("axis", gid=self.get_gid())
        drawn = self._update_ticks()
        boxes = self._get_ticklabel_bboxes(drawn, renderer)
        for tick, places, words in self._ticks:
            _draw_tick(tick, self.axis_name, places, words, renderer)
        self._update_label_position(renderer)
        self.label.draw(renderer)
        self._update_offset_text_position(*boxes)
        self.offsetText.set_text(self.major.formatter.get_offset())
        self.offsetText.draw(renderer)
        renderer.close_group("axis")
        self.stale = False

    def set_ticklabels(
        self,
        labels: Iterable[str | Text],
        *,
        minor: bool = False,
        fontdict: dict[str, Any] | None = None,
        **kwargs: Any,
    ) -> list[Text]:
        """Words in place of numbers, where the places are given.

        Args:
            labels: one for each place.
            minor: of the small ticks.
            fontdict: style of the letters.
            kwargs: style of the letters.
        """
        these: Any = self
        if minor or not isinstance(these.get_major_locator(), FixedLocator):
            return super().set_ticklabels(labels, minor=minor, fontdict=fontdict, **kwargs)
        these.set_major_formatter(FixedFormatter([str(label) for label in labels]))
        these.get_major_ticks(1)[0].label1.set(**(fontdict or {}), **kwargs)
        self._key = self._asked = None
        return []


def _rooms(
    label: Any, name: str, places: Floats, words: Sequence[str], renderer: Any
) -> list[Floats]:
    """The room (2, 2) of each of some words along an axis, from that of equal words elsewhere."""
    side = label.get_position()[1 if name == "x" else 0]
    across = np.full(len(places), side)
    at = np.stack((places, across) if name == "x" else (across, places), axis=1)
    anchors = label.get_transform().transform(at)
    look = (
        label.get_rotation(), label.get_rotation_mode(), label.get_ha(), label.get_va(),
        label.get_fontsize(), label.get_fontweight(), label.get_figure(root=True).dpi,
        type(renderer),
    )  # fmt: skip
    found = []
    for place, word, anchor in zip(places, words, anchors, strict=True):
        if not word:
            continue
        key = (word, *look)
        if key not in _known:
            _put(label, name, place, word)
            room = label.get_window_extent(renderer).get_points() - anchor
            _known[key] = np.round(room, _DIGITS)  # the same wherever it was first measured
        found.append(_known[key] + anchor)
    return found


def _around(rooms: Sequence[Floats]) -> list[Bbox]:
    """The one room of all of some, lower and upper corner each; none of none."""
    if not rooms:
        return []
    corners = np.stack(rooms)
    return [Bbox([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])]


def _put(label: Any, name: str, place: float, word: str) -> None:
    (label.set_x if name == "x" else label.set_y)(place)
    label.set_text(word)


def _draw_tick(tick: Any, name: str, places: Floats, words: Sequence[str], renderer: Any) -> None:
    """One tick at all places: its lines together, its words one by one."""
    if not tick.get_visible() or not len(places):
        return
    if tick.gridline.get_visible():
        along = np.repeat(places, 3)
        along[2::3] = np.nan
        across = np.tile([0.0, 1.0, np.nan], len(places))
        tick.gridline.set_data(*((along, across) if name == "x" else (across, along)))
        tick.gridline.draw(renderer)
    for line, side in ((tick.tick1line, 0.0), (tick.tick2line, 1.0)):
        if line.get_visible():
            across = np.full(len(places), side)
            line.set_data(*((places, across) if name == "x" else (across, places)))
            line.draw(renderer)
    for label in (tick.label1, tick.label2):
        if label.get_visible():
            for place, word in zip(places, words, strict=True):
                _put(label, name, place, word)
                label.draw(renderer)


class _LeanX(_LeanAxis, XAxis):
    """An axis along x."""

    def get_ticks_position(self) -> Literal["top", "bottom", "default", "unknown"]:
        """The side on which marks and numbers stand."""
        return "default" if self._usual_side() else "unknown"

    def _update_label_position(self: Any, renderer: Any) -> None:
        """Put the name under the numbers."""
        if self.label_position != "bottom" or not self._autolabelpos:
            plain: Any = XAxis
            plain._update_label_position(self, renderer)
            return
        boxes = self._get_tick_boxes_siblings(renderer)[0]
        low = min(box.y0 for box in [*boxes, *self._marks()])
        x, _ = self.label.get_position()
        self.label.set_position((x, low - self.labelpad * self.get_figure(root=True).dpi / 72))


class _LeanY(_LeanAxis, YAxis):
    """An axis along y."""

    def get_ticks_position(self) -> Literal["left", "right", "default", "unknown"]:
        """The side on which marks and numbers stand."""
        return "default" if self._usual_side() else "unknown"

    def _update_label_position(self: Any, renderer: Any) -> None:
        """Put the name beside the numbers."""
        if self.label_position != "left" or not self._autolabelpos:
            plain: Any = YAxis
            plain._update_label_position(self, renderer)
            return
        boxes = self._get_tick_boxes_siblings(renderer)[0]
        low = min(box.x0 for box in [*boxes, *self._marks()])
        _, y = self.label.get_position()
        self.label.set_position((low - self.labelpad * self.get_figure(root=True).dpi / 72, y))


class _LeanAxes(Axes):
    """Axes in the plane with lean ticks."""

    _extents: dict[Any, Bbox | None] | None = None
    """Their room at places where they were measured; None while more may change than places."""

    _around: list[Artist] | None = None
    """What needs room beside them, once it was looked for."""

    _final = False
    """Whether the limits are those that were found last: nothing is added meanwhile."""

    def _unstale_viewLim(self) -> None:  # noqa: N802 - a method of matplotlib
        """Find the limits again if something was added, which matplotlib asks at each place."""
        if not self._final:
            plain: Any = super()
            plain._unstale_viewLim()

    @contextmanager
    def limits_kept(self) -> Iterator[None]:
        """While nothing is added that may change the limits."""
        self._unstale_viewLim()
        before, self._final = self._final, True
        try:
            yield
        finally:
            self._final = before

    def _init_axis(self) -> None:
        these: Any = self
        these.xaxis, these.yaxis = _LeanX(these, clear=False), _LeanY(these, clear=False)
        these.spines.bottom.register_axis(these.xaxis)
        these.spines.top.register_axis(these.xaxis)
        these.spines.left.register_axis(these.yaxis)
        these.spines.right.register_axis(these.yaxis)

    def draw(self, renderer: Any) -> None:
        """Draw all that is in the axes; lines of the frame have a place also without ticks."""
        for side in ("left", "right", "bottom", "top"):
            self.spines[
                side
            ].get_spine_transform()  # finds the place, which else the first tick asks for
        with self.limits_kept():
            super().draw(renderer)

    def get_tightbbox(self, renderer: Any = None, **asked: Any) -> Bbox | None:
        """Their room with all that stands around them.

        Args:
            renderer: measures words.
            asked: what matplotlib wants to be left out.
        """
        if self._extents is None:
            return self._plain_tightbbox(renderer, asked)
        these: Any = self
        key = (
            self.get_position(original=True).bounds, self.viewLim.bounds, these.figure.dpi,
            *sorted(asked.items()),
        )  # fmt: skip
        if key not in self._extents:
            self._extents[key] = self._plain_tightbbox(renderer, asked)
        found = self._extents[key]
        return None if found is None else Bbox(found.get_points().copy())

    def _plain_tightbbox(self, renderer: Any, asked: dict[str, Any]) -> Bbox | None:
        plain: Any = super()
        found: Bbox | None = plain.get_tightbbox(renderer, **asked)
        return found

    def get_default_bbox_extra_artists(self) -> list[Artist]:
        """What needs room beside the axes; their frame has it with the ticks."""
        if self._extents is None:
            return self._beside()
        if self._around is None:
            self._around = self._beside()
        return self._around

    def _beside(self) -> list[Artist]:
        every = super().get_default_bbox_extra_artists()
        return [a for a in every if not isinstance(a, Spine) and a is not self.patch]


@contextmanager
def only_places_change(figure: Any) -> Iterator[None]:
    """While a figure is laid out: what was measured at a place holds when it is asked for again.

    A scale of colours that several panels share is asked for its room once for each of them, and
    each panel whether its lines and areas may lie beyond its frame.
    """
    lean = [axes for axes in figure.axes if isinstance(axes, _LeanAxes)]
    for axes in lean:
        axes._extents = {}
    try:
        with ExitStack() as kept:
            for axes in lean:
                kept.enter_context(axes.limits_kept())
            yield
    finally:
        for axes in lean:
            axes._extents = axes._around = None


@contextmanager
def lean_axes() -> Iterator[None]:
    """Figures made inside have lean axes; those of a user's own code never."""
    register_projection(_LeanAxes)
    try:
        yield
    finally:
        register_projection(Axes)

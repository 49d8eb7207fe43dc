"""Where figures stand on paper: rows of figures in one scale, so that pages become full.

A browser breaks lines and pages, but it does not choose sizes: figures as wide as their letters
want leave half a page empty before each that is high, and small ones cannot be read. So the rows
are chosen here, for pages of A4, as they cost least: what a report is long, with what stays empty
at the end of pages, and letters that become small. How high the texts and tables between the
figures are is estimated; the browser only has to keep rows together.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from geoident.report.text.layout import TextTable

WIDTH, HEIGHT = 680.0, 990.0
"""Pixels of a page of A4 without its margins."""

STEP = 2
"""Parts of the width are multiples of it, per cent."""

_LARGEST = 0.72
"""Scale at which letters of 8.5 points are as high as those of a footnote; none is larger."""

_READABLE, _SMALL_COSTS = 0.6, 3000.0
"""Below this scale a figure costs pixels of height by the square of what it lacks."""

_TINY, _TINY_COSTS = 0.36, 6000.0
"""Below this scale nobody reads a figure: a page is rather left empty."""

_TALLEST = (170.0, 210.0, 250.0, 290.0, 330.0, 370.0, 410.0, 450.0, 520.0, 600.0)
"""Heights of figures in a row that are tried, pixels."""

_MOST = 4
"""Figures in a row."""

_BESIDE = 74
"""Part of the width, per cent, up to which a caption finds room at the side."""

_GAP = 2
"""Part of the width, per cent, between figures in a row."""

_LETTER, _LINE, _BETWEEN = 6.3, 14.6, 16.0  # of captions, and between rows, pixels
_TEXT_LETTER, _TEXT_LINE, _AROUND = 6.5, 15.9, 9.0  # of text, and around a paragraph, pixels
_CELL_LETTER, _CELL_LINE, _CELL_RIM = 5.9, 14.0, 3.5  # of tables, pixels
_LONGEST_CELL = 60  # letters
HEADING = 42.0
"""Height of the heading of a section with what is around it, pixels."""

HEAD = 95.0
"""Height of the head of the page, pixels."""

_BIN = 10.0
"""Ends of pages that differ by less are not told apart, pixels."""

_PARAGRAPH = re.compile(r"<(p|li)\b[^>]*>(.*?)</\1>", re.DOTALL)
_TAG = re.compile(r"<[^>]*>")


@dataclass(frozen=True)
class Drawn:
    """What has to find a place.

    Args:
        width: of the picture, pixels.
        height: of the picture, pixels.
        letters: of its caption.
    """

    width: float
    height: float
    letters: int


@dataclass(frozen=True)
class PrintedPlace:
    """How a figure stands on paper.

    Args:
        part: of the width of the page that its drawing takes, per cent.
        beside: its caption stands at its side.
    """

    part: int
    beside: bool = False


@dataclass(frozen=True)
class _FigureRow:
    """Figures side by side, and what they need.

    Args:
        places: of the figures.
        height: on paper, pixels.
        cost: of letters that are small, in pixels of height.
    """

    places: tuple[PrintedPlace, ...]
    height: float
    cost: float


Item = float | Sequence[Drawn]
"""Text of so many pixels height, or figures that follow each other."""

_Way = tuple[float, float, tuple[_FigureRow, ...]]
"""Cost so far, where it ends on its page, and the rows."""


def printed_rows(items: Sequence[Item]) -> list[list[tuple[PrintedPlace, ...]]]:
    """The rows of figures of a document that cost least.

    Args:
        items: what it is made of, in its order.

    Returns:
        For each item of figures its rows, each the places of its figures.
    """
    ways: dict[int, _Way] = {0: (0.0, 0.0, ())}
    counts, kept = [], 0.0
    for item in items:
        if isinstance(item, float):
            ways = _best(_after_text(way, item) for way in ways.values())
            kept = item if item <= 2 * HEADING else 0.0
            continue
        ends = [ways, *({} for _ in item)]
        for start in range(len(item)):
            for end in range(start + 1, min(start + _MOST, len(item)) + 1):
                rows = _rows(item[start:end])
                found = [_after_row(way, row, kept) for way in ends[start].values() for row in rows]
                ends[end] = _best([*ends[end].values(), *found])
            kept = 0.0
        ways = ends[-1]
        counts.append(len(item))
    _, _, rows_found = min(ways.values(), key=lambda way: way[0])
    return _by_item(rows_found, counts)


def _by_item(
    rows: Sequence[_FigureRow], counts: Sequence[int]
) -> list[list[tuple[PrintedPlace, ...]]]:
    """Rows given back to the items whose figures they hold."""
    left = iter(rows)
    found = []
    for count in counts:
        own: list[tuple[PrintedPlace, ...]] = []
        while sum(map(len, own)) < count:
            own.append(next(left).places)
        found.append(own)
    return found


def _best(ways: Iterable[_Way]) -> dict[int, _Way]:
    """The cheapest of the ways that end at the same height of a page."""
    found: dict[int, _Way] = {}
    for way in ways:
        place = int(way[1] / _BIN)
        if place not in found or way[0] < found[place][0]:
            found[place] = way
    return found


def _after_text(way: _Way, height: float) -> _Way:
    """Text may go on on the next page."""
    cost, at, rows = way
    return cost + height, (at + height) % HEIGHT, rows


def _after_row(way: _Way, row: _FigureRow, kept: float) -> _Way:
    """A row stands on one page, with the heading or the line before it."""
    cost, at, rows = way
    empty = 0.0
    if at + row.height > HEIGHT:
        empty = HEIGHT - at + min(kept, at)
        at = min(kept, at)
    return cost + empty + row.height + row.cost, at + row.height, (*rows, row)


def _rows(figures: Sequence[Drawn]) -> list[_FigureRow]:
    """The ways in which some figures can stand in one row, the different ones."""
    trials = [_in_scale(figures, tallest, beside=False) for tallest in _TALLEST]
    if len(figures) == 1:
        trials += [_in_scale(figures, tallest, beside=True) for tallest in _TALLEST]
    return list({row.places: row for row in trials}.values())


def _in_scale(figures: Sequence[Drawn], tallest: float, *, beside: bool) -> _FigureRow:
    """Figures in one scale, at most so many pixels high.

    Args:
        figures: of a row.
        tallest: height of the highest, pixels.
        beside: the caption of a single one stands at its side.
    """
    room = _BESIDE if beside else 100 - _GAP * (len(figures) - 1)
    across = sum(figure.width for figure in figures)
    highest = max(figure.height for figure in figures)
    scale = min(_LARGEST, room / 100 * WIDTH / across, tallest / highest)
    parts = [_part(figure.width * scale) for figure in figures]
    heights = []
    for figure, part in zip(figures, parts, strict=True):
        words = 98 - part if beside else part
        caption = _LINE * math.ceil(figure.letters * _LETTER / (words / 100 * WIDTH))
        picture = figure.height * part / 100 * WIDTH / figure.width
        heights.append(max(picture, caption) if beside else picture + caption)
    lack = max(_READABLE - scale, 0.0)
    cost = (_SMALL_COSTS * lack**2 + _TINY_COSTS * max(_TINY - scale, 0.0)) * len(figures)
    return _FigureRow(
        tuple(PrintedPlace(part, beside) for part in parts), max(heights) + _BETWEEN, cost
    )


def _part(width: float) -> int:
    """Part of the width of a page, per cent, a step down."""
    return min(max(STEP * math.floor(100 * width / WIDTH / STEP + 1e-9), 2 * STEP), 98)


def text_height(html: str) -> float:
    """How high paragraphs and lists are on paper, about, pixels.

    Args:
        html: what they are written in.
    """
    texts = [_TAG.sub("", found[2]) for found in _PARAGRAPH.finditer(html)]
    lines = sum(max(1, math.ceil(len(text) * _TEXT_LETTER / WIDTH)) for text in texts)
    return _TEXT_LINE * lines + _AROUND * len(texts)


def table_height(table: TextTable) -> float:
    """How high a table is on paper, about, pixels.

    Args:
        table: its header and cells.
    """
    rows = [table.header, *table.rows]
    longest = [max(min(len(row[k]), _LONGEST_CELL) for row in rows) for k in range(len(rows[0]))]
    room = min(1.0, WIDTH / (_CELL_LETTER * (sum(longest) + 2 * len(longest))))
    lines = (
        max(math.ceil(len(cell) / max(room * most, 1.0)) for cell, most in
            zip(row, longest, strict=True))
        for row in rows
    )  # fmt: skip
    return 2 * _TEXT_LINE + sum(_CELL_LINE * count + _CELL_RIM for count in lines)

"""Words in an SVG: real text, as wide on every machine as matplotlib laid it out.

Glyphs as paths look the same everywhere, but nobody can search, copy or hear them. So words are
text elements, and each is given the length that its letters have in DejaVu Sans, with which the
figure was laid out: where a machine has another font, the browser fits it into this length, and no
label grows over its neighbour. Verdana, on most machines without DejaVu Sans, has nearly the same
letters. Outlines of letters (path effects), which matplotlib can only draw as paths, become strokes
of the text itself.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

from matplotlib.figure import Figure, SubFigure
from matplotlib.font_manager import FontProperties
from matplotlib.text import Text
from matplotlib.textpath import text_to_path

FONTS = "'DejaVu Sans', Verdana, Geneva, sans-serif"
"""Fonts of figures, the first that a machine has."""

HALO = "halo-"
"""Begin of the names of words that have an outline."""

_SIZE = 100.0  # points, of the letters that are measured


def mark_halos(figure: Figure) -> None:
    """Take the outlines from the words of a figure, and mark the words that had one.

    Args:
        figure: about to be written as SVG.
    """
    outlined = [text for text in _texts(figure) if text.get_path_effects()]
    for k, text in enumerate(outlined):
        text.set_path_effects([])
        text.set_gid(f"{HALO}{k}")


def _texts(figure: Figure | SubFigure) -> Iterable[Text]:
    """What was written into the figure and its panels, without names and numbers of axes."""
    yield from figure.texts
    for axes in figure.axes:
        yield from axes.texts
    for part in figure.subfigs:
        yield from part.texts


def length_of(words: str, size: float, weight: int) -> float:
    """Of words in DejaVu Sans, points.

    Args:
        words: one line.
        size: of the letters, points.
        weight: of the letters, 400 if they are not bold.
    """
    return size_of(words, size, weight)[0]


def size_of(words: str, size: float, weight: int) -> tuple[float, float, float]:
    """Width, height and what hangs below the line of words in DejaVu Sans, points.

    Args:
        words: one line.
        size: of the letters, points.
        weight: of the letters, 400 if they are not bold.
    """
    width, height, descent = _measured(words, weight)
    return width * size, height * size, descent * size


@lru_cache(maxsize=16384)
def _measured(words: str, weight: int) -> tuple[float, float, float]:
    """Of letters of one point."""
    font = FontProperties(family="DejaVu Sans", size=_SIZE, weight=weight)
    found = text_to_path.get_text_width_height_descent(words, font, ismath=False)
    width, height, descent = (float(length) / _SIZE for length in found)
    return width, height, descent

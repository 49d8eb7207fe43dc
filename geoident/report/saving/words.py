"""Words in an SVG: real text, as wide on every machine as matplotlib laid it out.

Glyphs as paths look the same everywhere, but nobody can search, copy or hear them. So matplotlib
writes text elements here, and each is given the length that its letters have in DejaVu Sans, with
which the figure was laid out: where a machine has another font, the browser fits it into this
length, and no label grows over its neighbour. Verdana, on most machines without DejaVu Sans, has
nearly the same letters. Outlines of letters (path effects), which matplotlib can only draw as
paths, become strokes of the text itself.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import lru_cache
from xml.etree import ElementTree

from matplotlib.figure import Figure, SubFigure
from matplotlib.font_manager import FontProperties
from matplotlib.text import Text
from matplotlib.textpath import text_to_path

FONTS = "'DejaVu Sans', Verdana, Geneva, sans-serif"
"""Fonts of figures, the first that a machine has."""

_SVG = "http://www.w3.org/2000/svg"
_XLINK = "http://www.w3.org/1999/xlink"
_HALO = "halo-"
_STROKE = {
    "stroke": "#ffffff",
    "stroke-width": "2",
    "stroke-linejoin": "round",
    "paint-order": "stroke",
}
_REFERENCE = re.compile(r"url\(#([^)]+)\)")
_SPACES = re.compile(r"^ +| +$|(?<= ) +")

ElementTree.register_namespace("", _SVG)
ElementTree.register_namespace("xlink", _XLINK)


def mark_halos(figure: Figure) -> None:
    """Take the outlines from the words of a figure, and mark the words that had one.

    Args:
        figure: about to be written as SVG.
    """
    outlined = [text for text in _texts(figure) if text.get_path_effects()]
    for k, text in enumerate(outlined):
        text.set_path_effects([])
        text.set_gid(f"{_HALO}{k}")


def _texts(figure: Figure | SubFigure) -> Iterable[Text]:
    """What was written into the figure and its panels, without names and numbers of axes."""
    yield from figure.texts
    for axes in figure.axes:
        yield from axes.texts
    for part in figure.subfigs:
        yield from part.texts


def with_words(svg: bytes, *, title: str, description: str) -> bytes:
    """An SVG document whose words fit on every machine, with a title and a description.

    Args:
        svg: as matplotlib writes it, with text as text, after `mark_halos`.
        title: what it shows.
        description: what has to be known to read it.
    """
    root = ElementTree.fromstring(svg)
    for group in root.iter(f"{{{_SVG}}}g"):
        if group.get("id", "").startswith(_HALO):
            for text in group.iter(f"{{{_SVG}}}text"):
                text.attrib |= _STROKE
    for text in root.iter(f"{{{_SVG}}}text"):
        _fit(text)
    _number_names(root)
    root.set("font-family", FONTS)
    for name, words in (("desc", description), ("title", title)):
        if words:
            element = ElementTree.Element(f"{{{_SVG}}}{name}")
            element.text = words
            root.insert(0, element)
    written: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return written


def _number_names(root: ElementTree.Element) -> None:
    """Names of what is referred to by numbers in their order.

    matplotlib makes them of what they name, and of some transforms it takes the place in memory.
    """
    pairs = [pair for element in root.iter() for pair in element.attrib.items()]
    used = dict.fromkeys(name for key, text in pairs for name in _referred(key, text))
    new = {old: f"r{k}" for k, old in enumerate(used)}
    for element in root.iter():
        for key, text in element.attrib.items():
            if key == "id":
                element.set(key, new.get(text, text))
            for old in _referred(key, text):
                element.set(key, text.replace(f"#{old}", f"#{new[old]}"))


def _referred(key: str, text: str) -> list[str]:
    """Names that an attribute refers to; a colour is none."""
    if key.endswith("href"):
        return [text[1:]] if text.startswith("#") else []
    return _REFERENCE.findall(text)


def _fit(element: ElementTree.Element) -> None:
    """Say how long a text is; its font is that of the figure."""
    words = element.text or ""
    style = dict(_pairs(element.get("style", "")))
    style.pop("font-family", None)
    size = float(style["font-size"].removesuffix("px"))
    length = _length(words, size, int(style.get("font-weight", "400")))
    if words.strip():
        element.set("textLength", f"{length:.2f}".rstrip("0").rstrip("."))
        element.set("lengthAdjust", "spacingAndGlyphs")
    element.text = _SPACES.sub(lambda found: "\u00a0" * len(found[0]), words)
    element.set("style", "; ".join(f"{key}: {value}" for key, value in style.items()))


def _pairs(style: str) -> Iterable[tuple[str, str]]:
    for part in style.split(";"):
        key, colon, value = part.partition(":")
        if colon:
            yield key.strip(), value.strip()


@lru_cache(maxsize=4096)
def _length(words: str, size: float, weight: int) -> float:
    """Of words in DejaVu Sans, in the units of the drawing."""
    font = FontProperties(family="DejaVu Sans", size=size, weight=weight)
    width, _, _ = text_to_path.get_text_width_height_descent(words, font, ismath=False)
    return float(width)

"""Figures inside a page: SVG of matplotlib as elements of HTML.

A file of SVG is a document of its own, whose names repeat from figure to figure. In a page each
name gets the figure's prefix, and what belongs to a document falls out: its declaration, metadata
and style, which the page has for all figures.
"""

from __future__ import annotations

import re
from xml.etree import ElementTree

from geoident.report.page.html import Html, tag

_REFERENCE = re.compile(r"(^#|url\(#)([^)]+)")
"""In the value of an attribute, the name of another element behind its mark."""


def inline_svg(svg: bytes, *, name: str, text: str) -> Html:
    """A file of SVG as an element of HTML.

    Args:
        svg: as matplotlib writes it.
        name: of the figure; prefix of the names inside.
        text: what it shows, for those who cannot see it.
    """
    root = ElementTree.fromstring(svg)
    values = [value for element in root.iter() for value in element.attrib.values()]
    needed = {match[2] for value in values for match in _REFERENCE.finditer(value)}
    for element in root.iter():
        for child in list(element):
            if _local(child.tag) in ("title", "metadata", "style"):
                element.remove(child)
        element.tag, element.tail = _local(element.tag), None
        if element.tag != "text":
            element.text = None  # blanks between elements
        element.attrib = {
            _local(key): f"{name}-{value}" if key == "id" else _prefixed(value, name)
            for key, value in element.attrib.items()
            if key != "id" or value in needed
        }
    size = {key: root.attrib[key] for key in ("width", "height", "viewBox")}
    root.attrib = {**size, "role": "graphics-document document", "aria-label": text}
    return Html(ElementTree.tostring(root, encoding="unicode"))


def _local(name: str) -> str:
    """A name without its namespace, which HTML knows by itself."""
    return name.rpartition("}")[2]


def _prefixed(value: str, name: str) -> str:
    """The value of an attribute with the prefix in its references."""
    return _REFERENCE.sub(lambda match: f"{match[1]}{name}-{match[2]}", value)


def figure_element(svg: bytes, *, name: str, title: str, caption: str) -> Html:
    """A figure with its caption; the style of the page sizes it by its own width.

    Args:
        svg: the picture.
        name: of the figure, for its id.
        title: what it shows.
        caption: what more is to be said.
    """
    picture = inline_svg(svg, name=name, text=title)
    (width,) = re.findall(r'^<svg[^>]* width="([^"]+)"', picture)
    words = tag("figcaption", tag("b", f"{title}. "), caption)
    drawing = tag("div", picture, class_="drawing")
    return tag("figure", drawing, words, id=f"figure-{name}", style=f"--width: {width}")

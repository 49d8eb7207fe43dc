"""Figures inside a page: SVG of matplotlib as elements of HTML."""

from __future__ import annotations

import re
from xml.etree import ElementTree

from geoident.report.page.html import Html


def inline_svg(svg: bytes, *, text: str) -> Html:
    """A file of SVG as an element of HTML.

    What belongs to a document falls out: declaration, namespaces, metadata, the style, which the
    page has for all figures, and names to which nothing refers, since all figures have the same.

    Args:
        svg: as matplotlib writes it.
        text: what it shows, for those who cannot see it.
    """
    root = ElementTree.fromstring(svg)
    values = [value for element in root.iter() for value in element.attrib.values()]
    referred = {name for value in values for name in re.findall(r"#(\w+)", value)}
    for element in root.iter():
        for child in list(element):
            if _local(child.tag) in ("title", "metadata", "style"):
                element.remove(child)
        element.tag, element.tail = _local(element.tag), None
        if element.tag != "text":
            element.text = None  # blanks between elements
        element.attrib = {
            _local(key): value
            for key, value in element.attrib.items()
            if key != "id" or value in referred
        }
    size = {key: root.attrib[key] for key in ("width", "height", "viewBox")}
    root.attrib = {**size, "role": "graphics-document document", "aria-label": text}
    return Html(ElementTree.tostring(root, encoding="unicode"))


def _local(name: str) -> str:
    """A name without its namespace, which HTML knows by itself."""
    return name.rpartition("}")[2]

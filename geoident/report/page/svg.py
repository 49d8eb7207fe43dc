"""Figures inside a page: SVG of matplotlib made fit for HTML.

matplotlib writes a document of its own: with namespaces, a style attribute on every element, names
that repeat from figure to figure. In a page under a strict content-security policy style attributes
do not count, and equal names collide. So styles become attributes of SVG, names get the figure's
prefix or go, and images are stored with a palette of 256 colours, a quarter of their size.
"""

from __future__ import annotations

import base64
import io
import math
import re
from xml.etree import ElementTree

from PIL import Image

from geoident.report.page.html import Html, tag

_LINK = "{http://www.w3.org/1999/xlink}href"
_REFERENCE = re.compile(r"url\(#([^)]+)\)")
_SIZE = re.compile(r' width="(\d+)" height="(\d+)"')
_PRINT_SCALE = 0.6
"""Letters of 8.5 points are 5 points high on paper."""
_PRINT_WIDTH = 680  # pixels of A4 without its margins
_PRINT_HEIGHT = 300  # pixels of a figure at most, so that three find room on a page
_DROPPED = ("metadata", "style", "title", "desc")
_NUMBER = re.compile(r"-?\d+\.\d{3,}")


def inline_svg(svg: bytes, *, name: str, text: str) -> Html:
    """An SVG document as an element of HTML.

    Args:
        svg: as `figure_file` writes it, with text as text.
        name: of the figure; prefix of the names inside.
        text: what it shows, for those who cannot see it.
    """
    root = ElementTree.fromstring(svg)
    targets = (_target(*item) for element in root.iter() for item in element.attrib.items())
    used = dict.fromkeys(old for old in targets if old)  # in their order: names may be of memory
    names = {old: f"{name}-{k}" for k, old in enumerate(used)}
    _clean(root, names)
    width, height = (
        round(float(root.attrib.pop(key).removesuffix("pt")) * 4 / 3) for key in ("width", "height")
    )
    root.attrib.pop("version", None)
    root.attrib |= {"width": str(width), "height": str(height)}
    root.attrib |= {"role": "graphics-document document", "aria-label": text}
    root.attrib |= {"stroke-linejoin": "round", "stroke-linecap": "butt"}
    return Html(ElementTree.tostring(root, encoding="unicode", short_empty_elements=True))


def figure_element(svg: bytes, *, name: str, title: str, caption: str) -> Html:
    """A figure with its caption.

    Args:
        svg: the picture.
        name: of the figure, for its id.
        title: what it shows.
        caption: what more is to be said.
    """
    picture = inline_svg(svg, name=name, text=title)
    words = tag("figcaption", tag("b", f"{title}. "), caption)
    drawing = tag("div", picture, class_="drawing")
    return tag("figure", drawing, words, id=f"figure-{name}", class_=_sizes(picture))


def _sizes(picture: str) -> str:
    """Classes of a figure: by its width on a screen, and by its part of a printed page."""
    found = _SIZE.search(picture)
    width, height = (int(found[1]), int(found[2])) if found else (0, 1)
    scale = min(_PRINT_SCALE, _PRINT_HEIGHT / height)
    part = 100.0 * scale * width / _PRINT_WIDTH
    return f"w{min(max(round(width / 100), 1), 20)} p{min(max(5 * math.ceil(part / 5), 10), 100)}"


def _target(key: str, value: str) -> str:
    """The name that an attribute refers to; empty for none."""
    if key in ("href", _LINK):
        return value[1:] if value.startswith("#") else ""
    match = _REFERENCE.search(value)
    return match[1] if match else ""


def _clean(element: ElementTree.Element, names: dict[str, str]) -> None:
    """Drop namespaces, styles and unused names, down the tree."""
    element.tag = element.tag.rpartition("}")[2]
    element.attrib = {
        key: value
        for old, text in _attributes(element)
        for key, value in [(old, _renamed(old, text, names))]
        if value
    }
    if element.text and not element.text.strip():
        element.text = None
    element.tail = None
    for child in list(element):
        if child.tag.rpartition("}")[2] in _DROPPED:
            element.remove(child)
        else:
            _clean(child, names)


def _attributes(element: ElementTree.Element) -> list[tuple[str, str]]:
    """The attributes with the parts of ``style`` among them; links without namespace."""
    found = []
    for key, value in element.attrib.items():
        if key == "style":
            parts = (part.partition(":") for part in value.split(";") if part.strip())
            found += [(name.strip(), text.strip()) for name, _, text in parts]
        else:
            found.append(("href" if key == _LINK else key, value))
    return found


def _renamed(key: str, value: str, names: dict[str, str]) -> str:
    """The value of an attribute in the page; empty where the attribute goes."""
    if key == "id":
        return names.get(value, "")
    if key == "href" and value.startswith("data:image/png"):
        return _smaller(value)
    target = _target(key, value)
    if target:
        return value.replace(f"#{target}", f"#{names[target]}")
    if key in ("d", "x", "y"):
        return _NUMBER.sub(lambda match: f"{float(match[0]):.2f}".rstrip("0").rstrip("."), value)
    return value


def _smaller(address: str) -> str:
    """A PNG in a data address with a palette of its own."""
    data = base64.b64decode(address.partition(",")[2])
    with Image.open(io.BytesIO(data)) as picture:
        buffer = io.BytesIO()
        few = picture.convert("RGBA").quantize(256, method=Image.Quantize.FASTOCTREE)
        few.save(buffer, format="png", compress_level=7)
    smaller = min(buffer.getvalue(), data, key=len)
    return f"data:image/png;base64,{base64.b64encode(smaller).decode('ascii')}"

"""Figures inside a page: SVG of matplotlib made fit for HTML.

A figure is a document of its own, with names that repeat from figure to figure; in a page equal
names collide, so they get the figure's prefix. It has no styles, which a strict content-security
policy would forbid (`report.saving.svg_writer`).
"""

from __future__ import annotations

import math
import re
from html import escape

from geoident.report.page.html import Html, tag
from geoident.report.saving.svg_writer import LINK

_HEAD = re.compile(
    r'<svg .*?width="([^"]+)pt" height="([^"]+)pt" viewBox="([^"]+)".*?family="([^"]+)"'
)
_SAID = re.compile(r"<(title|desc)>[^<]*</\1>")
_NAMES = re.compile(r'((?: id="|="#|="url\(#))(r\d+)')
_SIZE = re.compile(r' width="(\d+)" height="(\d+)"')
_PRINT_SCALE = 0.6
"""Letters of 8.5 points are 5 points high on paper."""
_PRINT_WIDTH = 680  # pixels of A4 without its margins
_PRINT_HEIGHT = 300  # pixels of a figure at most, so that three find room on a page


def inline_svg(svg: bytes, *, name: str, text: str) -> Html:
    """An SVG document as an element of HTML.

    Args:
        svg: as `figure_file` writes it.
        name: of the figure; prefix of the names inside.
        text: what it shows, for those who cannot see it.
    """
    document = svg.decode()
    head, inner = _HEAD.search(document), _SAID.sub("", document, count=2)
    inner = inner[inner.index(">", inner.index("<svg ")) + 1 :].strip()
    inner = _NAMES.sub(lambda found: f"{found[1]}{name}-{found[2]}", inner)
    inner = inner.replace(f" {LINK}=", " href=")
    if head is None:
        msg = "not an SVG that figure_file wrote"
        raise ValueError(msg)
    width, height = (round(float(length) * 4 / 3) for length in head.groups()[:2])
    start = (
        f'<svg width="{width}" height="{height}" viewBox="{head[3]}" font-family="{head[4]}" '
        f'role="graphics-document document" aria-label="{escape(text)}" stroke-linejoin="round">'
    )
    return Html(start + inner)


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

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
MOST_ALONE = 75
"""Part of a page, per cent, beside which a caption still finds room."""

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
    width, height = (round(length) for length in _size(svg))
    inner = inner[inner.index(">", inner.index("<svg ")) + 1 :].strip()
    inner = _NAMES.sub(lambda found: f"{found[1]}{name}-{found[2]}", inner)
    inner = inner.replace(f" {LINK}=", " href=")
    box, fonts = head.groups()[2:] if head else ("", "")
    start = (
        f'<svg width="{width}" height="{height}" viewBox="{box}" font-family="{fonts}" '
        f'role="graphics-document document" aria-label="{escape(text)}" stroke-linejoin="round">'
    )
    return Html(start + inner)


def figure_element(svg: bytes, *, name: str, title: str, caption: str, alone: bool = False) -> Html:
    """A figure with its caption.

    Args:
        svg: the picture.
        name: of the figure, for its id.
        title: what it shows.
        caption: what more is to be said.
        alone: nothing stands beside it on paper, so that its caption finds room there.
    """
    picture = inline_svg(svg, name=name, text=title)
    words = tag("figcaption", tag("b", f"{title}. "), caption)
    drawing = tag("div", picture, class_="drawing")
    return tag("figure", drawing, words, id=f"figure-{name}", class_=_sizes(svg, alone=alone))


def printed_part(svg: bytes) -> int:
    """Part of the width of a printed page that a figure takes, per cent.

    Args:
        svg: the picture.
    """
    width, height = _size(svg)
    scale = min(_PRINT_SCALE, _PRINT_HEIGHT / height)
    part = 100.0 * scale * width / _PRINT_WIDTH
    return min(max(5 * math.ceil(part / 5), 10), 100)


def _sizes(svg: bytes, *, alone: bool) -> str:
    """Classes of a figure: by its width on a screen, and by its part of a printed page."""
    part = printed_part(svg)
    wide = min(max(round(_size(svg)[0] / 100), 1), 20)
    return f"w{wide} p{part}" + " alone" * (alone and part <= MOST_ALONE)


def _size(svg: bytes) -> tuple[float, float]:
    """Width and height of a picture, pixels."""
    found = _HEAD.search(svg.decode())
    if found is None:
        msg = "not an SVG that figure_file wrote"
        raise ValueError(msg)
    return float(found[1]) * 4 / 3, float(found[2]) * 4 / 3

"""Figures inside a page: SVG of matplotlib made fit for HTML.

A figure is a document of its own, with names that repeat from figure to figure; in a page equal
names collide, so they get the figure's prefix. It has no styles, which a strict content-security
policy would forbid (`report.saving.svg_writer`).
"""

from __future__ import annotations

import re
from html import escape

from geoident.report.page.html import Html, tag
from geoident.report.page.printed import PrintedPlace
from geoident.report.saving.svg_writer import LINK

_HEAD = re.compile(
    r'<svg .*?width="([^"]+)pt" height="([^"]+)pt" viewBox="([^"]+)".*?family="([^"]+)"'
)
_SAID = re.compile(r"<(title|desc)>[^<]*</\1>")
_NAMES = re.compile(r'((?: id="|="#|="url\(#))(r\d+)')


def inline_svg(svg: bytes, *, name: str, text: str) -> Html:
    """An SVG document as an element of HTML.

    Args:
        svg: as `figure_file` writes it.
        name: of the figure; prefix of the names inside.
        text: what it shows, for those who cannot see it.
    """
    document = svg.decode()
    head, inner = _HEAD.search(document), _SAID.sub("", document, count=2)
    width, height = (round(length) for length in size_of_svg(svg))
    inner = inner[inner.index(">", inner.index("<svg ")) + 1 :].strip()
    inner = _NAMES.sub(lambda found: f"{found[1]}{name}-{found[2]}", inner)
    inner = inner.replace(f" {LINK}=", " href=")
    box, fonts = head.groups()[2:] if head else ("", "")
    start = (
        f'<svg width="{width}" height="{height}" viewBox="{box}" font-family="{fonts}" '
        f'role="graphics-document document" aria-label="{escape(text)}" stroke-linejoin="round">'
    )
    return Html(start + inner)


def figure_element(svg: bytes, *, name: str, title: str, caption: str, place: PrintedPlace) -> Html:
    """A figure with its caption.

    Args:
        svg: the picture.
        name: of the figure, for its id.
        title: what it shows.
        caption: what more is to be said.
        place: on paper.
    """
    picture = inline_svg(svg, name=name, text=title)
    words = tag("figcaption", tag("b", f"{title}. "), caption)
    drawing = tag("div", picture, class_="drawing")
    wide = min(max(round(size_of_svg(svg)[0] / 100), 1), 20)
    sizes = f"w{wide} p{place.part}" + " beside" * place.beside
    return tag("figure", drawing, words, id=f"figure-{name}", class_=sizes)


def size_of_svg(svg: bytes) -> tuple[float, float]:
    """Width and height of a picture, pixels.

    Args:
        svg: as `figure_file` writes it.

    Raises:
        ValueError: it is another picture.
    """
    found = _HEAD.search(svg.decode())
    if found is None:
        msg = "not an SVG that figure_file wrote"
        raise ValueError(msg)
    return float(found[1]) * 4 / 3, float(found[2]) * 4 / 3

"""What a page is made of: sections with figures, tables and text, numbered as they follow.

A page is first put together without numbers, since what is empty falls out; then it is numbered,
and its figures are drawn all at once.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

from geoident.report.drawing.style import Picture
from geoident.report.page.html import Html, joined, table, tag
from geoident.report.page.svg import inline_svg
from geoident.report.text.layout import TextTable

Draw = Callable[[Sequence[Picture]], Sequence[bytes]]
"""Makes the SVG of pictures."""


@dataclass(frozen=True)
class TitledTable:
    """A table of a page.

    Args:
        title: what stands above it, behind its number.
        table: its header and rows.
    """

    title: str
    table: TextTable

    def __bool__(self) -> bool:
        return bool(self.table.rows)


@dataclass(frozen=True)
class Figures:
    """Pictures beside each other, as far as there is room.

    Args:
        pictures: in their order.
    """

    pictures: tuple[Picture, ...]

    def __bool__(self) -> bool:
        return bool(self.pictures)


Block = Html | TitledTable | Figures


@dataclass(frozen=True)
class PagePart:
    """A part of a page.

    Args:
        title: its heading.
        blocks: what stands in it.
        parts: sections within it.
        appendix: it stands behind the report proper and has a letter in place of a number.
        name: of its place in the page, where the title does not tell it from others.
    """

    title: str
    blocks: tuple[Block, ...]
    parts: tuple[PagePart, ...] = ()
    appendix: bool = False
    name: str = ""

    def __bool__(self) -> bool:
        return any(self.blocks) or any(self.parts)

    @property
    def place(self) -> str:
        """Its id: letters and digits of its title.

        >>> PagePart("How well it fits", ()).place
        'section-how-well-it-fits'
        """
        words = re.sub(r"[^a-z0-9]+", "-", (self.name or self.title).lower()).strip("-")
        return f"section-{words}"


def section(title: str, *blocks: Block, appendix: bool = False) -> PagePart:
    """A section of what stands in it; it is nothing if that is nothing.

    Args:
        title: its heading.
        blocks: what stands in it, empty ones among it.
        appendix: see `PagePart`.
    """
    return PagePart(title, tuple(block for block in blocks if block), appendix=appendix)


def contents(sections: Sequence[PagePart]) -> Html:
    """The list of sections with links.

    Args:
        sections: of the page.
    """
    entries = [
        tag(
            "li",
            tag("a", f"{number}\u2002{one.title}", href=f"#{one.place}"),
            class_="part" if "." in number else "",
        )
        for number, one in _listed(sections)
    ]
    return tag("nav", tag("b", "Contents"), tag("ol", *entries), aria_label="Contents")


def _listed(sections: Sequence[PagePart]) -> Iterator[tuple[str, PagePart]]:
    """Sections and their parts, without those of appendices."""
    for number, one in numbered(sections):
        yield number, one
        if not one.appendix:
            yield from ((f"{number}.{k}", part) for k, part in numbered(one.parts))


def numbered(sections: Sequence[PagePart]) -> Iterator[tuple[str, PagePart]]:
    """Sections that are not empty, with their numbers; appendices have letters.

    Args:
        sections: of the page, or of a section.
    """
    kept = [one for one in sections if one]
    numbers = iter(range(1, len(kept) + 1))
    letters = iter("ABCDEFGHIJKLMNOPQRSTUVWXYZ")
    for one in kept:
        yield (next(letters) if one.appendix else str(next(numbers))), one


def body(sections: Sequence[PagePart], draw: Draw) -> Html:
    """Sections as HTML, with figures and tables numbered through.

    Args:
        sections: of the page.
        draw: makes the pictures.
    """
    pictures = list(_pictures(sections))
    drawn = dict(zip((p.name for p in pictures), draw(pictures), strict=True))
    return _Writer(drawn).write(sections)


def _pictures(sections: Iterable[PagePart]) -> Iterator[Picture]:
    for one in sections:
        for block in one.blocks:
            if isinstance(block, Figures):
                yield from block.pictures
        yield from _pictures(one.parts)


class _Writer:
    """Writes sections, and counts figures and tables on the way.

    Args:
        drawn: name of a picture to its SVG.
    """

    def __init__(self, drawn: dict[str, bytes]) -> None:
        self._drawn = drawn
        self._figures = 0
        self._tables = 0

    def write(self, sections: Sequence[PagePart]) -> Html:
        return joined([self._section(number, one, 2) for number, one in numbered(sections)], "\n")

    def _section(self, number: str, one: PagePart, level: int) -> Html:
        heading = tag(f"h{level}", tag("span", f"{number} ", class_="number"), one.title)
        blocks = [self._block(block) for block in one.blocks]
        parts = [self._section(f"{number}.{k}", part, level + 1) for k, part in numbered(one.parts)]
        inner = joined([*blocks, *parts], "\n")
        return tag("section", heading, inner, id=one.place)

    def _block(self, block: Block) -> Html:
        if isinstance(block, Figures):
            return tag("div", *map(self._figure, block.pictures), class_="figures")
        if isinstance(block, TitledTable):
            self._tables += 1
            return table(block.table, caption=f"Table {self._tables}: {block.title}")
        return block

    def _figure(self, picture: Picture) -> Html:
        self._figures += 1
        title = f"Figure {self._figures}: {picture.title}"
        svg = inline_svg(self._drawn[picture.name], text=title)
        words = tag("figcaption", tag("b", f"{title}. "), picture.caption)
        (width,) = re.findall(r'^<svg[^>]* width="([^"]+)"', svg)  # by which the page sizes it
        drawing = tag("div", svg, class_="drawing")
        return tag("figure", drawing, words, id=f"figure-{picture.name}", style=f"--width: {width}")

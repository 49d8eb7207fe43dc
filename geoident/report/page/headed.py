"""A page under its head: what it is, of what, for whom, by whom; the same for all reports."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

from geoident.model.results.head import NO_HEAD, ReportHead
from geoident.report.page.blocks import Draw, PagePart, body, contents
from geoident.report.page.html import Html, page, tag
from geoident.report.page.logo import logo_element


@dataclass(frozen=True)
class PageHead:
    """The head of a page.

    Args:
        title: of the page, where `said` has none.
        created: when what it shows was computed, ISO 8601; several for a comparison.
        versions: of geoident that computed it.
        said: for whom it is made, by whom.
        logo: content of the file of the logo.
    """

    title: str
    created: Collection[str]
    versions: Collection[str]
    said: ReportHead = NO_HEAD
    logo: bytes = field(default=b"", repr=False)

    @property
    def shown(self) -> str:
        """The title of the page."""
        return self.said.title or self.title


def headed_page(head: PageHead, parts: Sequence[PagePart], draw: Draw) -> str:
    """A page with its head, a list of contents and numbered parts.

    Args:
        head: above all.
        parts: of the page; those without content are left out.
        draw: makes the figures.
    """
    said, title = head.said, head.shown
    right = ", ".join(part for part in (said.client, _revision(said), said.date) if part)
    return page(
        f"{title} - geoident",
        _head(head),
        contents(parts),
        tag("main", body(parts, draw)),
        margins=(said.project or title, right if said.project else ""),
    )


def _revision(head: ReportHead) -> str:
    return f"revision {head.revision}" if head.revision else ""


def _head(head: PageHead) -> Html:
    said = head.said
    versions = ", ".join(sorted(set(head.versions) - {""}))
    computed = ", ".join(sorted({created.partition("T")[0] for created in head.created}))
    rows = [
        ("Project", said.project),
        ("Client", said.client),
        ("Author", said.author),
        ("Revision", said.revision),
        ("Date", said.date),
        ("Computed", f"{computed}, geoident {versions}"),
    ]
    entries = [tag(name, text) for key, text in rows if text for name, text in
               (("dt", key), ("dd", text))]  # fmt: skip
    picture = logo_element(head.logo, said.logo) if head.logo else Html("")
    words = tag("div", tag("h1", head.shown), tag("dl", *entries))
    return tag("header", tag("div", words, picture, class_="head"))

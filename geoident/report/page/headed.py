"""A page under its head: what it is, of what, for whom, by whom; the same for all reports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from geoident.model.results.head import ReportHead
from geoident.report.page.blocks import Draw, PagePart, body, contents
from geoident.report.page.html import Html, page, tag
from geoident.report.page.logo import logo_element


def headed_page(
    title: str,
    origins: Sequence[tuple[str, Mapping[str, str]]],
    parts: Sequence[PagePart],
    draw: Draw,
    head: ReportHead,
    logo: bytes,
) -> str:
    """A page with its head, a list of contents and numbered parts.

    Args:
        title: of the page, where the head has none.
        origins: of each result, when it was computed (ISO 8601), and versions by name.
        parts: of the page; those without content are left out.
        draw: makes the figures.
        head: for whom it is made, by whom.
        logo: content of the file of the logo; empty for none.
    """
    title = head.title or title
    days = ", ".join(sorted({created.partition("T")[0] for created, _ in origins}))
    versions = ", ".join(sorted({each.get("geoident", "") for _, each in origins} - {""}))
    computed = f"{days}, geoident {versions}"
    rows = {
        "Project": head.project,
        "Client": head.client,
        "Author": head.author,
        "Revision": head.revision,
        "Date": head.date,
        "Computed": computed,
    }
    entries = [tag(*pair) for name, text in rows.items() if text
               for pair in (("dt", name), ("dd", text))]  # fmt: skip
    picture = logo_element(logo, head.logo) if logo else Html("")
    words = tag("div", tag("h1", title), tag("dl", *entries))
    revision = f"revision {head.revision}" if head.revision else ""
    right = ", ".join(part for part in (head.client, revision, head.date) if part)
    return page(
        f"{title} - geoident",
        tag("header", tag("div", words, picture, class_="head")),
        contents(parts),
        tag("main", body(parts, draw)),
        margins=(head.project or title, right if head.project else "", f"computed {computed}"),
    )

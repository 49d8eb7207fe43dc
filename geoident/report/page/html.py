"""HTML from Python: text is escaped unless it is HTML already, so no user's text becomes markup."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable
from html import escape

from geoident.report.text.layout import TextTable

_VOID = ("meta", "br", "hr", "img")


class Html(str):
    """Text that is HTML already."""

    __slots__ = ()


def tag(name: str, /, *children: str, **attributes: str) -> Html:
    """An element; ``class_`` stands for ``class``.

    >>> tag("p", "1 < 2 ", tag("b", "yes"), class_="x")
    '<p class="x">1 &lt; 2 <b>yes</b></p>'
    """
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(value)}"'
        for key, value in attributes.items()
        if value
    )
    if name in _VOID:
        return Html(f"<{name}{given}>")
    return Html(f"<{name}{given}>{joined(children)}</{name}>")


def joined(parts: Iterable[str], separator: str = "") -> Html:
    """Parts one after the other, text among them escaped."""
    return Html(separator.join(p if isinstance(p, Html) else escape(p) for p in parts))


def table(table: TextTable, *, caption: str = "") -> Html:
    """A table; nothing if it has no rows.

    Args:
        table: its header and cells; what is `Html` among the cells stays so.
        caption: what stands above it.
    """
    if not table.rows:
        return Html("")
    sides = ["n" if side == "r" else "" for side in table.sides]
    head = [
        tag("th", name, scope="col", class_=side)
        for name, side in zip(table.header, sides, strict=True)
    ]
    body = [
        tag("tr", *(tag("td", cell, class_=side) for cell, side in zip(row, sides, strict=True)))
        for row in table.rows
    ]
    title = [tag("caption", caption)] if caption else []
    parts = [*title, tag("thead", tag("tr", *head)), tag("tbody", joined(body, "\n"))]
    return tag("div", tag("table", *parts), class_="wide")


def page(title: str, *body: str) -> str:
    """A whole document that loads nothing, runs nothing and sends nothing."""
    digest = base64.b64encode(hashlib.sha256(STYLE.encode()).digest()).decode("ascii")
    policy = (
        f"default-src 'none'; img-src data:; style-src 'sha256-{digest}'; "
        "base-uri 'none'; form-action 'none'"
    )
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        Html(f'<meta http-equiv="Content-Security-Policy" content="{policy}">'),
        tag("meta", name_="viewport", content="width=device-width, initial-scale=1"),
        tag("title", title),
        tag("style", Html(STYLE)),
    )
    content = joined([part for part in body if part], "\n")
    html = tag("html", head, "\n", tag("body", tag("main", content)), lang="en")
    return f"<!DOCTYPE html>\n{html}\n"


STYLE = """
:root { color: #1a1a1a; background: #fff; font: 15px/1.5 system-ui, "Segoe UI", Roboto,
  "Helvetica Neue", Arial, sans-serif; }
body { margin: 0; }
main { max-width: 1040px; margin: 0 auto; padding: 24px 20px 60px; }
h1 { font-size: 1.7em; line-height: 1.25; margin: 0 0 .2em; overflow-wrap: anywhere; }
h2 { font-size: 1.25em; margin: 2em 0 .5em; border-bottom: 1px solid #bbb; padding-bottom: .15em; }
h3 { font-size: 1.05em; margin: 1.4em 0 .4em; }
p, li { max-width: 78ch; overflow-wrap: anywhere; }
.lead { font-size: 1.1em; }
.note { color: #555; }
.warn { border-left: 4px solid #d95f02; padding: .3em .8em; background: #fdf3ea; max-width: 76ch; }
.wide { overflow-x: auto; margin: .6em 0 1em; }
table { border-collapse: collapse; font-size: .92em; }
caption { text-align: left; font-weight: 600; padding: .3em 0; }
th, td { padding: .22em .8em .22em 0; text-align: left; vertical-align: top; }
th { border-bottom: 1.5px solid #444; font-weight: 600; white-space: nowrap; }
td { border-bottom: 1px solid #ddd; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
.hash { font-family: ui-monospace, Menlo, Consolas, monospace; font-size: .88em;
  overflow-wrap: anywhere; }
figure { margin: 1.2em 0 1.8em; }
figure svg { display: block; max-width: 100%; height: auto; }
figcaption { font-size: .92em; color: #333; max-width: 90ch; margin-top: .4em; }
pre { font-size: .8em; line-height: 1.35; white-space: pre-wrap; overflow-wrap: anywhere;
  background: #f6f6f6; padding: 1em; }
nav ul { list-style: none; padding: 0; margin: .8em 0; }
nav li { display: inline-block; margin-right: 1.2em; }
a { color: #1f4e79; }
@page { size: A4; margin: 15mm; }
@media print {
  :root { font-size: 10pt; }
  main { max-width: none; padding: 0; }
  nav { display: none; }
  figure, tr, .lead { break-inside: avoid; }
  h2, h3, caption { break-after: avoid; }
  figure svg { max-height: 235mm; }
  thead { display: table-header-group; }
  .wide { overflow: visible; }
  a { color: inherit; text-decoration: none; }
}
"""

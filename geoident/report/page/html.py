"""HTML from Python: text is escaped unless it is HTML already, so no user's text becomes markup."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

from geoident.report.text.layout import TextTable

_LINE = 100
"""Letters of a caption that find room on one line of a printed page."""
_VOID = ("meta", "br", "hr", "img")


class Html(str):
    """Text that is HTML already."""

    __slots__ = ()


def tag(name: str, /, *children: str, **attributes: str) -> Html:
    """An element; ``class_`` stands for ``class``.

    >>> tag("p", "1 < 2 ", tag("b", "yes"), class_="x")
    '<p class="x">1 &lt; 2 <b>yes</b></p>'
    """
    attribute_text = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(value)}"'
        for key, value in attributes.items()
        if value
    )
    if name in _VOID:
        return Html(f"<{name}{attribute_text}>")
    return Html(f"<{name}{attribute_text}>{joined(children)}</{name}>")


def joined(parts: Iterable[str], separator: str = "") -> Html:
    """Parts one after the other, text among them escaped."""
    return Html(separator.join(p if isinstance(p, Html) else escape(p) for p in parts))


def table(table: TextTable, *, caption: str = "") -> Html:
    """A table without empty columns; nothing if it has no rows.

    Args:
        table: its header and cells; what is `Html` among the cells stays so.
        caption: what stands above it.
    """
    table = table.filled
    if not table.header:
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
    line = "line" if len(caption) <= _LINE else ""
    title = [tag("caption", caption, class_=line)] if caption else []
    parts = [*title, tag("thead", tag("tr", *head)), tag("tbody", joined(body, "\n"))]
    return tag("div", tag("table", *parts), class_="wide")


def page(title: str, *body: str, margins: tuple[str, str, str] = ("", "", "")) -> str:
    """A whole document that loads nothing, runs nothing and sends nothing.

    Args:
        title: of the window.
        body: what stands in it.
        margins: what stands above the left and the right end of printed pages, and below the left.
    """
    style = STYLE + _margins(*margins)
    policy = (  # figures of matplotlib have their colours in style attributes
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
        "base-uri 'none'; form-action 'none'"
    )
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        Html(f'<meta http-equiv="Content-Security-Policy" content="{policy}">'),
        tag("meta", name_="viewport", content="width=device-width, initial-scale=1"),
        tag("title", title),
        tag("style", Html(style)),
    )
    content = joined([part for part in body if part], "\n")
    html = tag("html", head, "\n", tag("body", content), lang="en")
    return f"<!DOCTYPE html>\n{html}\n"


def _margins(left: str, right: str, below: str) -> str:
    """Texts in the margins of printed pages; what could end a string or the style is escaped."""
    first, second, third = (
        "".join(c if c.isalnum() or c == " " else f"\\{ord(c):x} " for c in text)
        for text in (left, right, below)
    )
    return (
        f'@page {{ @top-left {{ content: "{first}"; font: 8pt sans-serif; color: #444 }} '
        f'@top-right {{ content: "{second}"; font: 8pt sans-serif; color: #444 }} '
        f'@bottom-left {{ content: "{third}"; font: 8pt sans-serif; color: #444 }} }}\n'
    )


STYLE = """
:root { color: #1a1a1a; background: #fff; font: 15px/1.5 system-ui, "Segoe UI", Roboto,
  "Helvetica Neue", Arial, sans-serif; }
body { margin: 0; }
header { padding: 24px 20px 0; }
main { padding: 0 20px 60px; min-width: 0; }
h1, h2, h3, h4 { line-height: 1.25; overflow-wrap: anywhere; }
h1 { font-size: 1.7em; margin: 0 0 .3em; }
h2 { font-size: 1.25em; margin: 2em 0 .5em; border-bottom: 1px solid #bbb;
  padding-bottom: .15em; }
h3 { font-size: 1.05em; margin: 1.4em 0 .4em; }
h4 { font-size: 1em; margin: 1.2em 0 .3em; }
p, li { max-width: 78ch; overflow-wrap: anywhere; }
.head { display: flex; flex-wrap: wrap-reverse; justify-content: space-between;
  align-items: flex-end; gap: 1em 3em; border-bottom: 2px solid #1f4e79; padding-bottom: .8em; }
.head > div { min-width: 0; }
.head img { max-height: 90px; max-width: 260px; }
dl { display: grid; grid-template-columns: max-content minmax(0, 1fr); gap: .1em 1.2em;
  margin: .4em 0 0; }
dt { color: #555; }
dd { margin: 0; overflow-wrap: anywhere; }
.lead { font-size: 1.1em; }
.note { color: #555; }
.status { display: flex; gap: 1.2em; align-items: flex-start; margin: .8em 0; }
.status b { font-size: 1.5em; }
.status p { margin: .2em 0; }
.status span { display: flex; flex-direction: column; gap: .35em; padding: .45em;
  background: #333; border-radius: .6em; print-color-adjust: exact; }
.status i { width: 1.5em; height: 1.5em; border-radius: 50%; background: #6b6b6b; }
.status .red { background: #d7301f; }
.status .amber { background: #f5b400; }
.status .green { background: #2ca25f; }
.warn { border-left: 4px solid #d95f02; padding: .3em .8em; background: #fdf3ea;
  max-width: 76ch; }
.wide { overflow-x: auto; margin: .6em 0 1em; }
table { border-collapse: collapse; font-size: .92em; }
caption { text-align: left; font-weight: 600; padding: .3em 0; }
caption.line { white-space: nowrap; }
th, td { padding: .22em .8em .22em 0; text-align: left; vertical-align: top; }
th { border-bottom: 1.5px solid #444; font-weight: 600; white-space: nowrap; }
td { border-bottom: 1px solid #ddd; max-width: 60ch; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
.hash { font-family: ui-monospace, Menlo, Consolas, monospace; font-size: .88em;
  overflow-wrap: anywhere; }
.figures { display: flex; flex-wrap: wrap; gap: 1.6em 2em; margin: 1.2em 0 1.8em; }
figure { margin: 0; min-width: 0; flex: 1 1 calc(var(--width) - 40px);
  max-width: calc(1.3 * var(--width)); }
.drawing { overflow-x: auto; }
.drawing svg { display: block; width: 100%; height: auto; }
.drawing svg * { stroke-linejoin: round; stroke-linecap: butt; }
figcaption { font-size: .92em; color: #333; max-width: 90ch; margin-top: .4em; }
pre { font-size: .8em; line-height: 1.35; white-space: pre-wrap; overflow-wrap: anywhere;
  background: #f6f6f6; padding: 1em; }
nav { padding: 20px 20px 0; }
nav ol { list-style: none; padding: 0; margin: .5em 0; columns: 3 14em; }
nav .part { padding-left: 1.2em; }
nav li { padding: .12em 0; break-inside: avoid; }
a { color: #1f4e79; }
@media (min-width: 1240px) {
  body { display: grid; grid-template: "nav header" auto "nav main" 1fr / 230px minmax(0, 1fr); }
  header { grid-area: header; }
  nav { grid-area: nav; align-self: start; position: sticky; top: 0; max-height: 100vh;
    overflow-y: auto; box-sizing: border-box; font-size: .92em; }
  nav ol { columns: auto; }
  header, main { padding-left: 36px; padding-right: 36px; border-left: 1px solid #ddd;
    max-width: 1500px; }
  main { grid-area: main; }
}
@media screen and (max-width: 700px) {
  header, main, nav { padding-left: 14px; padding-right: 14px; }
  .drawing svg { min-width: calc(.78 * var(--width)); }
  td { max-width: 32ch; }
}
@page { size: A4; margin: 17mm 15mm 16mm;
  @bottom-right { content: counter(page) " / " counter(pages); font: 8pt sans-serif; } }
@media print {
  :root { font-size: 8.5pt; line-height: 1.4; }
  body { display: block; }
  header, main { max-width: none; padding: 0; }
  nav { display: none; }
  .head { flex-wrap: nowrap; }
  p, li, .warn { max-width: none; margin-top: .4em; margin-bottom: .4em; }
  .lead { font-size: 1em; }
  h2 { margin-top: 1em; }
  h3 { margin-top: .9em; }
  figure, tr, .lead, .warn, .wide:not(:has(tr:nth-child(15))) { break-inside: avoid; }
  h2, h3, h4, caption, p:not(.note):has(+ .figures) { break-after: avoid; }
  .wide + .note { break-before: avoid; }
  .figures { display: block; margin: .4em 0 .7em; }
  figure { max-width: none; display: flex; flex-wrap: wrap; align-content: flex-start;
    gap: .3em 2%; margin-bottom: 1em; }
  .drawing { flex: 0 1 var(--width); overflow: visible; }
  .drawing svg { max-height: 225mm; }
  figcaption { flex: 1 1 30mm; margin: 0; max-width: none; }
  thead { display: table-header-group; break-after: avoid; }
  .wide { overflow: visible; margin: .3em 0 .6em; }
  table { font-size: .88em; }
  th { white-space: normal; }
  th, td { padding-top: .1em; padding-bottom: .1em; }
  pre { columns: 2; padding: 0; background: none; }
  a { color: inherit; text-decoration: none; }
}
"""

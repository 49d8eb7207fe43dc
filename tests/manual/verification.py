"""Pages of the verification manual, made from the numbers that the tests keep."""

from __future__ import annotations

import hashlib
import io
import os
import re
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from geoident.io.docs.key_page import wrapped
from manual.drawings import STYLE
from manual.entries import CHAPTERS, ENTRIES, Entry
from manual.pages import DOCS
from manual.records import RENEW, Record, records

FOLDER = DOCS / "verification"
ROOT = DOCS.parents[1]
COLOURS = ("#1f4e79", "#b5651d", "#3a7d44", "#7b3f8c", "#8a9096", "#c0392b", "#00808a", "#5d4037")
MARKERS = "osD^vP*X"
NUMBERS = ("node", "number of the reading")  # of things without order: found over exact
TAKES = re.compile(r"^def (test_\w+)\(([^)]*)\)", re.MULTILINE)

HEAD = """\
# Verification

geoident is compared with closed forms, published benchmarks and other programs. The pages below
show every comparison: the problem, the exact solution and its source, a figure, a table, the
deviation, and the test. The numbers are those of the tests. Each run of a test compares its numbers
with these pages and fails if they differ. This command runs the tests, slow ones included, and
makes the pages again:

    sh tests/manual/renew verification

*Deviation* is the largest difference, relative to the largest exact value of the table.
"""


def main() -> None:
    """Run the tests that keep numbers, and make the pages."""
    environment = {**os.environ, RENEW: "1"}
    command = [sys.executable, "-m", "pytest", "-q", "-m", "slow or not slow", *recording_tests()]
    subprocess.run(command, cwd=ROOT, env=environment, check=True)
    write()


def recording_tests() -> list[str]:
    """Names of the tests that keep numbers."""
    return [
        f"{path.relative_to(ROOT).as_posix()}::{name}"
        for path in sorted((ROOT / "tests").rglob("test_*.py"))
        for name, arguments in TAKES.findall(path.read_text(encoding="utf-8"))
        if re.search(r"\bverification\b", arguments)
    ]


def write() -> None:
    """Make pages and figures of the numbers that are there."""
    FOLDER.mkdir(exist_ok=True)
    for name, text in pages().items():
        (FOLDER / name).write_text(text, encoding="utf-8")
    for entry, figure in figures().items():
        (FOLDER / f"{entry}.svg").write_bytes(figure)


def pages() -> dict[str, str]:
    """File name to text of every page."""
    made = {f"{name}.md": _chapter(name) for name in CHAPTERS}
    return {"index.md": _index(), **made}


def figures(names: Iterable[str] = ENTRIES) -> dict[str, bytes]:
    """Entry to its figure (SVG)."""
    return {name: _figure(ENTRIES[name], records(name)) for name in names}


def percent(part: float) -> str:
    """A deviation as people write it.

    >>> percent(0.00312), percent(3e-9), percent(2.5e-13)
    ('0.31 %', '3e-07 %', 'rounding')
    """
    if part < 1e-11:
        return "rounding"
    value = 100 * part
    return f"{value:.2g} %" if value >= 1e-3 else f"{value:.0e} %"


def _index() -> str:
    lines = [HEAD]
    for name, chapter in CHAPTERS.items():
        lines += [
            f"## {chapter.title}",
            "",
            wrapped(f"{chapter.about} [The numbers]({name}.md)"),
            "",
        ]
        lines += ["| compared | with | largest deviation | the test allows |", "|---|---|---|---|"]
        for key, entry in chapter.entries.items():
            worst = max(record.deviation for record in records(key).values())
            lines.append(
                f"| [{entry.title}]({name}.md#{_anchor(entry.title)}) | {_author(entry.source)} "
                f"| {percent(worst)} | {entry.allowed} |"
            )
        lines.append("")
    return "\n".join(lines) + (Path(__file__).parent / "checked.md").read_text(encoding="utf-8")


def _author(source: str) -> str:
    """Author and year of a source; its chapter gives all of it."""
    cited = re.match(r"[^()]*\(\d{4}\)", source)
    return cited[0] if cited else source


def _anchor(title: str) -> str:
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def _chapter(name: str) -> str:
    chapter = CHAPTERS[name]
    about = wrapped(f"{chapter.about} How to read this: [verification](index.md).")
    head = f"# {chapter.title}\n\n{about}\n"
    parts = [head, *(_part(key, entry, records(key)) for key, entry in chapter.entries.items())]
    return "\n".join(parts)


def _part(key: str, entry: Entry, found: dict[str, Record]) -> str:
    made_by = sorted({record.test for record in found.values()})
    lines = [
        f"## {entry.title}",
        "",
        wrapped(entry.about),
        "",
        wrapped(f"- Exact: {entry.source}.", "  "),
        wrapped(f"- Compared: {entry.quantity}. The test allows {entry.allowed}.", "  "),
        *(f"- Test: `{test}`" for test in made_by),
        "",
        f"![{entry.title}: {entry.quantity}]({key}.svg)",
        "",
        *_table(entry, found),
        "",
    ]
    return "\n".join(lines)


def _table(entry: Entry, found: dict[str, Record]) -> list[str]:
    """Variants with the same places side by side, others below each other."""
    shared = len({(r.x, r.exact) for r in found.values()}) == 1
    if shared and len(next(iter(found.values())).x) > 1:
        first = next(iter(found.values()))
        head = [entry.x, "exact", *(name or "geoident" for name in found)]
        rows = [
            [_text(x), _number(first.exact[k] * entry.scale)]
            + [_number(r.found[k] * entry.scale) for r in found.values()]
            for k, x in enumerate(first.x)
        ]
        rows.append(["deviation", "", *(percent(r.deviation) for r in found.values())])
    else:
        head = ["", entry.x, "exact", "geoident", "deviation"]
        rows = [
            [
                name if not k else "",
                _text(x),
                _number(r.exact[k] * entry.scale),
                _number(r.found[k] * entry.scale),
                percent(r.deviation) if not k else "",
            ]
            for name, r in found.items()
            for k, x in enumerate(r.x)
        ]
    return [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)]


def _text(x: float | str) -> str:
    return x if isinstance(x, str) else f"{x:.4g}"


def _number(value: float) -> str:
    return f"{value:.5g}"


def _figure(entry: Entry, found: dict[str, Record]) -> bytes:
    with rc_context(STYLE):
        figure = Figure(figsize=(6.2, 3.0), layout="constrained")
        if all(isinstance(x, float | int) for r in found.values() for x in r.x) and all(
            len(r.x) > 1 for r in found.values()
        ):
            (_one_to_one if entry.x in NUMBERS else _curves)(figure, entry, found)
        else:
            _deviations(figure, found)
        kept = io.BytesIO()
        metadata = {"Date": None, "Description": fingerprint(entry, found)}
        figure.savefig(kept, format="svg", metadata=metadata)
    return kept.getvalue()


def fingerprint(entry: Entry, found: dict[str, Record]) -> str:
    """What a figure was made from, as a hash that stands in it."""
    return hashlib.sha256(repr((entry, sorted(found.items()))).encode()).hexdigest()[:16]


def _curves(figure: Figure, entry: Entry, found: dict[str, Record]) -> None:
    axes = figure.subplots()
    drawn: set[tuple[float, ...]] = set()
    for k, (name, record) in enumerate(found.items()):
        colour = COLOURS[k % len(COLOURS)]
        line = tuple(entry.scale * e for e in record.exact)
        if line not in drawn:
            label = "exact" if not drawn else None
            axes.plot(record.x, line, color="#5b6670" if not drawn else colour, lw=1.2, label=label)
            drawn.add(line)
        dots = {"marker": MARKERS[k % len(MARKERS)], "ls": "none", "ms": 4.5, "mfc": "none"}
        answers = [entry.scale * f for f in record.found]
        axes.plot(record.x, answers, color=colour, label=name or "geoident", **dots)
    axes.set_xlabel(entry.x)
    axes.set_ylabel(entry.quantity)
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside right upper", frameon=False)


def _one_to_one(figure: Figure, entry: Entry, found: dict[str, Record]) -> None:
    axes = figure.subplots()
    every = [entry.scale * e for record in found.values() for e in record.exact]
    ends = [min(every), max(every)]
    axes.plot(ends, ends, color="#5b6670", lw=1.2, label="equal")
    for k, (name, record) in enumerate(found.items()):
        exact, answers = (entry.scale * np.array(v) for v in (record.exact, record.found))
        dots = {"marker": MARKERS[k % len(MARKERS)], "ls": "none", "ms": 4.5, "mfc": "none"}
        axes.plot(exact, answers, color=COLOURS[k % len(COLOURS)], label=name or "geoident", **dots)
    axes.set_xlabel(f"exact: {entry.quantity}")
    axes.set_ylabel("geoident")
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside right upper", frameon=False)


def _deviations(figure: Figure, found: dict[str, Record]) -> None:
    axes = figure.subplots()
    rows = [
        (", ".join(filter(None, (name, str(x)))), 100 * (f - e) / np.abs(record.exact).max())
        for name, record in found.items()
        for x, e, f in zip(record.x, record.exact, record.found, strict=True)
    ]
    place = np.arange(len(rows))[::-1]
    axes.axvline(0, color="#5b6670", lw=1.0)
    axes.hlines(place, 0, [value for _, value in rows], color=COLOURS[0], lw=1.2)
    axes.plot([value for _, value in rows], place, "o", color=COLOURS[0], ms=4.5)
    axes.set_yticks(place, [label for label, _ in rows])
    axes.set_ylim(-0.7, len(rows) - 0.3)
    axes.set_xlabel("deviation of geoident (%)")
    axes.spines[["top", "right"]].set_visible(False)


__all__ = ["figures", "fingerprint", "main", "pages", "percent", "recording_tests", "write"]

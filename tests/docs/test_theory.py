"""The theory stands with the code: what docstrings cite is there, and what it names exists."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from functools import cache
from pathlib import Path

import pytest

import geoident

PACKAGE = Path(geoident.__file__).parent
TEXT = (PACKAGE / "docs" / "theory.md").read_text(encoding="utf-8")
SOURCES = sorted(PACKAGE.rglob("*.py"))

HEADING = re.compile(r"^#{2,3} (\d+(?:\.\d+)?) ", re.MULTILINE)
SECTION = r"\d+(?:\.\d+)?"
EQUATIONS = r"\[\d{1,2}(?:(?:-|, ?)\d{1,2})*\]"
CITED = re.compile(
    rf"\btheory((?:,? *(?:\band\b|\bto\b)?\s*(?:{SECTION}(?![\w.]*\w)|{EQUATIONS}))+)",
    re.IGNORECASE,
)


def sections_cited(text):
    """Numbers of sections behind the word theory."""
    return [
        number
        for found in CITED.findall(text)
        for number in re.findall(SECTION, re.sub(EQUATIONS, " ", found))
    ]


def equations_cited(text):
    """Equations of the founding paper: numbers from 1 to 31 alone in brackets, in prose."""
    found = set()
    for brackets in re.findall(rf"(?:(?<=\s)|(?<=^)){EQUATIONS}", text, re.MULTILINE):
        found |= _expanded(brackets)
    return {number for number in found if 1 <= number <= 31}


def _expanded(brackets):
    numbers = set()
    for part in brackets[1:-1].split(","):
        first, _, last = part.partition("-")
        numbers |= set(range(int(first), int(last or first) + 1))
    return numbers


@cache
def prose(path):
    """Docstrings and comments of a module without what examples print.

    Of one that cites; of others there is nothing to be told.
    """
    source = path.read_text(encoding="utf-8")
    if not re.search(rf"theory|(?<!\w){EQUATIONS}", source, re.IGNORECASE):
        return ""
    parts = [
        node.value.value
        for node in _statements(ast.parse(source))
        if isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    ]
    citing = re.search(rf"#.*(?:theory|{EQUATIONS})", source, re.IGNORECASE)
    lines = source if citing else ""  # to tell comments from texts takes long
    tokens = tokenize.generate_tokens(io.StringIO(lines).readline)
    parts += [token.string for token in tokens if token.type == tokenize.COMMENT]
    return "\n".join(re.sub(r"^ *>>>.*(?:\n(?! *$).*)*", "", part, flags=re.M) for part in parts)


def _statements(node):
    """All below a node, without looking into expressions, which are nearly all that there is."""
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, ast.expr):
            yield child
            yield from _statements(child)


@cache
def words_of_the_code():
    """Every name that the package defines or uses."""
    return set(re.findall(r"[A-Za-z_]\w*", "\n".join(p.read_text("utf-8") for p in SOURCES)))


@cache
def constants_of_the_code():
    """Name and value of every number that a module gives a name."""
    number = re.compile(r"^(\w+)(?:: \w+)? = (-?[\d][\w.+-]*)(?: *#.*)?$", re.MULTILINE)
    given = "\n".join(path.read_text(encoding="utf-8") for path in SOURCES)
    return {(name, float(ast.literal_eval(value))) for name, value in number.findall(given)}


def table(title):
    """Rows of the first table after a heading, as lists of cells."""
    rows = TEXT.split(f"## {title}\n", 1)[1].split("\n\n|", 1)[1].split("\n\n", 1)[0].splitlines()
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows[2:]]


def test_every_section_that_is_cited_exists():
    there = set(HEADING.findall(TEXT))
    lost = {
        f"{path.relative_to(PACKAGE)}: theory {number}"
        for path in (*SOURCES, PACKAGE / "ARCHITECTURE.md")
        for number in sections_cited(prose(path) if path.suffix == ".py" else path.read_text())
        if number not in there
    }
    assert not lost


def test_the_package_cites_its_theory():
    cited = {number for path in SOURCES for number in sections_cited(prose(path))}
    assert {"1", "2", "4.1", "4.2", "4.3", "4.5", "4.6", "5", "6"} <= cited


def test_every_equation_of_the_paper_that_is_cited_appears():
    there = set().union(*map(_expanded, re.findall(EQUATIONS, TEXT)))
    lost = {
        f"{path.relative_to(PACKAGE)}: [{number}]"
        for path in SOURCES
        for number in equations_cited(prose(path)) - there
    }
    assert not lost
    cited = set().union(*(equations_cited(prose(path)) for path in SOURCES))
    assert {11, 14, 16, 18, 20} <= cited


def test_references_within_the_theory_lead_somewhere():
    there = set(HEADING.findall(TEXT))
    named = re.findall(r"\bsections? (\d+(?:\.\d+)?)(?! of| \()", TEXT.split("## References")[0])
    behind = re.findall(
        r"\((\d\.\d+)(?:, (\d\.\d+))*[^)]*\)$", TEXT.split("## References")[1], re.M
    )
    numbers = set(named) | {number for pair in behind for number in pair if number}
    assert numbers
    assert numbers <= there


def test_sections_are_numbered_without_gaps():
    numbers = [tuple(map(int, number.split("."))) for number in HEADING.findall(TEXT)]
    chapters = [n for n in numbers if len(n) == 1]
    assert chapters == [(k,) for k in range(1, len(chapters) + 1)]
    assert len(chapters) >= 7
    for (chapter,) in chapters:
        inside = [n[1] for n in numbers if len(n) == 2 and n[0] == chapter]
        assert inside == list(range(1, len(inside) + 1))


@pytest.mark.parametrize("row", table("Symbols"), ids=lambda row: row[0])
def test_symbols_have_their_name_in_the_code(row):
    symbol, code, _, meaning, _ = row
    assert symbol
    assert meaning
    for name in re.findall(r"`([^`]*)`", code):
        assert name in words_of_the_code()


def test_constants_have_the_value_of_the_code():
    named = re.findall(r"`(\w+)` = (\d[\d.e+-]*\d|\d)", TEXT)
    assert len(named) >= 5
    wrong = {(n, v) for n, v in named if (n, float(v)) not in constants_of_the_code()}
    assert not wrong


@pytest.mark.parametrize(
    ("text", "sections", "equations"),
    [
        ("see theory 4.2, where 3 others", ["4.2"], set()),
        ("of a case (theory 1 and 2).", ["1", "2"], set()),
        ("(theory 4.1, [11-13], after Kavanagh)", ["4.1"], {11, 12, 13}),
        ("its discrepancy, theory [20] and 4.3, without", ["4.3"], {20}),
        ("loads (theory 1, F)", ["1"], set()),
        ("K_VW K_WW^-1 [14] at p, array([0]) and x[3]", [], {14}),
        ("Theory of Elasticity, section 5", [], set()),
    ],
)
def test_what_counts_as_cited(text, sections, equations):
    assert sections_cited(text) == sections
    assert equations_cited(text) == equations

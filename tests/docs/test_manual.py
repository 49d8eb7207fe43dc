"""The manual hangs together: links, spelling, words, commands, generated pages, the site."""

from __future__ import annotations

import re
import shlex
from functools import cache

import click
import pytest
from codespell_lib import main as codespell
from manual.commands import EXIT_CODES, command_page
from manual.conf import contents
from manual.drawings import DRAWINGS, svg
from manual.gallery import file_name, shown
from manual.pages import DOCS

from geoident.cli.app import COMMANDS, geoident

ROOT = DOCS.parents[1]
PAGES = [*sorted(DOCS.rglob("*.md")), DOCS.parent / "ARCHITECTURE.md", ROOT / "README.md"]
TARGET = re.compile(r"(?<!`)!?\[[^\]]*\]\(([^)\s]+)\)")
# what the house calls otherwise (see "Words" in ARCHITECTURE)
AVOIDED = (
    "discrepancy of the readings",
    "bears most on",
    "simply",
    "obviously",
    "powerful",
    "seamless",
)
# names, abbreviations and words of titles in other languages
NOT_WRONG = "wroth,ags,ges,methode,numer,ponts,trough,troughs"


def names(path):
    return path.relative_to(ROOT).as_posix()


@cache
def anchors(path):
    """Names of the headings of a page, as GitHub and MyST make them."""
    text = re.sub(r"^```.*?^```$", "", path.read_text(encoding="utf-8"), flags=re.M | re.S)
    headings = re.findall(r"^#+ (.+)$", text, re.M)
    plain = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading) for heading in headings]
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in plain}


@pytest.mark.parametrize("path", PAGES, ids=names)
def test_links_lead_somewhere(path):
    prose = re.sub(r"^```.*?^```$", "", path.read_text(encoding="utf-8"), flags=re.M | re.S)
    lost = []
    for link in TARGET.findall(re.sub(r"`[^`\n]*`", "", prose)):
        if re.match(r"https?:", link):
            continue
        file, _, anchor = link.partition("#")
        target = (path.parent / file).resolve() if file else path
        if not target.exists() or (anchor and anchor not in anchors(target)):
            lost.append(link)
    assert lost == []


def test_every_page_is_in_the_contents():
    text = (DOCS / "index.md").read_text(encoding="utf-8")
    listed = {DOCS / "index.md"}
    listed |= {
        (DOCS / f"{name}.md").resolve()
        for name in re.findall(r"^([\w./-]+)$", contents(text), re.M)
    }
    verified = {path for path in PAGES if path.parent == DOCS / "verification"}
    assert {path for path in PAGES if path.is_relative_to(DOCS)} - verified <= listed


def test_words_are_spelled(capsys):
    wrong = codespell(f"--ignore-words-list={NOT_WRONG}", *map(str, PAGES))
    assert wrong == 0, capsys.readouterr().out


@pytest.mark.parametrize("path", PAGES, ids=names)
def test_words_are_those_of_the_house(path):
    text = path.read_text(encoding="utf-8").lower()
    assert [word for word in AVOIDED if re.search(rf"\b{word}\b", text)] == []


@pytest.mark.parametrize("path", PAGES, ids=names)
def test_commands_and_their_flags_exist(path):
    if path.name in ("ARCHITECTURE.md", "commands.md"):
        return
    text = path.read_text(encoding="utf-8").replace("\\|", "|")
    blocks = re.findall(r"^```(?:sh|console)\n(.*?)^```$|^    (geoident .*)$", text, re.M | re.S)
    lines = re.findall(r"^(?:\$ )?(geoident [a-z].*)$", "\n".join(map("".join, blocks)), re.M)
    lines += re.findall(r"`(geoident [a-z][^`]*)`", text)
    for line in lines:
        words = shlex.split(line, comments=True)
        words = words[: words.index("|")] if "|" in words else words
        assert words[1] in COMMANDS, line
        command = geoident.get_command(click.Context(geoident), words[1])
        known = {flag for p in command.params for flag in p.opts} | {"-h", "--help"}
        flags = {word.partition("=")[0] for word in words[2:] if re.match(r"--?[a-z]", word)}
        assert flags <= known, line


def test_the_page_of_commands_is_up_to_date():
    remedy = "run: sh tests/manual/renew commands"
    assert (DOCS / "commands.md").read_text(encoding="utf-8") == command_page(), remedy
    assert set(EXIT_CODES) == set(type(next(iter(EXIT_CODES))))


@pytest.mark.parametrize("name", DRAWINGS)
def test_drawings_are_up_to_date(name):
    """As many strokes and the same words; bytes differ between versions of matplotlib."""
    kept = (DOCS / f"{name}.svg").read_bytes()
    drawn = svg(DRAWINGS[name])
    assert kept.count(b"<path") == drawn.count(b"<path")
    assert re.findall(rb">([^<>\n]+)</text>", kept) == re.findall(rb">([^<>\n]+)</text>", drawn)


@pytest.mark.slow  # links, anchors and contents are looked at above
@pytest.mark.filterwarnings("ignore:.*Check CHANGES for Sphinx API")
def test_the_site_is_made_without_a_warning_and_needs_no_network(tmp_path):
    from sphinx.application import Sphinx  # noqa: PLC0415 - takes longer than all other tests here

    app = Sphinx(
        ROOT / "geoident", ROOT / "tests" / "manual", tmp_path / "site", tmp_path / "trees", "html",
        status=None, warningiserror=True, exception_on_warning=True,
    )  # fmt: skip
    app.builder.search = False  # its index has neither links nor warnings
    app.build()
    assert app.statuscode == 0
    pages = sorted((tmp_path / "site").rglob("*.html"))
    assert len(pages) > 20
    for page in pages:
        loaded = re.findall(
            r'<(?:script|link|img)[^>]*(?:src|href)="(https?://[^"]*)"', page.read_text("utf-8")
        )
        assert loaded == [], page
    assert "docs/index.html" in (tmp_path / "site" / "index.html").read_text("utf-8")


def test_the_gallery_shows_every_case():
    text = (DOCS / "gallery.md").read_text(encoding="utf-8")
    for one in shown():
        assert f"\n## {one.title}\n" in text, "run: sh tests/manual/renew gallery"
        for command in one.commands:
            assert command in text
        picture = "overview" if "\nmesh:" in one.text else ""
        assert f"](gallery/{file_name(one, picture).removesuffix('.png')}" in text
    linked = set(re.findall(r"\]\(gallery/([\w.-]+)\)", text))
    assert linked == {path.name for path in (DOCS / "gallery").iterdir()}


def test_the_pages_are_small():
    """Pictures of a manual are for the eye; whoever wants them sharp makes them again."""
    assert sum(path.stat().st_size for path in DOCS.rglob("*") if path.is_file()) < 5_400_000

"""The verification manual has what the tests keep; the tests themselves compare the numbers."""

from __future__ import annotations

import re

import numpy as np
import pytest
from manual import records as kept
from manual.entries import ENTRIES
from manual.records import Recorder, records
from manual.verification import FOLDER, figures, fingerprint, pages, percent, recording_tests

REMEDY = "run: sh tests/manual/renew verification/pages"


def test_every_entry_has_numbers_and_every_number_an_entry():
    assert {path.stem for path in kept.FOLDER.glob("*.json")} == set(ENTRIES)
    assert all(records(name) for name in ENTRIES)


def test_numbers_are_those_of_tests_that_exist():
    made_by = {record.test for name in ENTRIES for record in records(name).values()}
    assert made_by == set(recording_tests())


BY_EXPERIENCE = {"face-yielding": 0.06}
"""Comparisons with formulas that were fitted to other calculations: the part they may be off."""


def test_no_deviation_is_large():
    worst = {name: max(r.deviation for r in records(name).values()) for name in ENTRIES}
    large = {name: part for name, part in worst.items() if part > BY_EXPERIENCE.get(name, 0.05)}
    assert {name: percent(part) for name, part in large.items()} == {}


def test_the_pages_have_these_numbers():
    made = pages()
    assert {path.name for path in FOLDER.glob("*.md")} == set(made)
    for name, text in made.items():
        assert (FOLDER / name).read_text(encoding="utf-8") == text, REMEDY


def test_the_figures_were_made_from_them():
    assert {path.stem for path in FOLDER.glob("*.svg")} == set(ENTRIES)
    for name, entry in ENTRIES.items():
        drawn = (FOLDER / f"{name}.svg").read_text(encoding="utf-8")
        assert fingerprint(entry, records(name)) in drawn, (name, REMEDY)


@pytest.mark.parametrize("name", ["kirsch", "footing", "mpeclib"])
def test_a_figure_shows_them(name):
    """The same words and as many strokes; bytes differ between versions of matplotlib."""
    there, drawn = (FOLDER / f"{name}.svg").read_bytes(), figures([name])[name]
    for what in (rb">([^<>\n]+)</text>", rb"<path", rb"<use"):
        assert re.findall(what, there) == re.findall(what, drawn), REMEDY


class TestRecorder:
    X, EXACT = (0.0, 1.0, 2.0), (1.0, 2.0, 4.0)

    @pytest.fixture(autouse=True)
    def folder(self, tmp_path, monkeypatch):
        monkeypatch.setattr(kept, "FOLDER", tmp_path)
        monkeypatch.setenv(kept.RENEW, "1")
        Recorder("test.py::test_it[a]")("entry", "a", self.X, exact=self.EXACT, found=(1, 2, 4.1))
        monkeypatch.delenv(kept.RENEW)

    def check(self, *, test="test.py::test_it[b]", variant="a", found=(1.0, 2.0, 4.1)):
        Recorder(test)("entry", variant, self.X, exact=self.EXACT, found=found)

    def test_the_same_numbers_pass(self):
        self.check(found=(1.0, 2.0, 4.1001))
        assert records("entry")["a"].deviation == pytest.approx(0.1 / 4)

    @pytest.mark.parametrize(
        "other", [{"found": (1.0, 2.0, 4.11)}, {"variant": "b"}, {"test": "test.py::test_other"}]
    )
    def test_others_are_refused(self, other):
        with pytest.raises(AssertionError, match="sh tests/manual/renew verification"):
            self.check(**other)

    def test_places_are_sorted_and_thinned(self, monkeypatch):
        monkeypatch.setenv(kept.RENEW, "1")
        x = np.linspace(9, 0, 100)
        Recorder("test.py::test_it")("many", "", x, exact=x, found=x)
        assert records("many")[""].x == tuple(sorted(records("many")[""].x))
        assert len(records("many")[""].x) == kept.MOST
        assert records("many")[""].x[0] == 0

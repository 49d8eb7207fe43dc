"""Marks of files that geoident made: found again, and seen through when a file was edited."""

import io
from pathlib import Path

import matplotlib as mpl
import pytest
from defusedxml import ElementTree
from matplotlib.figure import Figure
from matplotlib.image import imread

from geoident.io.text.mark import FORMATS, marked, origin_of, read_mark


def picture(form):
    buffer = io.BytesIO()
    figure = Figure(figsize=(1, 1))
    figure.subplots().plot([0, 1])
    with mpl.rc_context({"svg.hashsalt": "x"}):
        figure.savefig(buffer, format=form)
    return buffer.getvalue()


CONTENTS = {
    "html": b"<!DOCTYPE html>\n<p>Trial pit\n",
    "csv": b"gauge,stage,value,unit\nCV,first,1.5,mm\n",
    **{form: picture(form) for form in ("svg", "pdf", "png")},
}


@pytest.mark.parametrize("form", FORMATS)
def test_a_mark_is_read_again_and_every_change_is_seen(form, tmp_path):
    content = CONTENTS[form]
    origin = origin_of([str(tmp_path / "two -- dashes; and #.yaml")], tmp_path / "page")
    assert read_mark(content, form) is None
    whole = marked(content, form, origin)
    mark = read_mark(whole, form)
    assert mark is not None
    assert mark.intact
    assert mark.origin == origin
    middle = len(content) // 2
    changed = [
        whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :],
        whole + b"x",
        whole.replace(b"sha256 ", b"sha256 0", 1),
    ]
    for other in changed:
        found = read_mark(other, form)
        assert found is None or not found.intact
    # a copy that was marked a second time is not taken for the first
    assert read_mark(marked(whole, form, origin), form).intact


def test_readers_of_pictures_do_not_mind(tmp_path):
    origin = origin_of(["case.yaml"], tmp_path / "a.png")
    for form in ("svg", "png", "pdf"):
        (tmp_path / f"a.{form}").write_bytes(marked(CONTENTS[form], form, origin))
    assert (imread(tmp_path / "a.png") == imread(io.BytesIO(CONTENTS["png"]))).all()
    assert ElementTree.parse(tmp_path / "a.svg").getroot().tag.endswith("svg")
    assert (tmp_path / "a.pdf").read_bytes().rstrip().count(b"%%EOF") == 1


def test_the_key_is_that_of_the_way_from_file_to_case(tmp_path, monkeypatch):
    here, there = tmp_path / "here", tmp_path / "there"
    for folder in (here, there):
        folder.mkdir()
    one = origin_of([str(here / "case.yaml")], here / "page.html")
    assert origin_of([str(there / "case.yaml")], there / "page.html") == one
    assert not origin_of([str(there / "case.yaml")], here / "page.html").shares(one)
    both = origin_of([str(here / "case.yaml"), str(here / "other.yaml")], here / "page.html")
    assert both.names == ("case.yaml", "other.yaml")
    assert both.shares(one)
    monkeypatch.chdir(here)
    assert origin_of(["case.yaml"], "page.html") == one
    assert origin_of(["-"], Path("page.html")).names == ("stdin",)

"""The head of a report: from the case or from flags, with a logo that brings nothing along."""

import base64
import io
import re
from dataclasses import replace
from xml.etree import ElementTree

import pytest

pytest.importorskip("matplotlib", reason='reports need matplotlib: pip install "geoident[report]"')

from click.testing import CliRunner
from PIL import Image

from geoident.cli.app import geoident
from geoident.errors import InputError
from geoident.io.case.file import parse_case
from geoident.io.case.report import read_report_head
from geoident.io.result.file import write_result
from geoident.model.results.head import ReportHead
from geoident.report.page.html import page
from geoident.report.page.logo import logo_element
from geoident.report.page.page import report_page
from tests.support.results import small_result

SVG = """<?xml version="1.0"?>
<svg xmlns="http://www.w3.org/2000/svg" xmlns:x="http://other.example/ns" viewBox="0 0 20 8"
  onload="alert(1)"><script>alert(2)</script><style>.a{fill:#123456}</style>
<style>@import url(http://evil.example/a.css);</style><rect class="a" width="9" height="8"/>
<image href="http://evil.example/x.png"/><a href="http://evil.example"><text>gone</text></a>
<foreignObject><p xmlns="http://www.w3.org/1999/xhtml">gone</p></foreignObject><x:y/>
<circle r="3" style="fill:url(http://evil.example/f)" fill="url(#g)"/><use href="#g"/></svg>"""
CASE = """title: Trial pit
report: {project: Upper Valley, client: "Power & Co", revision: B, date: 3 May 2026}
"""


def drawn_logo(text):
    address = re.search(r'src="data:image/svg\+xml;base64,([^"]+)"', text)[1]
    return base64.b64decode(address).decode()


def test_a_drawing_keeps_its_shapes_and_nothing_that_runs_or_asks():
    cleaned = drawn_logo(logo_element(SVG.encode(), "logo.svg"))
    root = ElementTree.fromstring(cleaned)
    names = [element.tag.rpartition("}")[2] for element in root.iter()]
    assert names == ["svg", "style", "rect", "circle", "use"]
    assert "evil" not in cleaned
    assert "alert" not in cleaned
    assert 'fill="url(#g)"' in cleaned
    assert "#123456" in cleaned


def test_a_photograph_is_stored_alone_and_small():
    buffer = io.BytesIO()
    Image.new("RGB", (3000, 1000), "red").save(buffer, format="png", pnginfo=None)
    text = logo_element(buffer.getvalue() + b"trailing secret", "logo.png")
    data = base64.b64decode(re.search(r"base64,([^\"]+)", text)[1])
    assert b"secret" not in data
    with Image.open(io.BytesIO(data)) as picture:
        assert picture.size == (780, 260)


@pytest.mark.parametrize(
    "content",
    [b"GIF89a", b"\x89PNG broken", b"<html></html>", b"<svg", b"",
     b'<!DOCTYPE svg [<!ENTITY a "b">]><svg xmlns="http://www.w3.org/2000/svg">&a;</svg>'],
)  # fmt: skip
def test_what_is_no_logo_is_refused_with_a_remedy(content):
    with pytest.raises(InputError) as refused:
        logo_element(content, "logo.xyz")
    (fault,) = refused.value.faults
    assert fault.code == "bad-logo"
    assert fault.hint
    assert fault.location.file == "logo.xyz"


@pytest.mark.usefixtures("plain_pictures")
def test_the_head_says_what_is_given_and_nothing_else():
    head = ReportHead(project="<b>Dam</b>", author="J. Doe", revision="B")
    text = report_page([("pit", small_result())], head)
    entries = re.findall(r"<dt>([^<]*)</dt><dd>([^<]*)</dd>", text)
    assert entries[:3] == [("Project", "&lt;b&gt;Dam&lt;/b&gt;"), ("Author", "J. Doe"),
                           ("Revision", "B")]  # fmt: skip
    assert [name for name, _ in entries] == ["Project", "Author", "Revision", "Computed"]


def test_texts_in_the_margins_of_paper_cannot_leave_the_style():
    text = page("x", margins=('a"} body{} </style><script>alert(1)</script>', "b\\", ""))
    assert "<script>" not in text
    assert text.count("</style>") == 1
    (content,) = re.findall(r'@top-left \{ content: "([^"]*)"', text)
    assert re.fullmatch(r"(?:\w| |\\[0-9a-f]+ )*", content)


def test_contents_and_numbers_agree(plane_page):
    linked = re.findall(r'<li><a href="#([^"]+)">(\S+?)\u2002', plane_page)
    headings = re.findall(
        r'<section id="([^"]+)"[^>]*>(?:<details><summary>)?<h2><span class="number">(\S+) ',
        plane_page,
    )
    assert linked == headings
    assert len(linked) > 6
    assert {"1", "A"} <= {number for _, number in linked}
    for kind, pattern in (("Figure", r"<figcaption><b>Figure (\d+): "),
                          ("Table", r"<caption[^>]*>Table (\d+): ")):  # fmt: skip
        numbers = [int(number) for number in re.findall(pattern, plane_page)]
        assert numbers == list(range(1, len(numbers) + 1)), kind
        assert len(numbers) > 2


def test_appendices_have_letters_and_stand_open_so_that_they_print(plane_page):
    lettered = re.findall(r'<h2><span class="number">[A-Z] </span>([^<]+)</h2>', plane_page)
    assert {"All readings", "Provenance", "Case file"} <= set(lettered)
    assert "<details" not in plane_page


def test_the_case_says_its_head_and_its_faults_are_placed():
    head = read_report_head(CASE + "mesh: {broken: true}\n", "site/case.yaml")
    assert head == ReportHead(project="Upper Valley", client="Power & Co", revision="B",
                              date="3 May 2026")  # fmt: skip
    assert read_report_head("title: x\n", "case.yaml") == ReportHead()
    logo = read_report_head("report: {logo: a.svg}\n", "site/case.yaml").logo
    assert logo.replace("\\", "/") == "site/a.svg"
    with pytest.raises(InputError) as refused:
        read_report_head("title: x\nreport:\n  cleint: A\n", "case.yaml")
    (fault,) = refused.value.faults
    assert (fault.location.line, fault.path) == (3, "report.cleint")
    assert "client" in fault.hint


def test_the_head_is_no_part_of_what_is_computed(opening_text):
    plain = parse_case(opening_text, "case.yaml", overrides=["readings=[]"])
    headed = parse_case(
        opening_text + "\nreport: {client: A}\n", "case.yaml", overrides=["readings=[]"]
    )
    assert headed.computed == plain.computed
    assert "client: A" in headed.resolved


@pytest.fixture
def opening_text():
    from importlib.resources import files  # noqa: PLC0415

    return files("geoident").joinpath("templates/opening/case.yaml").read_text(encoding="utf-8")


@pytest.mark.usefixtures("plain_pictures")
def test_flags_override_the_case_as_it_stands_today(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = replace(small_result(), case_text=CASE)
    write_result(result, tmp_path / "pit.fit.h5", overwrite=False)
    run = CliRunner().invoke(geoident, ["report", "pit.fit.h5", "--revision", "C"])
    assert run.exit_code == 0, run.stderr
    text = (tmp_path / "pit.fit.html").read_text(encoding="utf-8")
    assert dict(re.findall(r"<dt>([^<]*)</dt><dd>([^<]*)</dd>", text))["Revision"] == "C"
    (tmp_path / "case.yaml").write_text(CASE.replace("Upper", "Lower"))
    again = CliRunner().invoke(geoident, ["report", "pit.fit.h5", "--force"])
    assert again.exit_code == 0, again.stderr
    assert "<dd>Lower Valley</dd>" in (tmp_path / "pit.fit.html").read_text(encoding="utf-8")

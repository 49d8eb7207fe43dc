"""The page as a document: whole, closed in itself, the same each time, and true."""

import re
from dataclasses import replace
from html.parser import HTMLParser
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.axis import Tick
from matplotlib.text import Text

from geoident.model.results.findings import Finding
from geoident.report.drawing.album import album
from geoident.report.page.html import Html, page, tag
from geoident.report.page.page import report_page
from geoident.report.text.case import case_title
from geoident.report.text.gauges import reading_table
from geoident.report.text.residuals import outliers, rms, scored
from tests.report.conftest import AS_IN_A_PLANE
from tests.support.results import (
    STAGES,
    changed_gauges,
    example_result,
    fields_of,
    grid_mesh,
    small_result,
)

VOID = {"meta", "br", "hr", "img", "link", "input"}
EVIL = "<script>alert(1)</script> & \"quoted\" 'too' $x_1$ <img src=http://evil.example/x>"


class Reader(HTMLParser):
    """Elements, attributes and text of a document, with a check that tags match."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.open, self.tags, self.attributes, self.words, self.inside = [], [], [], [], {}
        self.feed(text)
        self.close()
        assert not self.open, f"not closed: {self.open}"

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, key, value) for key, value in attrs]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, key, value) for key, value in attrs]

    def handle_endtag(self, tag):
        assert self.open, f"</{tag}> without a start"
        assert self.open.pop() == tag

    def handle_data(self, data):
        if not {"style", "svg"} & set(self.open):
            self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())


@pytest.fixture(scope="module", params=["plane", "solid"])
def text(request):
    return request.getfixturevalue(f"{request.param}_page")


def test_the_page_is_well_formed_and_has_unique_names(text):
    reader = Reader(text)
    assert text.startswith("<!DOCTYPE html>\n<html lang=")
    names = [value for _, key, value in reader.attributes if key == "id"]
    assert len(names) == len(set(names))
    referred = {v[1:] for _, k, v in reader.attributes if k == "href" and v.startswith("#")}
    referred |= set(re.findall(r"url\(#([^)]+)\)", text))
    assert referred <= set(names)


def test_the_page_asks_for_nothing_from_outside(text):
    reader = Reader(text)
    assert not {"script", "link", "iframe", "object", "embed", "img"} & set(reader.tags)
    assert "http" not in re.sub(r'http-equiv="', "", text)
    for _, key, value in reader.attributes:
        assert not key.startswith("on")
        if key in ("href", "src"):
            assert value.startswith(("#", "data:image/png;base64,"))


def test_the_policy_forbids_all_but_styles_and_images_in_the_page(text):
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]+)"', text)[1]
    assert set(policy.split("; ")) == {
        "default-src 'none'", "img-src data:", "style-src 'unsafe-inline'", "base-uri 'none'",
        "form-action 'none'",
    }  # fmt: skip
    assert text.index("Content-Security-Policy") < text.index("<style>")


@pytest.mark.parametrize("kind", ["plane", "solid"])
def test_every_figure_is_there_with_its_caption_and_not_empty(kind, request):
    result, text = request.getfixturevalue(kind), request.getfixturevalue(f"{kind}_page")
    names = [picture.name for picture in album(result).all]
    expected = {"overview", "parameters", "pairs", "readings-1", "extensometers-1", "one-to-one",
                "residuals", "history", "correlation"}  # fmt: skip
    fields = ["displacement", "displacement-parts", "stress-minimum", "stress-maximum",
              "stress-crosses", "deformed", "vectors"]  # fmt: skip
    sections = [""] if kind == "plane" else ["section-1-", "section-2-"]
    expected |= {section + field for section in sections for field in fields}
    expected |= (
        {"yielded"}
        if kind == "plane"
        else {"surface", "cut-away", "cut-away-deformed", "largest-displacement"}
    )
    assert set(names) == expected
    for name in names:
        figure = re.search(f'<figure id="figure-{name}"[^>]*>(.*?)</figure>', text, re.DOTALL)[1]
        assert "<figcaption><b>Figure " in figure
        if kind == "plane" or name not in AS_IN_A_PLANE:
            assert figure.count("<path") + figure.count("<image") > 5
        assert 'role="graphics-document document"' in figure  # its words are read aloud


@pytest.mark.parametrize("kind", ["plane", "solid"])
def test_every_figure_is_well_formed_and_its_words_are_text(kind, reports):
    text, drawn = reports[kind]
    assert drawn
    for name, figure in drawn.items():
        svg = re.search(rf'<figure id="figure-{name}".*?(<svg .*?</svg>)', text, re.DOTALL)[1]
        words = {" ".join(e.text.split()) for e in ElementTree.fromstring(svg).iter("text")}
        numbers = {label for tick in figure.findobj(Tick) for label in (tick.label1, tick.label2)}
        said = {
            " ".join(line.split())
            for each in set(figure.findobj(Text)) - numbers
            if each.get_visible()
            for line in each.get_text().splitlines()
        }
        assert said - {""} <= words, name


@pytest.mark.usefixtures("plain_pictures")
def test_the_same_result_gives_the_same_page():
    results = [("pit", small_result(fields=fields_of(grid_mesh(2, 5))))]
    assert report_page(results) == report_page(results)


def test_the_page_has_no_time_but_that_of_the_result(plane_page):
    found = set(re.findall(r"\b20[0-9]{2}-[0-9]{2}-[0-9]{2}", Reader(plane_page).text))
    assert found == {"2026-01-02"}


def test_what_is_not_determined_is_said_in_words(plane_page):
    text = Reader(plane_page).text
    assert "sigma_v MPa as its prior - 8 ± 0.8 8 2 to 20" in text
    assert "sigma_v is known only from its prior" in text
    assert "6.543" not in text  # the value at which the search happened to stop
    assert "ST-1 bench 2 3.50 not determined - - - - predicted" in text


def test_the_numbers_are_those_of_the_result(plane_page):
    text = Reader(plane_page).text
    assert "E_rock = 12.3 GPa (95 %: 11.6 to 13.1)" in text
    assert "K0 lies on its upper bound." in text
    assert "EX-1.a8 bench 1 1.90 1.10 - 0.80 8.0 8.0 used" in text
    assert "EX-1.a8, bench 1: +8.0 standard deviations" in text
    for words in ("geoident fit case.yaml", "a" * 64, "b" * 64, "c" * 64, "d" * 64, "seed 7"):
        assert words in text


def test_the_readings_that_bear_most_are_named(plane_page):
    text = Reader(plane_page).text
    assert "Loss huber (delta 1.345); plain weighted squares 75" in text
    assert "EX-1.a8 bench 1 8.0 0.50 0.50 E_rock +0.80" in text


def test_the_section_of_a_body_of_revolution_has_a_radius(plane):
    shaft = replace(plane, case_resolved="title: Shaft\nanalysis: axisymmetric\n")
    (picture,) = [p for p in album(shaft).fields if p.name == "vectors"]
    labels = {axes.get_xlabel() for axes in picture.draw().axes}
    assert labels == {"radius r (m)"}


def test_outliers_spread_and_score_are_those_of_the_table(plane):
    (far,) = outliers(plane)
    assert (far.channel, far.stage, far.used) == ("EX-1.a8", "bench 1", True)
    assert far.residual == pytest.approx(8.0)
    used = [1, -1, 8, 2, 1, -1]  # in 0.1 mm, the settlement also in the first stage
    assert rms(plane) == pytest.approx(np.sqrt(np.mean(np.square(used))))
    assert scored(plane) == (4, 4)


def test_readings_known_to_be_wrong_are_neither_outliers_nor_scored(plane):
    bad = np.zeros((5, 3), dtype=bool)
    bad[2, 1] = bad[0, 2] = True
    used = plane.gauges.used & ~bad
    marked = replace(plane, gauges=changed_gauges(plane.gauges, bad=bad, used=used))
    assert outliers(marked) == ()
    assert scored(marked) == (3, 3)
    rows = [" ".join(row) for row in reading_table(marked).rows]
    assert "EX-1.a8 bench 1 1.90 1.10 - 0.80 8.0 8.0 known to be wrong" in rows


def test_text_of_the_user_never_becomes_markup():
    base = example_result(2)
    evil = replace(
        base,
        gauges=changed_gauges(base.gauges, channels=(EVIL, *base.gauges.channels[1:]),
                              stages=(EVIL, *STAGES[1:])),
        parameters=replace(base.parameters, names=(EVIL, "sigma_v", "K0")),
        provenance=replace(base.provenance, command=EVIL, case_file=EVIL),
        findings=(Finding("misfit", EVIL, EVIL),), notes=(EVIL,), reason=EVIL, fields=None,
        case_resolved="title: " + repr(EVIL.replace("'", "")) + "\n",
    )  # fmt: skip
    text = report_page([(EVIL, evil)])
    reader = Reader(text)
    assert not {"script", "img"} & set(reader.tags)
    assert "alert(1)" in reader.text
    assert reader.text.count("$x_1$") > 5
    assert "alert(1)" in case_title(evil)


def test_a_broken_case_text_gives_no_title():
    for text in ("title: [", "[" * 5000, "- a", "title: {a: b}", ""):
        assert case_title(replace(example_result(), case_resolved=text)) == ""


@pytest.mark.usefixtures("plain_pictures")
def test_several_results_are_compared():
    table = example_result().parameters
    known = replace(
        table, determined=np.array([True, True, True]), names=("E_rock", "sigma_v", "nu")
    )
    second = small_result(parameters=known, grid=None)
    text = report_page([("first", small_result()), ("second", second)])
    reader = Reader(text)
    for name in ("compared-parameters", "compared-gauges-1", "1-residuals", "2-residuals"):
        assert f'id="figure-{name}"' in text
    names = [value for _, key, value in reader.attributes if key == "id"]
    assert len(names) == len(set(names))
    assert "E_rock GPa 12.3 (11.6 to 13.1) 12.3 (11.6 to 13.1)" in reader.text
    assert "sigma_v MPa as its prior 6.543" in reader.text
    assert "nu - - 3.00 (2.80 to 3.00)" in reader.text
    assert 'href="#section-result-2"' in text


@pytest.mark.usefixtures("plain_pictures")
def test_a_scan_has_its_grid():
    text = report_page([("pit.scan", small_result())])
    assert 'id="figure-scan"' in text
    assert 'id="figure-displacement"' not in text


def test_tags_escape_all_that_is_not_html():
    assert tag("p", "<b>", Html("<b></b>"), class_='"') == '<p class="&quot;">&lt;b&gt;<b></b></p>'
    assert "<title>&lt;x&gt;</title>" in page("<x>")


@pytest.mark.parametrize("kind", ["plane", "solid"])
def test_no_figure_is_wider_than_a_printed_page_shows_as_it_is_drawn(kind, reports):
    _, drawn = reports[kind]
    assert {name for name, figure in drawn.items() if figure.get_figwidth() > 7.4} == set()


def test_the_largest_displacement_is_printed_at_its_place(plane, reports):
    panel = reports["plane"][1]["displacement"].axes[len(STAGES) - 1]
    (text,) = [t.get_text() for t in panel.findobj(Text) if t.get_text().startswith("max ")]
    fields = plane.fields
    points, moved = fields.mesh.points, np.linalg.norm(fields.displacement[-1], axis=1)
    shown = np.zeros(len(points), dtype=bool)  # nodes of present ground inside the axes
    shown[fields.mesh.blocks[0].nodes[fields.present[-1]]] = True
    (x0, x1), (y0, y1) = panel.get_xlim(), panel.get_ylim()
    shown &= ((points >= (x0, y0)) & (points <= (x1, y1))).all(axis=1)
    assert float(text.split()[1]) == pytest.approx(1e3 * moved[shown].max(), rel=5e-3)
    (cross,) = [line for line in panel.lines if line.get_marker() == "x"]
    (at,) = np.flatnonzero((points == np.ravel(cross.get_data())).all(axis=1))
    assert moved[at] == pytest.approx(moved[shown].max(), rel=1e-6)

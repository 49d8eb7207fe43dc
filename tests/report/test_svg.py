"""Figures as SVG: words stay text, the same figure gives the same bytes, names agree in a page."""

import re
from dataclasses import replace
from xml.etree import ElementTree

import pytest

pytest.importorskip("matplotlib", reason='reports need matplotlib: pip install "geoident[report]"')

from matplotlib.figure import Figure

from geoident.report.drawing.labels import place_labels
from geoident.report.drawing.style import Picture, image
from geoident.report.page.blocks import Figures, body, section
from geoident.report.page.svg import inline_svg

SVG = "{http://www.w3.org/2000/svg}"
WORDS = {"a < b & c", "$x_1$ costs 5 $", "second line", "turned", "EX-1"}


def draw():
    """Words of all kinds, markers, hatches, a cut line and an image: all that has names."""
    figure = Figure(figsize=(3, 2))
    axes = figure.subplots()
    axes.plot([0, 1, 2], [0, 1, 0], marker="o")
    axes.fill_between([0, 1], [0, 1], hatch="//")
    axes.imshow([[0.0, 1.0]], extent=(0, 1, 0, 1))
    axes.set_ylabel("turned")
    axes.text(0.2, 0.5, "a < b & c")
    axes.text(0.2, 0.2, "$x_1$ costs 5 $\nsecond line")
    place_labels(axes, [(0.5, 0.5)], ["EX-1"])
    return figure


PICTURE = Picture("x", "A pit & more", "Dots: read & drawn.", draw)


@pytest.fixture(scope="module")
def svg():
    return image(PICTURE, "svg")


def names_and_references(text):
    names = re.findall(r'\sid="([^"]+)"', text)
    return names, set(re.findall(r'(?:url\(|href=")#([^")]+)', text))


def test_every_word_is_text(svg):
    assert {element.text for element in ElementTree.fromstring(svg).iter(f"{SVG}text")} >= WORDS


def test_the_file_has_a_title_a_description_and_no_date(svg):
    root, said = ElementTree.fromstring(svg), svg.decode()
    assert root.find(f"{SVG}title").text == "A pit & more"
    assert "Dots: read &amp; drawn." in said
    assert "dc:date" not in said


def test_the_same_figure_gives_the_same_bytes(svg):
    assert image(PICTURE, "svg") == svg


def test_letters_have_a_second_font_where_a_machine_lacks_the_first(svg):
    assert "'DejaVu Sans', 'Verdana', 'Geneva', sans-serif" in svg.decode()


def test_in_a_page_a_figure_is_an_element_and_no_document(svg):
    text = inline_svg(svg, text='"A" < B')
    root = ElementTree.fromstring(text)
    assert {element.text for element in root.iter("text")} >= WORDS
    assert root.get("aria-label") == '"A" < B'
    for gone in ("<?xml", "<!DOCTYPE", "xmlns", "xlink", "<metadata", "<style", "<title"):
        assert gone not in text


def test_two_figures_of_a_page_share_no_name_and_find_their_own():
    seen = set()
    for name in ("one", "two"):
        svg = image(replace(PICTURE, name=name), "svg")
        names, references = names_and_references(inline_svg(svg, text=""))
        assert references <= set(names)
        assert len(references) >= 3  # a marker, a hatch, a clip
        assert len(names) == len(set(names))
        assert not seen & set(names)
        seen |= set(names)


def test_title_and_caption_of_a_figure_never_become_markup(svg):
    picture = replace(PICTURE, title="<b>", caption="<i> & more")
    text = body([section("Figures", Figures((picture,)))], lambda _: [svg])
    assert "<b>Figure 1: &lt;b&gt;. </b>&lt;i&gt; &amp; more</figcaption>" in text

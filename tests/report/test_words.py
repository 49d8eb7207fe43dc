"""Words of pictures: real text, as wide as it was laid out, with a title and a description."""

from xml.etree import ElementTree

import pytest

pytest.importorskip("matplotlib", reason='reports need matplotlib: pip install "geoident[report]"')

from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from geoident.report.drawing.style import Picture, image

SVG = "{http://www.w3.org/2000/svg}"
PLAIN, OUTLINED = "a < b & c", " EX-1  deep"


def drawn():
    figure = Figure(figsize=(3, 2))
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1])
    axes.set_ylabel("turned")
    axes.text(0.2, 0.5, PLAIN, fontsize=8)
    halo = [withStroke(linewidth=2.0, foreground="white")]
    axes.text(0.2, 0.2, f"{OUTLINED}\nsecond line", fontsize=10, path_effects=halo)
    return figure


@pytest.fixture(scope="module")
def root():
    return ElementTree.fromstring(image(Picture("x", "A pit", "Dots: read & drawn.", drawn), "svg"))


@pytest.fixture(scope="module")
def words(root):
    return {element.text: element for element in root.iter(f"{SVG}text")}


def test_every_word_is_text_of_a_stated_length(words):
    assert {PLAIN, "turned", "second line", "0.0", "1.0"} <= set(words)
    for text, element in words.items():
        size = float(element.get("font-size"))
        assert 0.2 * size < float(element.get("textLength")) / len(text) < size
        assert element.get("lengthAdjust") == "spacingAndGlyphs"
        assert element.get("style") is element.get("font-family") is None


def test_a_length_is_that_of_the_font(words):
    # The advances of a, space, <, b, & and c in DejaVu Sans are 1255, 651, 1716, 1300, 1597 and
    # 1126 of its 2048 units.
    expected = (1255 + 4 * 651 + 1716 + 1300 + 1597 + 1126) / 2048 * 8
    assert float(words[PLAIN].get("textLength")) == pytest.approx(expected, rel=0.02)


def test_spaces_that_would_be_dropped_are_kept(words):
    assert "\u00a0EX-1 \u00a0deep" in words


def test_an_outline_is_a_stroke_of_the_text_itself(words):
    for text in ("\u00a0EX-1 \u00a0deep", "second line"):
        assert words[text].get("paint-order") == "stroke"
        assert words[text].get("stroke") == "#ffffff"
    assert words[PLAIN].get("stroke") is None


def test_the_picture_has_title_description_and_fonts_that_machines_have(root):
    assert [child.tag for child in root][:2] == [f"{SVG}title", f"{SVG}desc"]
    assert root[0].text == "A pit"
    assert root[1].text == "Dots: read & drawn."
    assert root.get("font-family").startswith("'DejaVu Sans', Verdana")


def test_the_same_figure_gives_the_same_bytes():
    picture = Picture("x", "A pit", "", drawn)
    assert image(picture, "svg") == image(picture, "svg")

"""Pages in grey: what stands side by side differs in lightness, or in marker, dashes or dots.

Looked at in the files that are printed, since these are what a client copies.
"""

import re
from itertools import combinations
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest

from geoident.model.results.result import MemberForces
from geoident.report.drawing import style
from geoident.report.drawing.album import album
from geoident.report.drawing.fields.panels import bands
from geoident.report.drawing.forces import structure_pictures
from geoident.report.drawing.style import LENGTHS, STRESSES, Picture, image, key

SVG, LINK = "{http://www.w3.org/2000/svg}", "{http://www.w3.org/1999/xlink}href"
LEAST = 0.08
"""Of the way from black to white: what an eye tells apart on a copy."""
STAGES = tuple(f"stage {k}" for k in range(8))


def lightness(colour):
    """Of ``#rrggbb``, 0 to 1, as a copying machine sees it."""
    parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    return float(np.dot(parts, (0.299, 0.587, 0.114)))


def looks(svg):
    """Colour, dashes and marker of each line of a legend, by its words, as they are in a file."""
    root = ElementTree.fromstring(svg)
    shapes = {e.get("id"): e[0].get("d") if len(e) else e.get("d") for e in root.iter()}
    found, line, marker = {}, None, None
    for element in root.iter():
        style = dict(part.split(": ") for part in element.get("style", "").split("; ") if part)
        if element.tag == f"{SVG}path" and style.get("stroke", "none") != "none":
            line = style["stroke"], style.get("stroke-dasharray", "")
            marker = None
        elif element.tag == f"{SVG}use":
            marker = shapes.get(element.get(LINK, "")[1:])
        elif element.tag == f"{SVG}text" and element.text and line is not None:
            found[element.text.strip()] = (*line, marker)
    return found


def apart(one, other):
    """Two lines can be told from each other without colours."""
    return one[1:] != other[1:] or abs(lightness(one[0]) - lightness(other[0])) >= LEAST


def wall():
    """Forces along a wall at as many stages as are drawn at most."""
    y = np.linspace(0.0, -8.0, 9)
    ends = np.stack([np.stack([0 * y[:-1], y[:-1]], 1), np.stack([0 * y[1:], y[1:]], 1)], axis=1)
    rise = np.arange(1.0, 9.0)
    forces = np.outer(np.sin(y[:-1]), rise) * 1e4
    nan = np.full((8, 8), np.nan)
    return MemberForces(("wall",) * 8, np.arange(1, 9), STAGES, ends, forces,
                        np.stack([forces, forces], axis=1), forces, np.ones(8, dtype=bool), nan,
                        nan)  # fmt: skip


def lines_of_a_wall():
    (picture,) = structure_pictures(SimpleNamespace(members=wall()))
    found = looks(image(picture, "svg"))
    return {name: found[name] for name in STAGES}


def test_lines_of_stages_are_told_apart():
    found = lines_of_a_wall()
    for one, other in combinations(STAGES, 2):
        assert apart(found[one], found[other]), (one, other)


def test_a_palette_of_one_lightness_would_be_found(monkeypatch):
    monkeypatch.setattr(style, "_COLOURS", ("#808080", "#7f8180", "#81807f", "#808180"))
    found = lines_of_a_wall()
    assert not all(apart(found[a], found[b]) for a, b in combinations(STAGES, 2))


def test_things_of_one_figure_have_colours_or_markers_of_their_own():
    def draw():
        from matplotlib.figure import Figure  # noqa: PLC0415 - as pictures do

        figure = Figure()
        figure.subplots().set_axis_off()
        handles = [key(f"thing {k}", color=style.colour(k), marker=style.marker(k)) for k in
                   range(7)]  # fmt: skip
        figure.legend(handles=handles)
        return figure

    found = looks(image(Picture("x", "x", "", draw), "svg"))
    assert len(found) == 7
    for one, other in combinations(found.values(), 2):
        assert apart(one, other)


@pytest.mark.parametrize("colours", [LENGTHS, STRESSES])
def test_dark_is_large_in_grey_too(colours):
    scale = bands(np.array([np.linspace(0.0, 1.0, 50), np.ones(50)]), colours)
    shades = scale["cmap"].colors[:, :3] @ (0.299, 0.587, 0.114)
    assert np.diff(shades).max() < -0.02


def test_what_is_negative_is_dotted_where_signs_differ(plane):
    scale = bands(np.array([np.linspace(-1.0, 1.0, 50), np.ones(50)]), LENGTHS)
    grey = scale["cmap"].colors[:, :3] @ (0.299, 0.587, 0.114)
    assert grey[0] < grey.max() - LEAST  # dark on both sides: why dots are needed
    assert grey[-1] < grey.max() - LEAST
    (parts,) = [p for p in album(plane).fields if p.name == "displacement-parts"]
    dashes = re.findall(r"stroke-dasharray: ([^;\"]+)", image(parts, "svg").decode())
    longest = {max(float(x) for x in each.split(",")[::2]) for each in dashes}
    assert min(longest) < 1.0 < max(longest)  # points: dots on one side, dashes for zero
    assert "dots are on the negative side" in parts.caption

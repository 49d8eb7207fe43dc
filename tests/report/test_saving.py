"""Figures as files: layouts as matplotlib's own, few bytes, exact colours."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

pytest.importorskip("matplotlib", reason='reports need matplotlib: pip install "geoident[report]"')

from dataclasses import replace

from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from geoident.report.drawing import lines
from geoident.report.drawing.fields import panels
from geoident.report.drawing.raster import Raster
from geoident.report.drawing.signs import sign_pictures
from geoident.report.drawing.style import Picture, drawing_style, image

CASES = Path(__file__).parents[2] / "cases"
SVG, LINK = "{http://www.w3.org/2000/svg}", "{http://www.w3.org/1999/xlink}href"


def drawn(draw):
    def made():
        figure = Figure(figsize=(3, 2))
        draw(figure.subplots())
        return figure

    return ElementTree.fromstring(image(Picture("x", "", "", made), "svg"))


def test_bands_have_the_colours_of_norm_and_map():
    values = np.linspace(-3.0, 9.0, 400).reshape(20, 20)
    for low, high in ((-3.0, 9.0), (-1.0, 9.0), (-3.0, 4.0), (-1.0, 4.0)):
        shown = np.stack([np.clip(values.ravel(), low, high), np.ones(400)])
        scale = panels.bands(
            np.hstack([shown, [[values.min(), values.max()], [1e-9, 1e-9]]]), "YlGnBu"
        )
        expected = ScalarMappable(scale["norm"], scale["cmap"]).to_rgba(values, bytes=True)
        image_of = values.copy()
        image_of[0, 0] = np.nan
        found = panels._coloured(image_of, scale)
        assert (found[0, 0] == 0).all()
        assert np.array_equal(found.reshape(-1, 4)[1:], expected.reshape(-1, 4)[1:])


@pytest.mark.parametrize("look", [{"linestyle": "dashed"}, {"linestyle": (0, (0.6, 2.2))}])
def test_lines_of_values_are_the_contours_of_matplotlib(look):
    rows, columns = 41, 60
    x, y = np.meshgrid(np.linspace(0.0, 6.0, columns), np.linspace(0.0, 4.0, rows))
    values = np.sin(x) * np.cos(y) + 0.1 * x
    values[10:14, 20:25] = np.nan
    levels = [-0.5, 0.0, 0.3, 7.0]
    low, high = np.array([0.0, 0.0]), np.array([6.0, 4.0])
    none = np.empty((0, 3))
    raster = Raster(low, high, (rows, columns), none, *(np.empty(0),) * 3, none, none)
    half, every = np.array([6.0 / columns, 4.0 / rows]) / 2, panels._EVERY

    def ours(axes):
        added = {"edgecolors": "black", "lw": 0.6, "ls": look["linestyle"]}
        panels.add_levels(axes, raster, values, levels, **added)
        axes.set(xlim=(0.0, 6.0), ylim=(0.0, 4.0))

    def theirs(axes):
        at = [half[k] * (1 + 2 * np.arange(0, (columns, rows)[k], every)) for k in (0, 1)]
        some = np.ma.masked_invalid(values[::every, ::every])
        for level in levels[:3]:
            axes.contour(*at, some, levels=[level], colors="black", linewidths=0.6,
                         linestyles=[look["linestyle"]])  # fmt: skip
        axes.set(xlim=(0.0, 6.0), ylim=(0.0, 4.0))

    found, expected = (
        {(p.get("d"), p.get("style")) for p in drawn(each).iter(f"{SVG}path")}
        for each in (ours, theirs)
    )
    assert found == expected
    assert any("dasharray" in style for _, style in found)


def test_chained_lines_are_the_same_lines():
    rng = np.random.default_rng(3)
    nodes = rng.integers(0, 6, size=(60, 2, 2)).astype(float)
    ends = nodes[(nodes[:, 0] != nodes[:, 1]).any(axis=1)]
    chain = lines._chained(ends)
    pairs = np.stack([chain[:-1], chain[1:]], axis=1)
    pairs = pairs[np.isfinite(pairs).all(axis=(1, 2))]

    def key(each):
        return sorted(tuple(sorted(map(tuple, pair))) for pair in each.tolist())

    assert key(pairs) == key(ends)
    assert np.isnan(chain).any(axis=1).sum() < len(ends) / 2


def test_signs_are_those_of_the_structures_that_are_measured(plane):
    text = (CASES / "braced-pit" / "case.yaml").read_text(encoding="utf-8")
    table = replace(plane.gauges, gauges=("LC1",) * len(plane.gauges.gauges))
    (picture,) = sign_pictures(replace(plane, case_resolved=text, case_text=text, gauges=table))
    with drawing_style():
        said = {axes.get_title("left") for axes in picture.draw().axes}
    assert said == {"strut: compression"}

"""The drawings of what counts as positive, and the page of instruments."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import get_args

import pytest

from geoident.io.case.file import read_case
from geoident.io.case.gauges.kinds import GaugeSection
from geoident.report.drawing.signs import SIGNS, sign_pictures, signs_figure
from geoident.report.drawing.style import Picture, drawing_style, image

DOCS = Path(__file__).resolve().parents[2] / "geoident" / "docs"
ALL = [get_args(s.model_fields["kind"].annotation)[0] for s in get_args(get_args(GaugeSection)[0])]
KINDS = [kind for kind in ALL if kind != "reading"]  # of another program, which knows its sign

CASE = """\
format: geoident-case/1
title: Every instrument
analysis: plane-strain
mesh: {{file: cavern.msh}}
parameters: {{E: {{start: 15 GPa, bounds: [2 GPa, 80 GPa]}}}}
materials: {{rock: {{E: $E, nu: 0.25}}}}
groups: {{rock: rock, heading: rock}}
supports: {{left: x, bottom: [x, y]}}
in_situ: {{model: heim, vertical: 8 MPa, K0: 1}}
water: {{table: 0 m, groups: [rock]}}
structures:
  bolts: {{kind: bolt, E: 200 GPa, diameter: 25 mm, spacing: 1.5 m, ends: [[[3, 0 m], [7, 1 m]]]}}
  tied: {{kind: bolt, EA: 98 MN, spacing: 1.5 m, ends: [[[3, 0 m], [7, 1 m]]], k_grout: 1 GPa}}
interfaces: {{fault: {{along: fault, k_n: 9 GPa/m, k_s: 3 GPa/m}}}}
stages:
  - {{name: heading, excavate: [heading], build: [bolts, tied]}}
{gauges}
fit: {{method: gauss-newton}}
"""


def test_every_kind_of_gauge_has_a_drawing_and_a_line_in_the_page():
    assert set(SIGNS) == set(KINDS)
    page = (DOCS / "instruments.md").read_text(encoding="utf-8")
    assert "`reading`" in page
    rows = " ".join(line.split("|")[1] for line in page.splitlines() if line.startswith("| `"))
    assert set(re.findall("`([a-z-]+)`", rows)) == set(KINDS)


def test_the_picture_of_the_page_has_what_is_drawn():
    """As many panels and strokes; bytes differ between versions of matplotlib."""
    drawn = image(Picture("signs", "", "", lambda: signs_figure(tuple(SIGNS))), "svg")
    kept = (DOCS / "signs.svg").read_bytes()
    remedy = "run: python -m geoident.report.drawing.signs > geoident/docs/signs.svg"
    for mark in (b"<clipPath", b"<path", b"<use", b"<text"):
        assert kept.count(mark) == drawn.count(mark), remedy


def test_the_gauges_of_the_page_are_read(tmp_path):
    page = (DOCS / "instruments.md").read_text(encoding="utf-8")
    gauges = re.search("```yaml\n(.*?)```", page, re.DOTALL)[1]
    (tmp_path / "cavern.msh").touch()
    (tmp_path / "case.yaml").write_text(CASE.format(gauges=gauges.rstrip()), encoding="utf-8")
    case = read_case(str(tmp_path / "case.yaml")).case
    assert {channel.kind for channel in case.channels} == set(KINDS)


@pytest.mark.parametrize("kind", SIGNS)
def test_drawings_stay_in_their_panels(kind):
    figure = signs_figure((kind,))
    figure.canvas.draw()
    frame = figure.bbox
    for text in (text for axes in figure.axes for text in axes.texts):
        box = text.get_window_extent()
        assert box.x0 >= frame.x0 - 1
        assert box.x1 <= frame.x1 + 1


def test_signs_are_those_of_the_structures_that_are_measured(plane):
    text = (DOCS.parents[1] / "cases/braced-pit/case.yaml").read_text(encoding="utf-8")
    table = replace(plane.gauges, gauges=("LC1",) * len(plane.gauges.gauges))
    (picture,) = sign_pictures(replace(plane, case_resolved=text, case_text=text, gauges=table))
    with drawing_style():
        said = {axes.get_title("left") for axes in picture.draw().axes}
    assert said == {"strut: compression"}

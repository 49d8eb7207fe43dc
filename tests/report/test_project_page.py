"""The report of several sections: what it shows; it is remade, and replaces nothing else."""

import re
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from support.projects import example, without

from geoident.cli.app import geoident
from geoident.io.result.project import read_project_result
from geoident.report.drawing.project import (
    bands_figure,
    estimate_pictures,
    law_figure,
    law_pictures,
    reading_pictures,
)
from geoident.report.drawing.style import drawing_style
from geoident.report.text.project.tables import project_text


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A fit of four sections that predicts two."""
    folder = tmp_path_factory.mktemp("project")
    path = example(folder, without("km 2", "km 4", "km 6", "km 7"))
    found = CliRunner().invoke(geoident, ["fit", path, "--leave-one-out", "-q"])
    assert found.exit_code == 0, found.output
    return folder


@pytest.fixture(scope="module")
def result(folder):
    return read_project_result(folder / "project.fit.h5")


@pytest.mark.usefixtures("plain_pictures")
def test_the_page_shows_the_law_the_sections_and_what_is_predicted(folder):
    run = CliRunner()
    done = run.invoke(geoident, ["report", str(folder / "project.fit.h5")])
    assert done.exit_code == 0, done.output
    page = (folder / "project.fit.html").read_text(encoding="utf-8")
    for heading in ("Summary", "Findings", "Laws", "Sections", "Predicted sections",
                    "Left out in turn", "Provenance"):  # fmt: skip
        assert re.search(rf"<h2[^>]*>.*{heading}", page), heading
    assert page.count("<svg") >= 4
    assert "a * exp(b * GSI)" in page
    # the same page again; a page that is someone's own stays
    assert run.invoke(geoident, ["report", str(folder / "project.fit.h5")]).exit_code == 0
    (folder / "project.fit.html").write_text("mine")
    assert run.invoke(geoident, ["report", str(folder / "project.fit.h5")]).exit_code == 6
    flags = ["report", str(folder / "project.fit.h5"), "--figures", str(folder)]
    assert run.invoke(geoident, flags).exit_code == 2


def test_the_law_is_drawn_with_every_section(result):
    with drawing_style():
        figure = law_figure(result, result.laws[0], "GSI")
    (axes,) = figure.axes
    dots = [line for line in axes.lines if line.get_marker() == "o"]
    diamonds = [line for line in axes.lines if line.get_marker() == "D"]
    assert len(dots) == 8
    assert len(diamonds) == 2
    assert axes.get_ylabel() == "E_rock (GPa)"
    assert axes.get_yscale() == "log"
    line = next(line for line in axes.lines if line.get_marker() == "None")
    known = {row.name: row.value for row in result.common}
    np.testing.assert_allclose(
        line.get_ydata(),
        known["a"] / 1e9 * np.exp(known["b"] * np.asarray(line.get_xdata())),
        rtol=1e-9,
    )


def test_bands_show_what_lies_outside(result):
    rows = [row for row in result.readings if row.section == "km 9"]
    wrong = replace(rows[0], measured=rows[0].upper95 + 0.01)
    with drawing_style():
        figure = bands_figure([[wrong, *rows[1:]]])
    circled = [line for line in figure.axes[0].lines if line.get_markersize() == 9]
    assert len(circled) == 1
    read = [line.get_xdata()[0] for line in figure.axes[0].lines if line.get_marker() == "x"]
    in_mm = [1e3 * row.measured for row in (wrong, *rows[1:])]
    np.testing.assert_allclose(read, in_mm)
    bars = [band.get_segments()[0][:, 0] for band in figure.axes[0].collections]
    np.testing.assert_allclose(bars[0], [1e3 * wrong.lower95, 1e3 * wrong.upper95])
    assert "(mm)" in figure.axes[0].get_xlabel()
    assert len(reading_pictures(rows, "predicted", "Predicted")) == 1


def test_many_sections_are_parted(result):
    assert len(law_pictures(result)) == 1
    rows = [
        replace(row, section=f"{row.section}-{n}") for n in range(9) for row in result.parameters
    ]
    assert len(estimate_pictures(replace(result, parameters=tuple(rows)))) == 3


def test_the_text_fits_a_terminal(result):
    text = project_text(result, title="project.fit.h5")
    assert max(map(len, text.splitlines())) <= 80
    assert "km 10: predicted readings" in text
    assert "Left out in turn" in text

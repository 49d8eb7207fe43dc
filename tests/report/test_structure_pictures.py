"""Pictures of structures: in the case where they stand, in a page what they bear."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from geoident.model.actions import Traction
from geoident.model.case import Stage, Support
from geoident.model.parameter import Scalar
from geoident.model.structures import Anchors, Beam, Bolts, Struts
from geoident.report.drawing.model.figure import model_figure
from geoident.report.drawing.structures import structure_pictures
from geoident.report.drawing.style import drawing_style
from geoident.report.text.structures import force_table, structures_list
from tests.report.test_figures import boxes, visible_texts
from tests.support.cases import displacement, material, model
from tests.support.meshes import box, regroup
from tests.support.tunnels import with_lines


@pytest.fixture(scope="module")
def pit():
    """A half pit with a hinged wall, a jacked strut, a prop to a fixed place, anchors, a nail."""
    mesh = regroup(
        box("quad8", (10, 6), size=(40.0, 24.0)), pit=lambda x: (x[:, 0] < 12) & (x[:, 1] > 16)
    )
    here = np.flatnonzero((np.abs(mesh.points[:, 0] - 12) < 1e-9) & (mesh.points[:, 1] > 7.9))
    y = here[np.argsort(mesh.points[here, 1])]
    mesh = with_lines(mesh, "wall", np.stack([y[:-2:2], y[2::2], y[1::2]], axis=1))
    structures = {
        "wall": Beam("wall", EA=Scalar(1e10), EI=Scalar(5e8), hinges=((12.0, 20.0),)),
        "S1": Struts((((12.0, 22.0), (0.0, 22.0)),), Scalar(3.0), EA=Scalar(2e9),
                     second_end="symmetry"),
        "S2": Struts((((12.0, 18.0), (2.0, 14.0)),), Scalar(3.0), EA=Scalar(2e9),
                     second_end="fixed"),
        "A1": Anchors((((12.0, 19.0), (28.0, 13.0)), ((12.0, 17.0), (28.0, 11.0))), Scalar(2.0),
                      EA=Scalar(1.2e8), grouted=6.0),
        "nail": Bolts((((12.0, 21.0), (17.0, 20.0)),), Scalar(2.0), EA=Scalar(1.2e8)),
    }  # fmt: skip
    push = {"push": Traction("x1", (Scalar(-1e4), Scalar(0.0)))}
    return model(
        mesh,
        materials={"soil": material("soil", 5e7, 0.3)},
        groups={"rock": "soil", "pit": "soil"},
        supports=(Support("x0", (0,)), Support("y0", (0, 1))),
        structures=structures,
        stages=(
            Stage("wall", build=("wall",)),
            Stage("dig", excavate=("pit",), build=("S2", "nail"), loads=push),
            Stage("stress", build=("S1", "A1"),
                  prestress={"S1": Scalar(1e5), "A1": Scalar(3e5)}),
            Stage("jack", prestress={"S1": Scalar(2e5)}),
        ),
        channels=(displacement("d", (12.0, 24.0), (1.0, 0.0)),),
    )  # fmt: skip


@pytest.fixture(scope="module")
def members(pit):
    return pit.survey(np.empty(0), fields=False).members


def test_the_picture_of_a_case_names_all_structures_and_says_how_they_end(pit):
    with drawing_style():
        figure = model_figure(pit.case, pit.mesh)
        said = {text.get_text().strip() for text in visible_texts(figure)}
    assert {"wall", "S1", "S2", "A1", "nail"} <= said
    assert {
        "wall or lining", "hinge", "strut", "end on a plane of symmetry", "fixed end",
        "anchor (thick: grouted)", "bolt",
    } <= said  # fmt: skip


def test_forces_along_the_wall_and_in_bars_are_drawn(members):
    pictures = structure_pictures(SimpleNamespace(members=members))
    assert [picture.name for picture in pictures] == ["forces-1", "bar-forces"]
    with drawing_style():
        wall, bars = (picture.draw() for picture in pictures)
        for figure in (wall, bars):
            figure.draw_without_rendering()
            inside = figure.bbox.padded(1.0)
            for text, box_of in boxes(figure):
                assert inside.contains(box_of.x0, box_of.y0), text.get_text()
                assert inside.contains(box_of.x1, box_of.y1), text.get_text()
    assert [axes.get_xlabel() for axes in wall.axes] == ["M (kNm/m)", "N (kN/m)", "Q (kN/m)"]
    assert wall.axes[0].get_ylabel() == "y (m)"
    # One line a stage beside that of zero; moments go on from piece to piece, zero at the hinge.
    lines = wall.axes[0].get_lines()[1:]
    assert len(lines) == 4
    for line in lines[1:]:
        moment, y = line.get_data()
        largest = np.abs(moment).max()
        assert largest > 1
        assert np.abs(np.diff(y)).max() == 2.0
        np.testing.assert_allclose(moment[1:-1:2], moment[2::2], atol=1e-6 * largest)
        assert np.abs(moment[np.isclose(y, 20.0)]).max() < 1e-6 * largest
    assert [axes.get_title(loc="left") for axes in bars.axes] == ["S1", "S2", "A1", "nail"]
    drawn = bars.axes[0].get_lines()[1].get_ydata()
    np.testing.assert_array_equal(drawn[2:], [-100, -200])


def test_the_force_of_the_jack_stands_in_the_tables(members):
    table = force_table(members)
    assert table.header[-1] == "stressed to"
    rows = {(row[0], row[1]): row for row in table.rows}
    assert rows["S1", "stress"][2:] == ["-100", "-100", "-", "-", "-100"]
    assert rows["A1", "stress"][-1] == "300"
    assert rows["A1", "jack"][-1] == "-"
    assert rows["wall", "jack"][-1] == "-"
    told = structures_list(members)
    (jacked,) = [t for t in told if t["structure"] == "S1" and t["stage"] == "jack"]
    assert jacked["N"] == pytest.approx(-2e5, rel=1e-14)
    assert (jacked["prestress"], jacked["N_hoop"]) == (-2e5, None)

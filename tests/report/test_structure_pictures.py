"""Pictures of structures: in the case where they stand, in a page what they bear."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.text import Text

from geoident.model.actions import PointForce, Traction
from geoident.model.case import Stage, Support
from geoident.model.parameter import Scalar
from geoident.model.results.result import MemberForces
from geoident.model.structures import Anchors, Beam, Bolts, Struts
from geoident.report.drawing.forces import structure_pictures
from geoident.report.drawing.model.figure import model_figure
from geoident.report.drawing.style import drawing_style
from geoident.report.text.structures import force_table, structures_list
from tests.report.test_figures import boxes, visible_texts
from tests.support.cases import displacement, material, model
from tests.support.meshes import box, regroup
from tests.support.pictures import laid_out
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
    assert [picture.name for picture in pictures] == ["forces-1", "bar-forces", "bars-along"]
    wall, bars = (laid_out(picture.draw) for picture in pictures[:2])
    for figure in (wall, bars):
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


def test_the_moments_of_a_wall_are_those_of_a_cantilever_in_kilonewtons():
    """8 m of a wall in ground as soft as air, 10 kN/m to the left at its head: M = 10 kN/m h."""
    mesh = regroup(box("quad8", (4, 6), size=(16.0, 24.0)), above=lambda x: x[:, 1] > 16)
    here = np.flatnonzero((np.abs(mesh.points[:, 0] - 8) < 1e-9) & (mesh.points[:, 1] > 7.9))
    y = here[np.argsort(mesh.points[here, 1])]
    mesh = with_lines(mesh, "wall", np.stack([y[:-2:2], y[2::2], y[1::2]], axis=1))
    pull = {"pull": PointForce((8.0, 24.0), (Scalar(-1e4), Scalar(0.0)))}
    wall = model(
        mesh,
        materials={"soil": material("soil", 5e7, 0.3), "air": material("air", 1e2, 0.3)},
        groups={"rock": "soil", "above": "air"},
        supports=(Support("x0", (0,)), Support("y0", (0, 1))),
        structures={"wall": Beam("wall", EA=Scalar(1e10), EI=Scalar(5e8))},
        stages=(Stage("wall", build=("wall",)), Stage("pull", loads=pull)),
        channels=(displacement("d", (8.0, 24.0), (1.0, 0.0)),),
    )
    found = wall.survey(np.empty(0), fields=False).members
    (picture,) = structure_pictures(SimpleNamespace(members=found))
    moments, axial, shear = laid_out(picture.draw).axes
    height = np.linspace(20.0, 24.0, 5)  # above the ground by half of it, or more
    for panel, right in ((moments, 10.0 * (24.0 - height)), (axial, 0.0), (shear, None)):
        drawn = panel.get_lines()[-1]  # of the last stage
        order = np.argsort(drawn.get_ydata(), kind="stable")
        seen = np.interp(height, drawn.get_ydata()[order], drawn.get_xdata()[order])
        # to the left at the head: tension on the right when one goes upwards
        np.testing.assert_allclose(np.abs(seen) if right is None else seen,
                                   10.0 if right is None else right, atol=0.02)  # fmt: skip


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


def ring(count=24):
    """A ring of straight pieces with N and M, whose M has teeth at its nodes, and a bolt."""
    turn = np.linspace(0.0, 2.0 * np.pi, count + 1)
    nodes = np.round(3.0 * np.stack([np.cos(turn), np.sin(turn)], axis=1), 9)
    nodes[-1] = nodes[0]
    ends = np.stack([nodes[:-1], nodes[1:]], axis=1)
    ends[5] = ends[5, ::-1]  # one piece runs the other way
    middle = 0.5 * (turn[1:] + turn[:-1])
    tooth = 5e3 * (-1.0) ** np.arange(count + 1)
    at_nodes = 2e3 * np.cos(2.0 * turn) + tooth
    moment = np.stack([at_nodes[:-1], at_nodes[1:]], axis=1)
    moment[5] = moment[5, ::-1]
    axial = -4e5 + 5e4 * np.cos(2.0 * middle)
    nan = np.full(1, np.nan)
    bolt = np.array([[[3.0, 0.0], [7.0, 0.0]]])
    return MemberForces(
        structures=("lining",) * count + ("bolt",),
        numbers=np.r_[np.arange(1, count + 1), 1],
        stages=("face", "lined"),
        ends=np.concatenate([ends, bolt]),
        axial=np.stack([np.r_[0.5 * axial, np.nan], np.r_[axial, 8e4]], axis=1),
        moment=np.concatenate(
            [np.stack([0.5 * moment, moment], axis=-1), np.full((1, 2, 2), np.nan)]
        ),
        shear=np.stack([np.r_[0.0 * axial, nan], np.r_[0.0 * axial, nan]], axis=1),
        per_metre=np.r_[np.ones(count, dtype=bool), False],
        hoop=np.full((count + 1, 2), np.nan),
        prestress=np.full((count + 1, 2), np.nan),
    )


def test_forces_of_a_lining_stand_on_it_and_are_those_of_the_table():
    found = ring()
    pictures = {p.name: p for p in structure_pictures(SimpleNamespace(members=found))}
    assert set(pictures) == {"forces-1", "bar-forces", "bars-along"}
    figure = laid_out(pictures["forces-1"].draw)
    by_title = {axes.get_title(loc="left"): axes for axes in figure.axes}
    assert "M (kNm/m), lined" in by_title
    axes = by_title["N (kN/m), lined"]
    said = {text.get_text() for text in axes.findobj(Text) if text.get_text()}
    row = {(row[0], row[1]): row for row in force_table(found).rows}["lining", "lined"]
    table = {f"{float(cell):.3g}" for cell in row[2:4]}
    assert table <= said
    # one scale for all stages of a quantity: half the force is half as far from the line
    reach = []
    for stage in ("face", "lined"):
        line = by_title[f"N (kN/m), {stage}"].get_lines()
        outline = max((each.get_xydata() for each in line), key=len)
        reach.append(3.0 * np.cos(np.pi / 24) - np.linalg.norm(outline, axis=1).min())
    assert reach[1] == pytest.approx(2.0 * reach[0], rel=1e-6)
    assert reach[0] > 0.0  # anticlockwise the left, where compression is drawn, is inside
    # moments are drawn at the middles of the pieces
    moments = {
        float(text.get_text()) for text in by_title["M (kNm/m), lined"].texts if text.get_text()
    }
    largest = 2.0 * np.cos(np.pi / 12) ** 2  # at a middle, of the mean of two nodes
    assert max(moments) == pytest.approx(largest, abs=0.01)
    assert min(moments) == pytest.approx(-largest, abs=0.01)


def test_bars_stand_where_they_are_as_wide_as_their_force(members):
    pictures = {p.name: p for p in structure_pictures(SimpleNamespace(members=members))}
    figure = laid_out(pictures["bars-along"].draw)
    panels = {axes.get_title(loc="left"): axes for axes in figure.axes}
    assert list(panels) == ["dig", "stress", "jack"]
    said = {text.get_text() for text in panels["jack"].findobj(Text)}
    assert "-200" in said  # of S1, as jacked
    lines = panels["jack"].get_lines()
    wide = {
        tuple(line.get_xydata().ravel()): line.get_linewidth() for line in lines
        if len(line.get_xdata()) == 2
    }  # fmt: skip
    assert wide[12.0, 22.0, 0.0, 22.0] > wide[12.0, 21.0, 17.0, 20.0]
    pieces = [line for line in lines if len(line.get_xdata()) == 2][8:]  # after those of the wall
    style = {tuple(line.get_xydata()[0]): line.get_linestyle() for line in pieces}
    assert style[12.0, 22.0] == "--"  # the strut is pressed
    assert style[12.0, 19.0] == "-"  # the anchor is pulled


def test_a_caption_says_which_stages_are_drawn_only_where_these_are_not_all():
    found = ring()
    (few,) = [p for p in structure_pictures(SimpleNamespace(members=found)) if p.name == "forces-1"]
    assert "Drawn" not in few.caption
    times = 3  # six stages
    many = replace(
        found,
        stages=tuple(f"{name} {k}" for k in range(times) for name in found.stages),
        **{key: np.tile(getattr(found, key), times)
           for key in ("axial", "moment", "shear", "hoop", "prestress")},
    )  # fmt: skip
    pictures = {p.name: p for p in structure_pictures(SimpleNamespace(members=many))}
    assert "Drawn are 4 of the 6 stages with forces." in pictures["forces-1"].caption
    assert "Drawn" not in pictures["bars-along"].caption  # the bolt stands in three stages

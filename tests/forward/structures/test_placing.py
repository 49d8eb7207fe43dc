"""Where beams and bars are on a mesh, and what their numbers make of them: by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
from support.cases import material, model, rollers
from support.meshes import box
from support.tunnels import with_lines

from geoident.fem.structures import Members
from geoident.forward.structures import placing
from geoident.forward.structures.members import bar_share, inadmissible, rigidities
from geoident.forward.structures.placing import (
    GROUT_POINTS,
    bears_on,
    clamped_nodes,
    facing_balance,
    held_points,
    hinge_nodes,
    present_throughout,
    straight_pieces,
    toothed,
)
from geoident.model.case import Stage
from geoident.model.dual import ParameterPoint
from geoident.model.parameter import Parameter, Scalar
from geoident.model.structures import Anchors, Beam, Bolts, Struts

VALUES = {"a": 3.0, "b": 0.5, "c": 7.0, "nu": 0.2}
POINT = ParameterPoint(VALUES, tuple(VALUES))
ENDS = (((1.0, 1.0), (3.0, 2.0)),)


def by(**slopes):
    return [slopes.get(name, 0.0) for name in VALUES]


A, B, C, NU = (Scalar(2.0, "a"), Scalar(0.5, "b"), Scalar(3.0, "c"), Scalar(1.0, "nu"))
# their values: 6, 0.25, 21 and 0.2
NUMBERS = {
    "EA by itself": (Bolts(ENDS, EA=A), 6.0, by(a=2.0)),
    "by its diameter": (
        Bolts(ENDS, E=A, diameter=B), np.pi / 4 * 6.0 * 0.25**2,
        by(a=np.pi / 4 * 2.0 * 0.25**2, b=np.pi / 4 * 6.0 * 2 * 0.25 * 0.5),
    ),
    "by its area": (Bolts(ENDS, E=A, area=B), 1.5, by(a=0.5, b=3.0)),
    "spaced": (Struts(ENDS, spacing=C, EA=A), 6.0 / 21.0, by(a=2.0 / 21.0, c=-6.0 * 3.0 / 21.0**2)),
    "of a number": (Bolts(ENDS, number=C, E=A, area=B), 31.5, by(a=10.5, b=63.0, c=4.5)),
}  # fmt: skip


@pytest.mark.parametrize("name", NUMBERS)
def test_stiffness_of_bars_with_derivatives(name):
    bars, value, slopes = NUMBERS[name]
    axial, bending = rigidities(bars, POINT)
    np.testing.assert_allclose(axial.columns, [value, *slopes], rtol=1e-13)
    np.testing.assert_array_equal(bending.columns, 0.0)


def test_bars_of_which_too_little_is_said_have_no_stiffness():
    for bars in (Bolts(ENDS), Bolts(ENDS, E=A), Bolts(ENDS, diameter=B), Bolts(ENDS, area=B)):
        assert not rigidities(bars, POINT)[0].columns.any()
    for beam in (Beam("line"), Beam("line", E=A), Beam("line", thickness=B), Beam("line", EA=A),
                 Beam("line", EI=A)):  # fmt: skip
        axial, bending = rigidities(beam, POINT)
        assert not axial.columns.any()
        assert not bending.columns.any()


def test_stiffness_of_walls_with_derivatives():
    axial, bending = rigidities(Beam("line", EA=A, EI=C), POINT)
    np.testing.assert_allclose(axial.columns, [6.0, *by(a=2.0)])
    np.testing.assert_allclose(bending.columns, [21.0, *by(c=3.0)])
    axial, bending = rigidities(Beam("line", E=A, thickness=B), POINT)
    np.testing.assert_allclose(axial.columns, [1.5, *by(a=0.5, b=3.0)], rtol=1e-13)
    unit, slope = 0.25**3 / 12, 3 * 0.25**2 * 0.5 / 12
    np.testing.assert_allclose(
        bending.columns, [6 * unit, *by(a=2 * unit, b=6 * slope)], rtol=1e-13
    )
    axial, bending = rigidities(Beam("line", E=A, thickness=B, nu=NU), POINT)
    plate = 1.0 / (1.0 - 0.2**2)
    stiffer = 2 * 0.2 * plate**2
    np.testing.assert_allclose(
        axial.columns, [1.5 * plate, *by(a=0.5 * plate, b=3.0 * plate, nu=1.5 * stiffer)]
    )
    np.testing.assert_allclose(
        bending.columns,
        [6 * unit * plate, *by(a=2 * unit * plate, b=6 * slope * plate, nu=6 * unit * stiffer)],
    )


def test_what_one_bar_bears_of_the_force_of_all():
    np.testing.assert_allclose(bar_share(Bolts(ENDS, spacing=C), POINT).columns, [21.0, *by(c=3)])
    np.testing.assert_allclose(
        bar_share(Bolts(ENDS, number=C), POINT).columns, [1 / 21, *by(c=-3 / 21**2)]
    )
    np.testing.assert_array_equal(bar_share(Bolts(ENDS), POINT).columns, [1.0, 0, 0, 0, 0])


def test_numbers_that_cannot_be_are_said_of_structures_and_stages():
    def said(EA, jack):
        case = SimpleNamespace(
            structures={"good": Bolts(ENDS, EA=Scalar(1.0)), "bad": Bolts(ENDS, EA=Scalar(EA))},
            stages=(
                Stage("first"),
                Stage("second", prestress={"bad": Scalar(0.0), "good": Scalar(jack, "a")}),
            ),
        )
        return inadmissible(case, VALUES)

    assert said(1.0, 2.0) is None
    assert said(1.0, 0.0) is None
    assert said(-2.5, 1.0) == "of the structure 'bad' EA is -2.5, it must be positive"
    assert said(1.0, -1.5) == (
        "at stage 'second' the prestress of the structure 'good' is -4.5, it must not be negative"
    )


def test_a_line_of_three_nodes_is_two_pieces_and_each_stands_once():
    mesh = box("quad4", (4, 1), size=(4.0, 1.0))
    top = np.flatnonzero(mesh.points[:, 1] > 0.5)
    top = top[np.argsort(mesh.points[top, 0])]
    mesh = with_lines(mesh, "curved", np.array([[top[0], top[2], top[1]]]))
    mesh = with_lines(
        mesh, "plain", np.array([[top[3], top[2]], [top[2], top[3]], [top[3], top[4]]])
    )
    assert straight_pieces(mesh, "curved").tolist() == [[top[0], top[1]], [top[1], top[2]]]
    assert straight_pieces(mesh, "plain").tolist() == [[top[3], top[2]], [top[3], top[4]]]
    pieces = np.array([[top[0], top[1]], [top[1], top[2]], [top[3], top[4]]])
    assert toothed(mesh, Beam("curved"), pieces).tolist() == [True, True, False]
    assert toothed(mesh, Beam("plain"), pieces).tolist() == [False] * 3


def test_pieces_are_turned_to_go_on_from_those_whose_side_is_known():
    """A line whose third piece has ground on its right, with pieces that run either way."""
    edges = np.array([[0, 1], [2, 1], [2, 3], [3, 4], [5, 4], [7, 8]])
    side = np.array([0, 0, -1, 0, 0, 0])
    assert placing._going_on(edges, side).tolist() == [True, False, True, True, False, False]
    assert placing._going_on(edges, -side).tolist() == [False, True, False, False, True, False]
    fork = np.array([[0, 1], [1, 2], [1, 3]])
    assert placing._going_on(fork, np.array([-1, 0, 0])).tolist() == [True, False, False]
    known = placing._going_on(edges[:3], np.array([1, 0, -1]))
    assert known.tolist() == [False, True, True]


def test_on_which_side_ground_is():
    """In the middle of two rows of cells, on the outline, and where nothing is."""
    mesh = box("quad4", (3, 2), size=(3.0, 2.0))

    def node(x, y):
        return int(np.linalg.norm(mesh.points - [x, y], axis=1).argmin())

    middle = np.array(
        [[node(0, 1), node(1, 1)], [node(2, 1), node(1, 1)], [node(2, 1), node(3, 1)]]
    )
    low = np.array([[node(0, 0), node(1, 0)], [node(2, 0), node(1, 0)]])
    present = np.ones(6, dtype=bool)
    np.testing.assert_array_equal(facing_balance(mesh, middle, present), [0.0, 0.0, 0.0])
    np.testing.assert_array_equal(facing_balance(mesh, low, present), [1.0, -1.0])
    centre = mesh.points[mesh.blocks[0].nodes].mean(axis=1)
    above = centre[:, 1] > 1.0
    np.testing.assert_array_equal(facing_balance(mesh, middle, above), [1.0, -1.0, 1.0])
    np.testing.assert_array_equal(facing_balance(mesh, middle, ~above), [-1.0, 1.0, -1.0])
    np.testing.assert_array_equal(facing_balance(mesh, middle, ~present), [0.0, 0.0, 0.0])


def test_what_the_mesh_holds_of_bars():
    first, second = ENDS[0]
    assert held_points(Bolts(ENDS), ENDS[0]) == ([("the end", first)], [("the end", second)])
    for way in ("fixed", "symmetry"):
        assert held_points(Struts(ENDS, second_end=way), ENDS[0]) == ([("the end", first)], [])
    head, grout = held_points(Anchors(ENDS, grouted=1.0), ENDS[0])
    assert head == [("the head", first)]
    assert GROUT_POINTS == len(grout) == 10
    assert {what for what, _ in grout} == {"the grouted length at"}
    along = np.array([2.0, 1.0]) / np.sqrt(5.0)
    middle = np.mean([place for _, place in grout], axis=0)
    np.testing.assert_allclose(middle, np.array(second) - 0.5 * along)


def test_hinges_at_points_and_groups():
    """A point finds its node within a hundredth of the shortest piece; a group where it meets."""
    mesh = box("quad4", (3, 1), size=(3.0, 1.0))
    points = mesh.points.copy()
    points[np.abs(points[:, 0] - 1.0) < 1e-9, 0] = 0.5
    top = np.flatnonzero(points[:, 1] > 0.5)
    top = top[np.argsort(points[top, 0])]
    mesh = with_lines(replace(mesh, points=points), "line", np.stack([top[:-1], top[1:]], axis=1))
    beam = Beam("line", clamped_on=("x0", "y0"))
    assert hinge_nodes(mesh, beam, (2.0049, 1.0)).tolist() == [top[2]]
    assert hinge_nodes(mesh, beam, (2.0, 0.9951)).tolist() == [top[2]]
    assert hinge_nodes(mesh, beam, (2.0051, 1.0)).tolist() == []
    assert hinge_nodes(mesh, beam, "x0").tolist() == [top[0]]
    assert hinge_nodes(mesh, beam, "y0").tolist() == []
    clamped = clamped_nodes(mesh, beam)
    x, y = points.T
    np.testing.assert_array_equal(clamped, (x < 1e-9) | (y < 1e-9))
    assert not clamped_nodes(mesh, Beam("line")).any()


def test_bars_bear_on_the_nodes_that_hold_most_of_them():
    """From three tenths of the largest weight on; of each bar by itself."""
    mesh = box("quad4", (2, 1))
    rows = np.zeros((2, mesh.points.size))
    rows[0, [0, 3, 4, 7]] = 1.0, -0.31, 0.29, -0.5
    rows[1, [8, 10]] = -4.0, 1.25
    members = Members(sp.csr_array(rows), np.ones(2), np.zeros(2, bool), np.zeros((2, 2, 2)))
    assert np.flatnonzero(bears_on(mesh, members)).tolist() == [0, 1, 3, 4, 5]
    nodes = np.array([[1, 4], [4, 2]])
    beam = Members(sp.csr_array(rows), np.ones(2), np.zeros(2, bool), np.zeros((2, 2, 2)), nodes)
    assert np.flatnonzero(bears_on(mesh, beam)).tolist() == [1, 2, 4]


def test_ground_that_is_there_as_long_as_a_structure_stands():
    staged = model(
        box("quad4", (4, 4), size=(4.0, 4.0)),
        materials={"rock": material("rock", 1e9, 0.2)},
        groups={"all": "rock"},
        supports=rollers(2),
        structures={"bolt": Bolts((((0.5, 0.5), (1.5, 1.5)),), EA=Scalar(1e6))},
        stages=(Stage("one"), Stage("two", build=("bolt",)), Stage("three", dismantle=("bolt",))),
    )
    sequence = staged.on_mesh.sequence
    there = present_throughout(sequence, "bolt")
    np.testing.assert_array_equal(there, sequence.present(2))
    assert present_throughout(sequence, "other") is None


@pytest.mark.parametrize(
    ("beam", "weight", "slope"),
    [
        (Beam("roof", EA=A, EI=C, weight=Scalar(200.0, "b")), 100.0, by(b=200.0)),
        (Beam("roof", E=A, thickness=B, density=Scalar(800.0, "c")), 5600.0 * 0.25 * 10.0,
         by(b=5600.0 * 0.5 * 10.0, c=800.0 * 0.25 * 10.0)),
        (Beam("roof", E=A, thickness=B, weight=Scalar(200.0, "b")), 100.0, by(b=200.0)),
        (Beam("roof", EA=A, EI=C, density=Scalar(800.0, "c")), 0.0, by()),
    ],
)  # fmt: skip
def test_what_a_beam_weighs_by_its_length(beam, weight, slope):
    """On a roof of 3 m, gravity leaning by 3 to 4; with derivatives."""
    mesh = box("quad4", (3, 2), size=(3.0, 2.0))
    top = np.flatnonzero(mesh.points[:, 1] > 1.9)
    top = top[np.argsort(mesh.points[top, 0])]
    mesh = with_lines(mesh, "roof", np.stack([top[:-1], top[1:]], axis=1))
    staged = model(
        mesh,
        parameters=tuple(Parameter(n, v, v / 2, v * 2) for n, v in VALUES.items()),
        materials={"rock": material("rock", 1e9, 0.2)},
        groups={"all": "rock"},
        supports=rollers(2),
        gravity=(6.0, -8.0),
        structures={"wall": beam},
        stages=(Stage("one"), Stage("two", build=("wall",))),
    )
    structures, states = staged.analysis.systems.structures, staged.on_mesh.sequence.states
    assert list(structures.weights(states[1])) == []
    ((name, forces),) = structures.weights(states[2])
    assert name == "the weight of the structure 'wall'"
    found = forces(POINT).reshape(-1, 2, 5)
    whole = 3.0 * np.outer([0.6, -0.8], [weight, *slope])
    np.testing.assert_allclose(found.sum(axis=0), whole, atol=1e-9)
    np.testing.assert_allclose(found[top].sum(axis=0), whole, atol=1e-9)
    np.testing.assert_allclose(found[top[1]], whole / 3.0, atol=1e-9)
    np.testing.assert_allclose(found[top[0]], whole / 6.0, atol=1e-9)

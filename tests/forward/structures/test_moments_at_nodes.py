"""Moments at the nodes of single beams: polynomials along the arc that they must meet."""

from __future__ import annotations

import numpy as np
import pytest

from geoident.forward.structures.end_moments import end_moments


def _beam(points, turned=(), *, closed=False):
    """Nodes and ends of the pieces of a polyline, some of them running the other way."""
    count = len(points)
    pairs = [(n, n + 1) for n in range(count - 1)] + ([(count - 1, 0)] if closed else [])
    nodes = np.array([pair[::-1] if n in turned else pair for n, pair in enumerate(pairs)])
    return nodes, np.array(points)[nodes]


def _found(
    points, moment, *, turned=(), closed=False, kinked=(), held=(), hinged=(), plain_lines=()
):
    """Moments at the ends of pieces, each with the sign of the first way along the beam.

    Args:
        points: nodes (k, 2) of the beam.
        moment: of every piece, M at its middle.
        turned: pieces that run the other way.
        closed: whether the last node is joined to the first.
        kinked: nodes on which something bears.
        held: nodes that do not turn.
        hinged: nodes with a hinge.
        plain_lines: pieces on lines of two nodes.
    """
    nodes, ends = _beam(points, turned, closed=closed)
    marked = [np.isin(np.arange(len(points)), some) for some in (kinked, held, hinged)]
    toothed = ~np.isin(np.arange(len(nodes)), plain_lines)
    made = end_moments(nodes, ends, toothed, *marked)
    sign = np.where(np.isin(np.arange(len(nodes)), turned), -1.0, 1.0)
    tooth = 1000.0 + np.arange(len(nodes))
    along = np.stack([moment - tooth, moment + tooth])  # at the start and at the end of a piece
    first = np.where(sign > 0, along[0], along[1]) * sign
    second = np.where(sign > 0, along[1], along[0]) * sign
    found = made.apply(first, second)
    columns = made.apply(np.stack([first, 2 * first], 1), np.stack([second, 2 * second], 1))
    for one, many in zip(found, columns, strict=True):
        np.testing.assert_allclose(many[:, 0], one, rtol=1e-12)
        np.testing.assert_allclose(many[:, 1], 2 * one, rtol=1e-12)
    start = np.where(sign > 0, found[0], found[1]) * sign
    end = np.where(sign > 0, found[1], found[0]) * sign
    return start, end, along, made


ARC = np.array([0.0, 0.7, 1.6, 2.2, 3.5, 4.3, 5.6])
MIDDLE = 0.5 * (ARC[1:] + ARC[:-1])
STRAIGHT = np.column_stack([ARC, np.zeros(7)])


@pytest.mark.parametrize("turned", [(), (1, 2), (0, 3, 5), (0, 1, 2, 3, 4, 5)])
def test_between_plain_nodes_a_cubic_of_four_middles_is_met(turned):
    """And a straight line of two next to the ends, which are free and keep what they have."""

    def cubic(s):
        return 5.0 - 3.0 * s + 2.0 * s**2 - 0.7 * s**3

    M = cubic(MIDDLE)
    start, end, along, made = _found(STRAIGHT, M, turned=turned)
    np.testing.assert_allclose(end[1:4], cubic(ARC[2:5]), rtol=1e-10)
    np.testing.assert_allclose(start[1:], end[:-1], rtol=1e-10)
    for piece in (0, 4):
        part = (ARC[piece + 1] - MIDDLE[piece]) / (MIDDLE[piece + 1] - MIDDLE[piece])
        assert end[piece] == pytest.approx((1 - part) * M[piece] + part * M[piece + 1])
    assert start[0] == along[0, 0]
    assert end[-1] == along[1, -1]
    assert made.kept.sum() == 2


@pytest.mark.parametrize("turned", [(), (1, 3)])
def test_at_a_kink_the_parabolas_of_both_sides_meet(turned):
    """Their mean, of three middles each; of two they are lines, of one it is a line across."""

    def left(s):
        return 4.0 + 2.0 * s - 0.9 * s**2

    def right(s):
        return 4.0 + 2.0 * 2.2 - 0.9 * 2.2**2 - 1.5 * (s - 2.2) + 0.4 * (s - 2.2) ** 2

    M = np.where(MIDDLE < 2.2, left(MIDDLE), right(MIDDLE))
    start, end, *_ = _found(STRAIGHT, M, turned=turned, kinked=(3,))
    assert end[2] == pytest.approx(left(2.2))
    assert start[3] == pytest.approx(left(2.2))
    apart = M + np.where(MIDDLE < 2.2, 0.0, 7.0)
    start, end, *_ = _found(STRAIGHT, apart, turned=turned, kinked=(3,))
    assert end[2] == pytest.approx(left(2.2) + 3.5)
    assert start[3] == pytest.approx(end[2])
    # two middles between kinks: a line of these
    line = 3.0 + 2.0 * MIDDLE
    start, end, *_ = _found(STRAIGHT, line, turned=turned, kinked=(2, 4))
    assert end[1] == pytest.approx(3.0 + 2.0 * ARC[2])
    assert start[4] == pytest.approx(3.0 + 2.0 * ARC[4])
    # next to a kink only one piece is there on one side: a line of the two that meet
    start, end, *_ = _found(STRAIGHT, M, turned=turned, kinked=(1,))
    part = (ARC[1] - MIDDLE[0]) / (MIDDLE[1] - MIDDLE[0])
    assert end[0] == pytest.approx((1 - part) * M[0] + part * M[1])


@pytest.mark.parametrize("turned", [(), (0,), (5,), (0, 4, 5)])
def test_at_an_end_that_is_held_the_line_of_two_middles_goes_on(turned):
    line = 3.0 - 2.0 * MIDDLE
    start, end, along, _ = _found(STRAIGHT, line, turned=turned, held=(0, 6))
    assert start[0] == pytest.approx(3.0)
    assert end[-1] == pytest.approx(3.0 - 2.0 * 5.6)
    start, end, along, _ = _found(STRAIGHT, line, turned=turned, held=(0, 6), kinked=(1, 5))
    assert start[0] == along[0, 0]  # of one middle there is no line
    assert end[-1] == along[1, -1]


def test_at_hinges_and_on_lines_of_two_nodes_what_the_beam_has_stays():
    M = 3.0 + 2.0 * MIDDLE
    start, end, along, made = _found(STRAIGHT, M, hinged=(3,))
    assert (end[2], start[3]) == (along[1, 2], along[0, 3])
    assert made.kept.tolist() == [[True, False], [False, False], [False, True], [True, False],
                                  [False, False], [False, True]]  # fmt: skip
    assert end[1] == pytest.approx(3.0 + 2.0 * ARC[2])
    start, end, along, made = _found(STRAIGHT, M, plain_lines=(2,))
    assert (end[1], start[2], end[2], start[3]) == (
        along[1, 1], along[0, 2], along[1, 2], along[0, 3],
    )  # fmt: skip
    assert made.kept.sum() == 6


@pytest.mark.parametrize(("degrees", "smooth"), [(39.0, True), (41.0, False)])
@pytest.mark.parametrize("turned", [(), (2,), (3, 4, 5)])
def test_a_beam_has_a_corner_from_forty_degrees_on(degrees, smooth, turned):
    """Across it M is no cubic: each side goes on as a parabola."""
    angle = np.radians(degrees)
    points = STRAIGHT.copy()
    points[4:] = points[3] + (ARC[4:, None] - ARC[3]) * np.array([np.cos(angle), np.sin(angle)])

    def cubic(s):
        return 5.0 - 3.0 * s + 2.0 * s**2 - 0.7 * s**3

    _, end, *_ = _found(points, cubic(MIDDLE), turned=turned)
    corner = end[2] != pytest.approx(cubic(ARC[3]), rel=1e-9)
    assert corner != smooth


def test_moments_of_a_ring_know_no_end():
    """Each node by the four pieces around it."""
    many = np.linspace(0.0, 2 * np.pi, 13)[:-1] + 0.05 * np.sin(np.arange(12))
    ring = np.column_stack([np.cos(many), np.sin(many)])
    _, ends = _beam(ring, closed=True)
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    M = np.cos(3.0 * np.arange(12)) + 2.0
    for turned in ((), (0, 11), (4, 5, 6)):
        start, end, *_ = _found(ring, M, turned=turned, closed=True)
        np.testing.assert_allclose(end, np.roll(start, -1), rtol=1e-10)
        for node in range(12):
            pieces = [(node - 2) % 12, (node - 1) % 12, node, (node + 1) % 12]
            h = length[pieces]
            x = np.array([-h[1] - h[0] / 2, -h[1] / 2, h[2] / 2, h[2] + h[3] / 2])
            exact = np.polyfit(x, M[pieces], 3)[-1]
            assert start[node] == pytest.approx(exact, rel=1e-9)
    # a triangle has corners alone: each side is one piece, and a line goes from one to the next
    corners = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 3.0]])
    start, end, *_ = _found(corners, np.array([7.0, 2.0, -1.0]), closed=True)
    np.testing.assert_allclose(end, np.roll(start, -1), rtol=1e-12)
    assert end[0] == pytest.approx((2.5 * 7.0 + 2.0 * 2.0) / 4.5)
    assert end[1] == pytest.approx((1.5 * 2.0 - 2.5 * 1.0) / 4.0)
    assert end[2] == pytest.approx((2.0 * -1.0 + 1.5 * 7.0) / 3.5)


def test_where_three_pieces_meet_each_keeps_its_moment():
    nodes = np.array([[0, 1], [1, 2], [1, 3], [2, 4], [3, 5]])
    points = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.1], [2.0, -0.1], [3.0, 0.2], [3.0, -0.3]])
    none = np.zeros(6, dtype=bool)
    made = end_moments(nodes, points[nodes], np.ones(5, dtype=bool), none, none, none)
    assert made.kept.tolist() == [[True, True], [True, False], [True, False], [False, True],
                                  [False, True]]  # fmt: skip

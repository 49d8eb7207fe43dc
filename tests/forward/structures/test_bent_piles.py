"""Piles that bend, against beams on elastic foundation and what short ones bear; derivatives."""

from __future__ import annotations

from dataclasses import replace
from math import cos, exp, pi, sin, sqrt

import numpy as np
import pytest

from geoident.errors import CollapseError
from geoident.model.actions import HeadForce, Traction
from geoident.model.case import Stage, Support
from geoident.model.parameter import Scalar
from geoident.model.structures import Piles
from tests.forward.structures.test_grouted_bars import (
    NOTHING,
    ZERO,
    L,
    bars,
    box,
    gauge,
    held,
    material,
    model,
    sought,
)
from tests.support.cases import displacement
from tests.support.derivatives import assert_exact, assert_slopes

EI, K, H = 2e6, 1.28e9, 5e4
BETA = (K / (4 * EI)) ** 0.25  # of L = 3 m then 10.7: hardly anything at the toe


def piles(dim=2, **changes):
    """A pile downwards in a box of 4 m."""
    settings = {"EI": Scalar(EI), "k_lateral": Scalar(K), "pieces": 80}
    return bars(dim, kind=Piles, **settings | changes)


def across(pile, what="M", at=0.0, *, side=(1.0, 0.0), **changes):
    """A gauge of a pile: positive with tension on a side, or the motion to that side."""
    dim, place = len(pile.ends[0][0]), np.array(pile.ends[0][0])
    side = np.pad(side, (0, dim - len(side)))
    place[-1] -= at
    if what == "u":
        one = gauge("u", "bar-displacement", pile, at, **changes)
        return replace(one, direction=tuple(side / np.linalg.norm(side)))
    kind = "strain" if what in ("inside", "outside") else "load-cell"
    changes |= {"dimension": "moment"} if what == "M" else {}
    return gauge(f"{what}{at}", kind, pile, at, quantity=what,
                 towards=tuple(place + side), **changes)  # fmt: skip


def pushed(pile, channels, *forces, way=(1.0, 0.0), kind="quad8"):
    """Readings (gauge, stage) of a pile in rigid ground whose head is pushed sideways."""
    dim = len(pile.ends[0][0])
    way = tuple(np.pad(way, (0, dim - len(way))) / np.linalg.norm(way))
    stages = tuple(
        Stage(f"push {n}", loads={"push": HeadForce("bar", Scalar(force), way)})
        for n, force in enumerate(forces)
    )
    staged = held(box(kind, (2,) * dim, size=(4.0,) * dim), pile, stages, channels=tuple(channels))
    return staged, staged.computed(NOTHING)[:, 1:]


@pytest.mark.parametrize(("kind", "way"), [("quad8", (1.0,)), ("hex8", (3.0, 4.0))])
def test_a_long_pile_that_is_pushed_at_its_head(kind, way, verification):
    """v = 2 H b/k exp(-b x) cos b x, M = H/b exp(-b x) sin b x (Hetenyi 1946), b^4 = k / (4 EI)."""
    pile, b = piles(3 if kind == "hex8" else 2, pieces=100), BETA
    if kind == "quad8":
        pile = replace(pile, spacing=Scalar(1.3))
    depths = (0.2, 0.4, 0.8)
    cells = [across(pile, "M", x, side=way) for x in depths]
    cells += [across(pile, "Q", 0.405, side=way), across(pile, "u", side=way)]
    _, read = pushed(pile, cells, H, way=way, kind=kind)
    moments = [H / b * exp(-b * x) * sin(b * x) for x in depths]
    # the ground holds it on the side to which it is pushed: the other is in tension
    np.testing.assert_allclose(-read[:3, 0], moments, rtol=8e-3)
    x = b * 0.405
    assert -read[3, 0] == pytest.approx(H * exp(-x) * (cos(x) - sin(x)), rel=0.02)
    v = 2 * H * b / K
    assert read[4, 0] == pytest.approx(v, rel=2e-3)
    if kind == "quad8":
        where = [f"{x:g}" for x in depths]
        verification("bent-pile", "moment", where, exact=moments, found=-read[:3, 0])


def test_moments_converge_with_the_square_of_the_pieces():
    exact = H / BETA * exp(-BETA * 0.5) * sin(BETA * 0.5)
    errors = []
    for n in (24, 48, 96):
        pile = piles(pieces=n)
        errors.append(abs(-pushed(pile, [across(pile, "M", 0.5)], H)[1][0, 0] - exact))
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2.0, atol=0.25)


def test_strains_of_fibres_and_the_table_of_results():
    """N/EA +- y M/EI; the table has M at the ends of pieces with tension on the right of them."""
    pile = piles(diameter=Scalar(0.6), E=Scalar(20e9), EA=None, EI=None)
    cells = [across(pile, "M", 0.6), across(pile, "inside", 0.6), across(pile, "outside", 0.6)]
    staged, read = pushed(pile, cells, H)
    own = 20e9 * pi * 0.6**4 / 64
    assert read[1, 0] == pytest.approx(0.3 * read[0, 0] / own, rel=1e-9)
    assert read[2, 0] == pytest.approx(-read[1, 0], rel=1e-9)
    table = staged.survey(NOTHING, fields=False).members
    assert set(table.structures) == {"bar"}
    piece = round(0.6 / L * 80)
    assert table.moment[piece, 0, -1] == pytest.approx(-read[0, 0], rel=1e-9)  # x is on the left
    first, second = table.moment[:, :, -1].T
    np.testing.assert_allclose(table.shear[:, -1], (second - first) / (L / 80), rtol=1e-9)
    assert (first[0], second[-1]) == (0.0, 0.0)


@pytest.mark.parametrize("head", ["joined", "clamped"])
def test_ground_that_shears_bends_a_pile_whose_head_does_not_turn(head):
    """v = g s + w, w'(0) = -g: M(0) = 2 b g EI where the head is clamped; else it turns along."""
    pile, g, G = piles(head=head), 1e-3, 1e14
    cell = across(pile, "M")
    tau = Scalar(g * G)
    away = Scalar(-g * G)
    sides = {"y1": (tau, ZERO), "x1": (ZERO, tau), "x0": (ZERO, away)}
    staged = model(
        box("quad8", (2, 2), size=(4.0, 4.0)),
        materials={"rock": material("rock", 2 * G, 0.0)},
        groups={"all": "rock"},
        supports=(Support("y0", (0, 1)),),
        structures={"bar": pile},
        stages=(
            Stage("built", build=("bar",)),
            Stage("sheared", loads={k: Traction(k, value) for k, value in sides.items()}),
        ),
        channels=(cell,),
    )
    expected = 2 * BETA * g * EI if head == "clamped" else 0.0
    assert abs(staged.computed(NOTHING)[0, -1]) == pytest.approx(expected, rel=1e-2, abs=1.0)


def test_the_most_that_ground_beside_a_short_pile_bears():
    """p_u L (sqrt(2) - 1), turning about L / sqrt(2) (as Broms 1964, p_u the same all along)."""
    p = 1e5
    for dim, way, pieces, rel in ((2, (1.0,), 20, 2e-3), (3, (2.0, 1.0), 8, 0.02)):
        pile = piles(dim, EI=Scalar(1e9), lateral_resistance=Scalar(p), pieces=pieces)
        most = p * L * (sqrt(2) - 1)
        kind = "quad8" if dim == 2 else "hex8"
        staged, _ = pushed(pile, [across(pile, "u")], 1.2 * most, way=way, kind=kind)
        with pytest.raises(CollapseError, match="'bar \\(contact\\)' cannot carry") as error:
            staged.response([("u", "push 0")]).readings(NOTHING)
        assert error.value.fraction == pytest.approx(1 / 1.2, rel=rel)


STARTS = {"E": 2e8, "EI": 2e6, "kl": 4e8, "pl": 1.6e5, "F": 2e5, "s": 1.4}


@pytest.mark.parametrize("kind", ["quad8", "hex8"])
def test_derivatives_of_piles_that_bend_and_push_the_ground_aside(kind):
    dim = 3 if kind == "hex8" else 2
    tied = {"EI": Scalar(1.0, "EI"), "k_lateral": Scalar(1.0, "kl")}
    tied |= {"spacing": Scalar(1.0, "s")} if dim == 2 else {}
    way = (1.0, 0.0) if dim == 2 else (0.8, 0.6, 0.0)
    names = ("E", "EI", "kl", "F", *(("s",) if dim == 2 else ()))
    limits = [(Scalar(0.5, "pl"), (*names, "pl")), (None, names)]
    for limit, own in limits[: 2 if dim == 2 else 1]:
        pile = piles(dim, lateral_resistance=limit, pieces=9, **tied)
        parts = (("push", 0.35), ("back", 0.1))
        staged = sought(
            pile,
            tuple(
                Stage(name, loads={"push": HeadForce("bar", Scalar(part, "F"), way)})
                for name, part in parts
            ),
            (
                across(pile, "M", 0.9), across(pile, "Q", 1.3), across(pile, "u"),
                displacement("x", (4.0,) * dim, tuple(np.eye(dim)[0])),
            ),
            own, kind, STARTS,
        )  # fmt: skip
        start = np.array([STARTS[n] for n in own])
        for which in (("M0.9", "Q1.3"), ("u", "x")):
            response = staged.response([(name, stage) for name in which for stage, _ in parts])
            if limit is None:
                assert_exact(response, start, own)
                continue
            _, jacobian = response.evaluate(start)
            assert_slopes(response.readings, start, jacobian, own, step=1e-3)
            assert np.abs(jacobian[:, -1]).max() > 0.0

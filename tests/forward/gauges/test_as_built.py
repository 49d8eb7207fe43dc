"""Gauges in fill that are zeroed before their own lift is placed, against hand-worked columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import displacement, material, model
from support.derivatives import assert_exact
from support.meshes import box, regroup

from geoident.errors import InputError
from geoident.model.case import Stage, Support
from geoident.model.gauges import Channel
from geoident.model.parameter import Parameter, Scalar

H, WEIGHT, E, NU = 2.0, 20e3, 30e6, 0.3
D = E * (1 - NU) / ((1 + NU) * (1 - 2 * NU))
DENSITY = WEIGHT / 9.81
DOWN = (0.0, -1.0)
PARAMETERS = (
    Parameter("E", E, 1e6, 1e9),
    Parameter("rho", DENSITY, 1e3, 3e3),
)
P = np.array([E, DENSITY])


def column(*channels: Channel, ground: bool = True, **changes):
    """A column in lifts of 2 m that cannot move sideways; the lowest stands there or is placed."""
    lifts = {f"l{k}": lambda c, k=k: (c[:, 1] > H * (k - 1)) & (c[:, 1] < H * k) for k in (1, 2, 3)}
    mesh = regroup(box("quad8", (1, 6), size=(1.0, 3 * H)), **lifts)
    names = ("l2", "l3") if ground else ("l1", "l2", "l3")
    stages = tuple(Stage(f"lift {name[1]}", install={name: "fill"}) for name in names)
    settings = {
        "parameters": PARAMETERS,
        "materials": {"fill": material("fill", Scalar(1.0, "E"), NU, Scalar(1.0, "rho"))},
        "groups": {"l1": "fill" if ground else None, "l2": None, "l3": None},
        "supports": (Support("x0", (0,)), Support("x1", (0,)), Support("y0", (1,))),
        "gravity": (0.0, -9.81),
        "stages": stages,
        "channels": channels,
    }
    return model(mesh, **(settings | changes))


def placed_by(y: float, lift: int) -> float:
    """Settlement at height y by the placing of a lift on the column below it, which ends at y0."""
    y0 = H * (lift - 1)
    below = WEIGHT * H * min(y, y0) / D
    z = max(y - y0, 0.0)
    return below + WEIGHT * (H * z - z**2 / 2) / D


def settled(survey, k: int) -> np.ndarray:
    return survey.computed[k]


@pytest.mark.parametrize("y", [2 * H, 1.4 * H, H])
def test_a_plate_zeroed_before_its_lift_reads_what_its_own_placing_does(y):
    """At the top of the lift, inside of it, and at its foot: by hand."""
    staged = column(displacement("S", (0.5, y), DOWN))  # zeroed in the virgin state
    by_hand = np.cumsum([placed_by(y, 2), placed_by(y, 3)])
    np.testing.assert_allclose(settled(staged.survey(P, fields=False), 0), by_hand, rtol=1e-10)


def test_readings_of_two_points_and_strains_count_from_the_placing_too():
    between = replace(
        displacement("B", (0.5, 1.5 * H), (0.0, 1.0), zero="lift 2"), second=(0.5, 2.75 * H),
        first=(0.5, 1.5 * H),
    )  # fmt: skip
    strain = Channel(
        "e", "e", "strain", None, (0.5, 2.5 * H), (0.0, 1.0), 1e-6, "lift 2", ("gauges", "e"),
        dimension="strain", unit="microstrain",
    )  # fmt: skip
    staged = column(between, strain)
    computed = staged.survey(P, fields=False).computed
    np.testing.assert_allclose(
        computed[:, 1],
        [-(placed_by(2.75 * H, 3) - placed_by(1.5 * H, 3)), -WEIGHT * 0.5 * H / D],
        rtol=1e-9,
    )
    assert np.isnan(computed[:, 0]).all() or np.allclose(computed[:, 0], 0.0)
    note = next(note for note in staged.notes if "placing of their ground" in note)
    assert note.endswith(": B, e")


def test_derivatives_are_exact_and_adjoints_agree():
    staged = column(displacement("S", (0.5, 1.4 * H), DOWN), displacement("T", (0.5, H), DOWN))
    pairs = [("S", "lift 2"), ("S", "lift 3"), ("T", "lift 3")]
    assert_exact(staged.response(pairs), P, ("E", "rho"))
    steps = staged.survey(P, fields=False).increments[1:, 0]
    np.testing.assert_allclose(steps, [placed_by(1.4 * H, 2), placed_by(1.4 * H, 3)], rtol=1e-10)


def test_a_lift_that_comes_later_than_the_stage_after_the_zero_is_refused():
    with pytest.raises(InputError) as error:
        column(displacement("S", (0.5, 2.5 * H), DOWN))
    (fault,) = error.value.faults
    assert fault.code == "gauge-in-absent-ground"
    assert "lies in 'l3', which is not there at stage 'virgin'" in fault.message
    assert fault.hint == (
        "set 'zero' to 'lift 3', which places that ground, or to 'lift 2' before it: then what "
        "its own placing does counts, too"
    )
    with pytest.raises(InputError):  # a stress has a value of its own
        column(
            Channel("s", "s", "stress", None, (0.5, 2.5 * H), (0.0, 1.0), 1e3, "lift 2",
                    ("gauges", "s"), dimension="stress", unit="kPa", quantity="yy"),
        )  # fmt: skip


def test_fill_on_a_rigid_base_needs_no_ground_below():
    """The held foot carries the first lift; nothing is there before the first stage."""
    gauges = [displacement(f"S{k}", (0.5, H * k), DOWN, zero=zero) for k, zero in (
        (1, "virgin"), (2, "lift 1"), (3, "lift 2"))]  # fmt: skip
    staged = column(*gauges, ground=False)
    survey = staged.survey(P, fields=True)
    by_hand = np.array([[sum(placed_by(H * k, lift) for lift in range(k, j + 1))
                         for j in (1, 2, 3)] for k in (1, 2, 3)])  # fmt: skip
    for k in range(3):
        np.testing.assert_allclose(survey.computed[k, k:], by_hand[k, k:], rtol=1e-10)
    assert not survey.fields.present[0].any()
    pairs = [("S1", "lift 1"), ("S1", "lift 3"), ("S2", "lift 2"), ("S2", "lift 3")]
    assert_exact(staged.response(pairs), P, ("E", "rho"))
    total = survey.reactions.force[2, :, 1]
    np.testing.assert_allclose(total[1:], WEIGHT * H * np.arange(1, 4), rtol=1e-10)

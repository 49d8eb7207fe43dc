"""Load cases that do not build on each other: a tree of stages."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from support.cases import displacement, material, model
from support.derivatives import assert_exact
from support.meshes import box, regroup

from geoident.model.actions import Pressure, WaterPressure
from geoident.model.case import Material, Stage, Support
from geoident.model.ground import Isotropic
from geoident.model.in_situ import HeimStress
from geoident.model.parameter import Parameter, Scalar

VALUES = {"E": 20e9, "E_rock": 30e9, "alpha": 1.0e-5, "q": 2e5}
BUILD = Stage("build", install={"dam": "dam"})


def lake(name, level, warmer):
    return Stage(
        name,
        loads={"lake": WaterPressure("x0", Scalar(level), Scalar(9810.0))},
        temperature={"dam": Scalar(warmer)},
        independent=True,
    )


CASES = (lake("full", 10.0, -5.0), lake("half", 8.0, 3.0), lake("low", 6.5, 8.0))


def dam(*stages, names=(), zero="build"):
    """A dam of 4 m on rock, both 6 m wide; the lake stands on x0."""
    mesh = regroup(box("quad8", (6, 10), size=(6.0, 10.0)), dam=lambda c: c[:, 1] > 6)

    def number(name):
        return Scalar(1.0, name) if name in names else Scalar(VALUES[name])

    concrete = Isotropic(E=number("E"), nu=Scalar(0.2))
    return model(
        mesh,
        parameters=tuple(Parameter(n, VALUES[n], 0, np.inf) for n in names),
        materials={
            "rock": material("rock", number("E_rock"), 0.25, 2700.0),
            "dam": Material("dam", concrete, Scalar(2400.0), number("alpha")),
        },
        groups={"rock": "rock", "dam": None},
        supports=(Support("y0", (0, 1)),),
        gravity=(0.0, -9.81),
        in_situ=HeimStress(K0=Scalar(0.5), unit_weight=Scalar(26e3), surface=Scalar(6.0)),
        stages=stages,
        channels=tuple(
            displacement(f"c{k}", (x, y), (0.8, 0.6), zero=zero)
            for k, (x, y) in enumerate([(1.0, 9.0), (5.0, 7.0), (3.0, 4.0)])
        ),
    )


def readings(staged):
    survey = staged.survey(np.array([VALUES[n] for n in staged.names]), fields=False)
    return dict(zip(staged.case.stage_names[1:], survey.computed.T, strict=True))


def test_load_cases_do_not_depend_on_their_order():
    alone = {case.name: readings(dam(BUILD, case))[case.name] for case in CASES}
    for order in permutations(CASES):
        found = readings(dam(BUILD, *order))
        for case in CASES:
            np.testing.assert_allclose(found[case.name], alone[case.name], rtol=1e-11)
    assert not np.allclose(alone["full"], alone["low"], rtol=0.1)


def test_the_trunk_goes_on_as_if_load_cases_had_not_been():
    after = Stage("surcharge", loads={"q": Pressure("y1", Scalar(2e5))})
    with_cases = readings(dam(BUILD, *CASES, after))["surcharge"]
    without = readings(dam(BUILD, after))["surcharge"]
    np.testing.assert_allclose(with_cases, without, rtol=1e-12)


def test_a_named_base_and_construction_on_a_branch():
    """An excavation on a branch is nothing to the trunk; a stage may build on a branch."""
    crack = Stage("crack", change={"dam": "rock"}, independent=True)
    loaded = Stage(
        "loaded", loads={"q": Pressure("y1", Scalar(2e5))}, base="crack", independent=True
    )
    found = readings(dam(BUILD, crack, CASES[0], loaded, CASES[1]))
    chain = (Stage("crack", change={"dam": "rock"}),
             Stage("loaded", loads={"q": Pressure("y1", Scalar(2e5))}))  # fmt: skip
    expected = readings(dam(BUILD, *chain))
    np.testing.assert_allclose(found["loaded"], expected["loaded"], rtol=1e-11)
    np.testing.assert_allclose(found["half"], readings(dam(BUILD, CASES[1]))["half"], rtol=1e-11)


def test_a_gauge_zeroed_in_one_load_case_reads_the_motion_to_another():
    found = readings(dam(BUILD, *CASES, zero="full"))
    since = readings(dam(BUILD, *CASES))
    np.testing.assert_allclose(found["half"], since["half"] - since["full"], rtol=1e-9)


@pytest.mark.parametrize("zero", ["build", "full"])
@pytest.mark.parametrize("way", ["evaluate", "by_adjoints", "readings"])
def test_a_reading_is_the_sum_of_the_steps_that_lie_between_it_and_its_zero(zero, way):
    """Also where the zero lies on another branch: back along that one, then out along its own."""
    staged = dam(BUILD, *CASES, names=("E",), zero=zero)
    pairs = [("c0", "half"), ("c2", "low"), ("c1", "full"), ("c1", "build")][: 4 - (zero == "full")]
    p, response = np.array([VALUES["E"]]), staged.response(pairs)
    found = getattr(response, way)(p)
    v = found if way == "readings" else found[0]
    steps, rows = staged.steps(pairs), [0, 2, 1, 1][: len(pairs)]
    out, back = {"build": (1, 0), "full": (1, -1)}[zero]
    # states: virgin, build, full, half, low
    np.testing.assert_array_equal(steps[1:, :2], [[0, 0], [back, back], [out, 0], [0, out]])
    np.testing.assert_array_equal(steps[1:, 2], [0, 1 if zero == "build" else 0, 0, 0])
    parts = steps * response.increments(p)[:, rows]
    np.testing.assert_allclose(parts.sum(axis=0), v, rtol=1e-9, atol=1e-12 * abs(v).max())
    assert abs(v[:2]).min() > 1e-6


def test_a_reading_at_its_own_zero_is_nothing():
    """Though the analysis that it needs goes no further than that stage."""
    staged = dam(BUILD, *CASES, names=("E",), zero="full")
    v, slopes = staged.response([("c0", "full"), ("c2", "full")]).evaluate(np.array([VALUES["E"]]))
    assert v.tolist() == [0.0, 0.0]
    assert slopes.tolist() == [[0.0], [0.0]]


def test_ground_that_leaves_on_one_branch_can_be_read_on_the_others():
    leave = Stage("leave", excavate=("dam",), independent=True)
    staged = dam(BUILD, leave, CASES[0], zero="build")
    assert "excavated ground" in staged.unreadable("c0", "leave")
    assert staged.unreadable("c2", "leave") is None  # it stands in the rock
    assert staged.unreadable("c0", "full") is None
    found, alone = readings(staged), readings(dam(BUILD, CASES[0]))
    assert np.isnan(found["leave"][:2]).all()
    np.testing.assert_allclose(found["full"], alone["full"], rtol=1e-11)


@pytest.mark.parametrize("zero", ["build", "full"])
def test_derivatives_are_exact_over_a_tree(zero):
    crack = Stage("crack", change={"dam": "rock"}, base="full")
    push = Stage("end", loads={"q": Pressure("y1", Scalar(1.0, "q"))})
    staged = dam(BUILD, *CASES, crack, push, names=tuple(VALUES), zero=zero)
    pairs = [(c, s) for c in ("c0", "c2") for s in ("half", "low", "crack", "end")]
    assert_exact(staged.response(pairs), np.array(list(VALUES.values())), staged.names)


def test_condensed_equations_follow_the_tree():
    """At p the equation error is measured - v, whatever stages led to a reading and its zero."""
    names = ("E", "E_rock")
    staged = dam(BUILD, *CASES, names=names, zero="full")
    pairs = [("c0", "half"), ("c0", "low"), ("c2", "half"), ("c1", "low")]
    response = staged.response(pairs)
    assert response.obstacle() is None
    truth = np.array([VALUES[n] for n in names])
    measured = response.readings(truth)
    p = truth * [1.02, 0.97]
    condensed = response.condense(p, measured, np.full(len(pairs), 1e-4))
    at_p = condensed.matrix @ p - condensed.vector
    np.testing.assert_allclose(at_p, measured - response.readings(p), rtol=1e-8)
    at_truth = condensed.matrix @ truth - condensed.vector
    assert np.abs(at_truth).max() < 0.1 * np.abs(at_p).max()


def test_flexibility_adds_the_paths_to_a_reading_and_to_its_zero():
    """From one load case to another a reading moves along both branches."""
    pairs = [("c0", "half"), ("c2", "half")]
    sd = np.full(2, 1e-4)
    S = {}
    for zero in ("build", "full"):
        response = dam(BUILD, *CASES, names=("E",), zero=zero).response(pairs)
        S[zero] = response.condense(np.array([20e9]), np.zeros(2), sd).flexibility
    np.testing.assert_allclose(S["full"], 2 * S["build"], rtol=1e-9)
    np.testing.assert_allclose(S["full"], S["full"].T, rtol=1e-9)


def test_the_obstacle_is_a_modulus_times_the_expansion():
    staged = dam(BUILD, *CASES, names=("E", "alpha"))
    assert "product of E and alpha" in staged.response([("c0", "full")]).obstacle()

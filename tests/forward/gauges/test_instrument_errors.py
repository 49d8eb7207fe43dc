"""What gauges add to the motion by themselves: closed forms, derivatives, identification."""

from dataclasses import replace

import numpy as np
import pytest
from support.cases import displacement, material, model, rollers
from support.derivatives import assert_exact
from support.meshes import box, regroup

from geoident.identify.problem.methods import identify
from geoident.identify.problem.problem import Problem
from geoident.model.case import Stage
from geoident.model.gauges import Reading
from geoident.model.in_situ import ConstantStress
from geoident.model.methods import CondensationOptions, GaussNewtonOptions
from geoident.model.parameter import Parameter, Scalar

DAY = 86400.0
DATES = {"virgin": 0.0, "s0": 100 * DAY, "s1": 130 * DAY, "s2": 190 * DAY}
E = Parameter("E", 5e9, 1e8, 1e11, "log", dimension="pressure", unit="GPa")
OFF = Parameter("off", 0.0, -0.01, 0.01, dimension="length", unit="mm")
DRIFT = Parameter("drift", 0.0, -1e-9, 1e-9, dimension="velocity", unit="mm/month")
TRUTH = np.array([3e9, 4e-4, 2e-11])


def cut(parameters=(E, OFF, DRIFT), *, readings=(), per_stage=False, dates=DATES):
    """A slope cut in three steps; one gauge slips and drifts, two are sound."""
    mesh = regroup(
        box("quad4", (6, 6), size=(6.0, 6.0)),
        **{f"b{k}": (lambda c, k=k: (c[:, 0] > 4) & (c[:, 1] > 5 - k) & (c[:, 1] < 6 - k))
           for k in range(3)},
    )  # fmt: skip
    known = {parameter.name for parameter in parameters}
    loose = replace(
        displacement("loose", (3.5, 5.5), (1.0, 0.0), zero="s0"),
        offset=Scalar(1.0, "off") if "off" in known else None,
        drift=Scalar(2.0, "drift") if "drift" in known and not per_stage else None,
        drift_per_stage=Scalar(1.0, "drift") if "drift" in known and per_stage else None,
    )
    zero_stress = Scalar(0.0)
    return model(
        mesh,
        parameters=parameters,
        materials={"rock": material("rock", Scalar(1.0, "E"), 0.25)},
        groups=dict.fromkeys(("rock", "b0", "b1", "b2"), "rock"),
        supports=rollers(2),
        in_situ=ConstantStress(
            (Scalar(-3e6), Scalar(-1e6), Scalar(-1e6), zero_stress, zero_stress, zero_stress)
        ),
        stages=tuple(Stage(f"s{k}", excavate=(f"b{k}",)) for k in range(3)),
        channels=(
            loose,
            displacement("sound", (3.5, 4.5), (1.0, 0.0)),
            displacement("deep", (2.5, 2.5), (1.0, 0.0)),
        ),
        readings=readings,
        dates=dates,
    )


PAIRS = [("loose", s) for s in ("s0", "s1", "s2")]
PAIRS += [(g, s) for g in ("sound", "deep") for s in ("s0", "s1", "s2")]


def test_a_reading_is_the_motion_plus_offset_plus_drift_since_the_zero():
    motion = cut((E,)).response(PAIRS).readings(TRUTH[:1])
    read = cut().response(PAIRS).readings(TRUTH)
    days = np.array([0.0, 30.0, 90.0])
    expected = motion.copy()
    expected[:3] += np.array([0.0, 4e-4, 4e-4]) + 2.0 * 2e-11 * days * DAY
    np.testing.assert_allclose(read, expected, rtol=1e-12, atol=1e-18)


def test_drift_per_stage_counts_stages():
    motion = cut((E,)).response(PAIRS).readings(TRUTH[:1])
    read = cut(per_stage=True).response(PAIRS).readings(np.array([3e9, 0.0, 1e-4]))
    np.testing.assert_allclose((read - motion)[:3], [0.0, 1e-4, 2e-4], atol=1e-16)


def test_a_reading_with_its_own_date_drifts_until_then():
    staged = cut()
    late = staged.response([("loose", "s1")] * 2, [None, 140 * DAY]).readings(TRUTH)
    assert late[1] - late[0] == pytest.approx(2.0 * 2e-11 * 10 * DAY, rel=1e-9)


def test_the_survey_takes_the_dates_of_the_readings():
    reading = Reading("loose", "s1", 1e-3, time=140 * DAY)
    plain, dated = (cut(readings=r).survey(TRUTH, fields=False) for r in ((), (reading,)))
    change = dated.computed - plain.computed
    assert change[0, 1] == pytest.approx(2.0 * 2e-11 * 10 * DAY, rel=1e-9)
    assert np.count_nonzero(np.nan_to_num(change)) == 1
    assert dated.sensitivity[0, 1, 2] == pytest.approx(2.0 * 40 * DAY)


@pytest.mark.parametrize("changes", [{"value": None}, {"bad": True}])
def test_a_reading_that_does_not_count_has_no_date(changes):
    reading = replace(Reading("loose", "s1", 1e-3, time=140 * DAY), **changes)
    plain, dated = (cut(readings=r).survey(TRUTH, fields=False) for r in ((), (reading,)))
    np.testing.assert_array_equal(dated.computed, plain.computed)


def test_without_a_date_a_drifting_gauge_has_no_reading():
    dates = {stage: time for stage, time in DATES.items() if stage != "s2"}
    computed = cut(dates=dates).survey(TRUTH, fields=False).computed
    assert np.isnan(computed[0, 2])
    assert np.isfinite(computed[1:, 2]).all()


@pytest.mark.parametrize("per_stage", [False, True])
def test_derivatives_are_exact(per_stage):
    staged, p = cut(per_stage=per_stage), TRUTH * [1, 1, 5e6 if per_stage else 1]
    response = staged.response(PAIRS)
    assert_exact(response, p, ("E", "off", "drift"))
    jacobian = response.evaluate(p)[1]
    found = staged.survey(p, fields=False).sensitivity.reshape(-1, 3)
    np.testing.assert_allclose(found, jacobian, rtol=1e-9, atol=1e-20)
    assert jacobian[1, 1] == 1.0


@pytest.mark.parametrize("method", [GaussNewtonOptions(), CondensationOptions()])
def test_modulus_offset_and_drift_are_identified_together(method):
    response = cut().response(PAIRS)
    measured = response.readings(TRUTH)
    problem = Problem(response, measured, np.full(len(PAIRS), 1e-5), (E, OFF, DRIFT))
    outcome = identify(problem, [method], lambda i: None)
    assert outcome.status == "converged"
    np.testing.assert_allclose(outcome.values, TRUTH, rtol=1e-6)


def test_load_cases_on_the_side_are_no_stages_of_a_drift():
    """s1, two load cases on it, s2: the drift reaches s2 after two stages, each case after two."""
    rock = regroup(box("quad4", (2, 2)))
    channel = replace(
        displacement("g", (0.5, 0.5), (1.0, 0.0)), drift_per_stage=Scalar(1.0, "drift")
    )
    staged = model(
        rock,
        parameters=(Parameter("drift", 1e-3, 0, 1),),
        materials={"rock": material("rock", 1e9, 0.2)},
        groups={"rock": "rock"},
        supports=rollers(2),
        stages=(
            Stage("s1"),
            Stage("lc1", independent=True),
            Stage("lc2", independent=True),
            Stage("s2"),
        ),
        channels=(channel,),
    )
    response = staged.response([("g", s) for s in ("s1", "lc1", "lc2", "s2")])
    np.testing.assert_allclose(response.readings(np.array([1e-3])), [1e-3, 2e-3, 2e-3, 2e-3])

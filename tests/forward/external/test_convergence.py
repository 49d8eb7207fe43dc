"""The convergence law of Sulem, Panet and Guenot: by hand, its derivatives and its limits."""

import numpy as np
import pytest
from support.convergence import CASE, FIXED, READ, STAGES, TRUTH, write_law

from geoident.workflow.running.jobs import build_model, load_inputs

CREEP = "  m: $m\n  T: $T\n  n: $n\n"
OF_CREEP = ("  m: {start", "  T: {start", "  n: {start", "dates:")


def model_of(folder, text=CASE):
    return build_model(load_inputs(str(write_law(folder, text))))


def without_time():
    """The case without growth in time."""
    lines = CASE.replace(CREEP, "").splitlines(keepends=True)
    return "".join(line for line in lines if not line.startswith(OF_CREEP))


def test_its_numbers_are_those_of_the_formula_by_hand(tmp_path, verification):
    """C_inf 30 mm, X 9 m, m 1.6, T 3 days, n 1/2; the face 3, 9, 9, 27 m ahead.

    3 m, 0 days: 30 (1 - (9/12)^2) = 13.125, which is lost; 9 m, 3 days:
    30 (3/4) (1 + 1.6 (1 - sqrt(1/2))); 9 m, 9 days: 30 (3/4) (1 + 1.6 (1 - 1/2)) = 40.5;
    27 m, 9 days: 30 (15/16) 1.8 = 50.625.
    """
    model = model_of(tmp_path)
    p = np.array(TRUTH)
    found = model.response([("H", name) for name in list(STAGES)[1:4]]).readings(p)
    exact = 1e-3 * (np.array([33.0441559, 40.5, 50.625]) - 13.125)
    np.testing.assert_allclose(found, exact, rtol=1e-8)
    half = model.response([("V", name) for name in list(STAGES)[1:4]]).readings(p)
    np.testing.assert_allclose(half, 0.5 * exact, rtol=1e-8)
    np.testing.assert_allclose(model.lost(p).value, [13.125e-3, 6.5625e-3], rtol=1e-12)
    np.testing.assert_allclose(model.final(p).value, [78e-3, 39e-3], rtol=1e-12)
    places = ["9 m, 3 days", "9 m, 9 days", "27 m, 9 days"]
    verification("convergence-law", "", places, exact=exact, found=found)


def test_its_derivatives_are_exact(tmp_path):
    model = model_of(tmp_path)
    response = model.response([(gauge, stage) for gauge in "HV" for stage in READ])
    p = np.array(TRUTH) * [1.1, 0.8, 0.7, 1.3, 0.9]
    found, jacobian = response.evaluate(p)
    np.testing.assert_array_equal(found, response.readings(p))
    ends = [(model.lost(p), model.lost), (model.final(p), model.final)]
    for j, h in enumerate(1e-3 * p):
        steps = [p + k * h * np.eye(5)[j] for k in (-2, -1, 1, 2)]

        def slope(of, steps=steps, h=h):
            a, b, c, d = (of(q) for q in steps)
            return (a - 8 * b + 8 * c - d) / (12 * h)

        other = slope(response.readings)
        np.testing.assert_allclose(jacobian[:, j], other, rtol=1e-6, atol=1e-6 * abs(other).max())
        for dual, of in ends:
            other = slope(lambda q, of=of: of(q).value)
            np.testing.assert_allclose(dual.columns[:, 1 + j], other, rtol=1e-6, atol=1e-12)


def test_far_from_the_face_and_after_long_it_is_the_final_convergence(tmp_path):
    text = CASE.replace("later: 300 m", "later: 100000 km")
    text = text.replace("later: 2024-07-01", "later: 9000-01-01").replace(
        "zero: first", "zero: virgin"
    )
    model = model_of(tmp_path, text)
    p = np.array([*TRUTH[:4], 1.0])
    found = model.response([("H", "later"), ("V", "later")]).readings(p)
    np.testing.assert_allclose(found, model.final(p).value, rtol=1e-5)
    assert model.lost(p).value.tolist() == [0.0, 0.0]


def test_without_growth_in_time_it_is_the_elastic_part_and_needs_no_dates(tmp_path):
    elastic = model_of(tmp_path, without_time())
    pairs = [("H", stage) for stage in READ]
    p = np.array(TRUTH)
    x, X = np.array([9.0, 9.0, 27.0, 33.0, 60.0]), 9.0
    exact = 30e-3 * ((X / 12.0) ** 2 - (X / (x + X)) ** 2)
    found = elastic.response(pairs).readings(p[:2])
    np.testing.assert_allclose(found, exact, rtol=1e-12)
    assert found[0] == found[1]  # the face stands still
    whole = model_of(tmp_path)
    np.testing.assert_allclose(
        whole.response(pairs).readings(p * [1, 1, 0, 1, 1]), exact, rtol=1e-12
    )


def test_a_face_that_stands_still_leaves_the_growth_in_time(tmp_path):
    found = model_of(tmp_path).response([("H", "second"), ("H", "third")]).readings(np.array(TRUTH))
    assert found[1] - found[0] == pytest.approx(22.5e-3 * 1.6 * (np.sqrt(0.5) - 0.5), rel=1e-12)


def test_a_tunnel_is_driven_both_ways_and_passes_a_section_between_two_stages(tmp_path):
    """The face at 106 m on 1 March and at 97 m on 4 March passes 100 m after two days."""
    text = CASE.replace("first: 103 m", "first: 106 m").replace(", excavated: 2024-03-01", "")
    ways = {"second: 109 m": "97 m", "third: 109 m": "97 m", "fourth: 127 m": "73 m",
            "fifth: 133 m": "67 m", "sixth: 160 m": "40 m", "later: 300 m": "-100 m"}  # fmt: skip
    for old, new in ways.items():
        text = text.replace(old, f"{old.partition(':')[0]}: {new}")
    model = model_of(tmp_path, text.replace("zero: first", "zero: second"))
    law = model.law
    assert np.isnan(law.distance[0]).all()
    assert law.distance[1:4, 0].tolist() == [3.0, 3.0, 27.0]
    np.testing.assert_allclose(law.age[1:3, 0] / 86400, [1.0, 7.0], rtol=1e-9)


def test_a_law_without_gauges_is_a_case_too(tmp_path):
    text = CASE.partition("gauges:")[0].replace("C_inf: {H: $C, V: 0.5 $C}", "C_inf: $C")
    model = model_of(tmp_path, text)
    assert model.survey(np.array(TRUTH), fields=False).computed.shape == (0, 7)
    assert model.final(np.array(TRUTH)).value.shape == (0,)


def test_the_fixed_exponent_is_no_parameter(tmp_path):
    model = model_of(tmp_path, FIXED)
    pairs = [("H", "fifth")]
    whole = model_of(tmp_path).response(pairs).readings(np.array(TRUTH))
    np.testing.assert_array_equal(model.response(pairs).readings(np.array(TRUTH[:4])), whole)

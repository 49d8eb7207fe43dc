"""Settlement laws: closed forms of others, by hand, derivatives and limits."""

from datetime import date, timedelta

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import erfc
from support.drains import resistance

from geoident.io.case.file import parse_case
from geoident.workflow.running.jobs import build_model, load_inputs

BEGIN = date(2024, 1, 1)
YEAR = 365.25


def day(number):
    return (BEGIN + timedelta(days=number)).isoformat()


CURVE = """\
format: geoident-case/1
model: {{kind: settlement-law, law: {law}, since: 2024-01-01, S: $S, T: $T, forecast: [{days}]}}
parameters:
  S: {{start: 400 mm, bounds: [1 mm, 5 m], scale: log}}
  T: {{start: 90 days, bounds: [1 days, 900 days], scale: log}}
gauges: {{P: {{kind: reading, accuracy: 2 mm}}}}
"""

CLAY = """\
format: geoident-case/1
model:
  kind: settlement-law
  law: consolidation
  fill: [{fill}]
  S: $S
{keys}
  forecast: [{days}]
parameters:
  S: {{start: 1 m, bounds: [1 mm, 50 m], scale: log}}
{parameters}
gauges: {{P: {{kind: reading, accuracy: 2 mm}}}}
"""


def model_of(tmp_path, text):
    path = tmp_path / "case.yaml"
    path.write_text(text)
    return build_model(load_inputs(str(path)))


def readings(model, p=None):
    """Readings of P at all days, m, at the start or other parameters."""
    start = [parameter.start for parameter in model.case.parameters]
    pairs = [("P", name) for name in model.case.stage_names[1:]]
    return model.response(pairs).readings(np.array(start if p is None else p, dtype=float))


def clay(days, keys, *, fill=None, parameters=""):
    """A case on clay, its days after the first lift."""
    keys = "\n".join(f"  {key}" for key in keys)
    fill = fill or f"{{date: {day(0)}, load: 50 kPa}}"
    days = ", ".join(map(day, days))
    return CLAY.format(fill=fill, keys=keys, days=days, parameters=parameters)


def test_asaokas_line_is_that_of_the_exponential(tmp_path):
    """At equal steps they lie on s_k+1 = b_0 + b_1 s_k, which ends in S = b_0 / (1 - b_1)."""
    days = range(0, 301, 30)
    model = model_of(tmp_path, CURVE.format(law="asaoka", days=", ".join(map(day, days))))
    s = readings(model)
    slope, start = np.polyfit(s[:-1], s[1:], 1)
    np.testing.assert_allclose(s[1:], start + slope * s[:-1], atol=1e-14)
    assert start / (1.0 - slope) == pytest.approx(0.4, rel=1e-12)
    assert -30.0 / np.log(slope) == pytest.approx(90.0, rel=1e-12)


def test_time_by_settlement_is_a_line_of_the_hyperbola(tmp_path):
    days = np.arange(20, 301, 40)
    model = model_of(
        tmp_path, CURVE.format(law="hyperbola", days=", ".join(map(day, map(int, days))))
    )
    s = readings(model)
    slope, start = np.polyfit(days, days / s, 1)
    assert 1.0 / slope == pytest.approx(0.4, rel=1e-10)
    assert start / slope == pytest.approx(90.0, rel=1e-10)


def one_dimensional(T):
    """Degree of consolidation at time factors T by images (Carslaw and Jaeger), not by modes."""
    T = np.asarray(T, dtype=float)
    n = np.arange(1, 40)
    x = n / np.sqrt(T)[..., None]
    integrated = np.exp(-(x**2)) / np.sqrt(np.pi) - x * erfc(x)
    return (
        2.0 * np.sqrt(T) * (1.0 / np.sqrt(np.pi) + 2.0 * np.sum((-1.0) ** n * integrated, axis=-1))
    )


def test_one_way_of_drainage_is_terzaghis(tmp_path, verification):
    days = [1, 5, 20, 60, 150, 365, 800]
    found = readings(model_of(tmp_path, clay(days, ["c_v: 4 m2/year", "path: 3 m"])))
    T = 4.0 / 9.0 * np.array(days) / YEAR
    exact = one_dimensional(T)
    np.testing.assert_allclose(found, exact, rtol=2e-4)
    verification("settlement-terzaghi", "", T, exact=exact, found=found)


def barron(n, T):
    """Degree of consolidation of a drain with equal strain (Barron 1948) by its definition."""
    F = n**2 / (n**2 - 1.0) * np.log(n) - (3.0 * n**2 - 1.0) / (4.0 * n**2)
    return 1.0 - np.exp(-8.0 * np.asarray(T) / F)


@pytest.mark.parametrize("n", [5, 20])
def test_drains_are_barrons(tmp_path, n, verification):
    """Diameters around drains of 1.05 and 1.13 spacings; T_h = c_h t / D^2."""
    around = 1.05 if n == 5 else 1.13
    pattern = "triangle" if n == 5 else "square"
    days = [7, 30, 90, 300]
    keys = [f"drains: {{c_h: 3 m2/year, spacing: 1.4 m, pattern: {pattern}, "
            f"diameter: {1.4 * around / n} m}}"]  # fmt: skip
    found = readings(model_of(tmp_path, clay(days, keys)))
    T = 3.0 * np.array(days) / YEAR / (1.4 * around) ** 2
    np.testing.assert_allclose(found, barron(n, T), rtol=1e-10)
    verification("settlement-drains", f"D = {n} d", T, exact=barron(n, T), found=found)


def test_both_ways_go_together_as_carrillo_says_and_smear_as_hansbo(tmp_path):
    """1 - U = (1 - U_v) (1 - U_h); mu by its definition."""
    days = [20, 100, 400]
    drains = (
        "drains: {c_h: 3 m2/year, spacing: 1.4 m, diameter: 70 mm, smear: 210 mm, smear_ratio: 3}"
    )
    found = readings(model_of(tmp_path, clay(days, [drains, "c_v: 2 m2/year", "path: 4 m"])))
    D = 1.4 * 1.05
    mu = resistance(D, 0.07, 0.21, 3.0)
    t = np.array(days) / YEAR
    left = (1.0 - one_dimensional(2.0 * t / 16.0)) * np.exp(-8.0 * 3.0 * t / D**2 / mu)
    np.testing.assert_allclose(found, 1.0 - left, rtol=1e-4)


def olson(T, placed):
    """Degree of consolidation, the load growing until the time factor `placed` (Olson 1977)."""
    M = 0.5 * np.pi * (2.0 * np.arange(2000) + 1.0)
    if placed >= T:
        return T / placed * (1.0 - 2.0 / T * np.sum((1.0 - np.exp(-(M**2) * T)) / M**4))
    later = np.exp(-(M**2) * (T - placed)) - np.exp(-(M**2) * T)
    return 1.0 - 2.0 / placed * np.sum(later / M**4)


def test_a_lift_that_takes_time_is_olsons(tmp_path, verification):
    days = [20, 80, 150, 160, 300, 700]
    fill = f"{{date: {day(0)}, load: 50 kPa, lasts: 150 days}}"
    found = readings(model_of(tmp_path, clay(days, ["c_v: 4 m2/year", "path: 3 m"], fill=fill)))
    by_day = 4.0 / 9.0 / YEAR
    exact = [olson(by_day * t, by_day * 150.0) for t in days]
    np.testing.assert_allclose(found, exact, rtol=2e-4)
    T = by_day * np.array(days)
    verification("settlement-ramp", "", T, exact=exact, found=found)


def test_lifts_are_superposed_each_by_its_own_time(tmp_path):
    """By load 1/4 and 3/4; by the logarithm of stress ln(30/20) and ln(60/30) of ln(60/20)."""
    fill = f"{{date: {day(0)}, height: 0.5 m}}, {{date: {day(90)}, height: 2 m}}"
    days, keys = [45, 120, 500], ["c_v: 4 m2/year", "path: 3 m"]
    by_day = 4.0 / 9.0 / YEAR

    def after(t):
        return one_dimensional(by_day * np.maximum(np.array(days) - t, 1e-12))

    found = readings(model_of(tmp_path, clay(days, keys, fill=fill)))
    np.testing.assert_allclose(found, 0.25 * after(0) + 0.75 * after(90), rtol=3e-4)
    keys += ["stress: 20 kPa", "unit_weight: 20 kN/m3"]
    found = readings(model_of(tmp_path, clay(days, keys, fill=fill)))
    first = np.log(1.5) / np.log(3.0)
    np.testing.assert_allclose(found, first * after(0) + (1.0 - first) * after(90), rtol=3e-4)


def test_drains_that_come_later_act_from_then_on(tmp_path):
    """A lift over 100 days with drains on day 40 is the mean of many that are placed at once."""
    drains = f"drains: {{c_h: 3 m2/year, spacing: 1.4 m, diameter: 70 mm, installed: {day(40)}}}"
    days, keys = [30, 70, 130, 300], [drains, "c_v: 2 m2/year", "path: 4 m"]
    fill = f"{{date: {day(0)}, load: 50 kPa, lasts: 100 days}}"
    found = readings(model_of(tmp_path, clay(days, keys, fill=fill)))
    D = 1.4 * 1.05
    mu = -8.0 / np.log(1.0 - barron(D / 0.07, 1.0))

    def left(t, placed):
        if placed >= t:
            return 1.0
        drained = np.exp(-8.0 * 3.0 * max(t - max(placed, 40.0), 0.0) / YEAR / D**2 / mu)
        return (1.0 - one_dimensional(2.0 * (t - placed) / YEAR / 16.0)) * drained

    for t, value in zip(days, found, strict=True):
        inner = [x for x in (40.0, t) if x < 100.0]
        whole, _ = quad(lambda x, t=t: 1.0 - left(t, x), 0.0, 100.0, points=inner, limit=200)
        assert value == pytest.approx(whole / 100.0, rel=3e-4)


def test_creep_grows_with_the_logarithm_of_time(tmp_path):
    """S C log10(1 + t / T) of a lift at once; of one that takes time its mean."""
    days = [10, 90, 2000]
    keys = [
        "c_v: 5000 m2/year",
        "path: 1 m",
        "creep: 0.05",
        "creep_time: 30 days",
        "until: 2060-01-01",
    ]
    found = readings(model_of(tmp_path, clay(days, keys)))
    np.testing.assert_allclose(found, 1.0 + 0.05 * np.log10(1.0 + np.array(days) / 30.0), rtol=1e-6)
    fill = f"{{date: {day(0)}, load: 50 kPa, lasts: 60 days}}"
    found = readings(model_of(tmp_path, clay([90, 2000], keys, fill=fill)))
    for t, value in zip([90, 2000], found, strict=True):
        mean, _ = quad(lambda x, t=t: np.log10(1.0 + (t - x) / 30.0) / 60.0, 0.0, 60.0)
        assert value == pytest.approx(1.0 + 0.05 * mean, rel=1e-6)


ALL = [
    "c_v: $c_v",
    "path: $h",
    "stress: $q",
    "creep: $C",
    "creep_time: $t",
    "until: 2060-01-01",
    "drains: {c_h: $c_h, spacing: 1.4 m, diameter: 70 mm, smear: 200 mm, smear_ratio: $k, "
    f"installed: {day(40)}}}",
]
PARAMETERS = """\
  c_v: {start: 2 m2/year, bounds: [0.1 m2/year, 90 m2/year], scale: log}
  h: {start: 4 m, bounds: [1 m, 20 m]}
  q: {start: 30 kPa, bounds: [5 kPa, 200 kPa]}
  C: {start: 0.05, bounds: [0, 0.3]}
  t: {start: 20 days, bounds: [1 days, 200 days]}
  c_h: {start: 4 m2/year, bounds: [0.1 m2/year, 90 m2/year], scale: log}
  k: {start: 2, bounds: [1, 6]}"""


@pytest.mark.parametrize("law", ["asaoka", "hyperbola", "consolidation"])
def test_derivatives_are_exact(tmp_path, law):
    days = [5, 30, 60, 110, 400]
    text = CURVE.format(law=law, days=", ".join(map(day, days)))
    if law == "consolidation":
        fill = (
            f"{{date: {day(0)}, load: 20 kPa}}, {{date: {day(25)}, load: 35 kPa, lasts: 30 days}}, "
            f"{{date: {day(100)}, load: 60 kPa, lasts: 20 days}}"
        )
        text = clay(days, ALL, fill=fill, parameters=PARAMETERS)
    model = model_of(tmp_path, text)
    p = np.array([parameter.start for parameter in model.case.parameters])
    response = model.response([("P", name) for name in model.case.stage_names[1:]])
    found, jacobian = response.evaluate(p)
    np.testing.assert_array_equal(found, response.readings(p))
    assert np.abs(jacobian).max(axis=0).min() > 0.0
    for j, h in enumerate(2e-3 * p):
        a, b, c, d = (response.readings(p + k * h * np.eye(len(p))[j]) for k in (-2, -1, 1, 2))
        other = (a - 8 * b + 8 * c - d) / (12 * h)
        np.testing.assert_allclose(jacobian[:, j], other, rtol=1e-7, atol=1e-7 * abs(other).max())


def test_gauges_that_stand_on_different_fills_have_their_own(tmp_path):
    text = f"""\
format: geoident-case/1
model:
  kind: settlement-law
  law: consolidation
  fill:
    P: [{{date: {day(0)}, height: 1 m}}]
    Q: [{{date: {day(0)}, height: 1 m}}, {{date: {day(60)}, height: 3 m}}]
  S: {{P: $S, Q: 2 $S}}
  c_v: 4 m2/year
  path: {{P: 3 m, Q: 6 m}}
  forecast: [{day(50)}, {day(200)}]
parameters:
  S: {{start: 1 m, bounds: [1 mm, 50 m], scale: log}}
gauges:
  P: {{kind: reading, accuracy: 2 mm}}
  Q: {{kind: reading, accuracy: 2 mm}}
"""
    model = model_of(tmp_path, text)
    pairs = [(gauge, day(t)) for gauge in "PQ" for t in (50, 200)]
    found = model.response(pairs).readings(np.array([1.0]))
    P, Q = (4.0 / h**2 / YEAR for h in (3.0, 6.0))
    exact = [
        *one_dimensional(P * np.array([50.0, 200.0])),
        2.0 / 3.0 * one_dimensional(Q * 50.0),
        2.0 * (one_dimensional(Q * 200.0) / 3.0 + 2.0 / 3.0 * one_dimensional(Q * 140.0)),
    ]
    np.testing.assert_allclose(found, exact, rtol=5e-4)


def test_a_fill_is_read_from_a_table(tmp_path):
    (tmp_path / "fill.csv").write_text(f"date,thickness (m)\n{day(0)},0.5\n{day(90)},2\n")
    rows = f"{{date: {day(0)}, height: 0.5 m}}, {{date: {day(90)}, height: 2 m}}"
    text = clay([45, 300], ["c_v: 4 m2/year", "path: 3 m"], fill=rows)
    listed = readings(model_of(tmp_path, text))
    text = text.replace(f"[{rows}]", "{file: fill.csv, height: thickness}")
    np.testing.assert_array_equal(readings(model_of(tmp_path, text)), listed)


def test_before_the_first_lift_there_is_no_settlement(tmp_path):
    text = clay([10], ["c_v: 4 m2/year", "path: 3 m"]).replace(
        "accuracy: 2 mm", f"accuracy: 2 mm, zero: {day(-20)}"
    )
    case = parse_case(text, str(tmp_path / "case.yaml")).case
    assert case.stage_names[1] == day(-20)
    assert readings(model_of(tmp_path, text))[1] > 0.0

"""The numbers that a fit tells, calculated once more: from computed readings alone.

The readings at other parameters come from `simulate`; derivatives are their differences, and all
that follows is linear least squares in ln E and K0 by the books.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm
from support.commands import run_command
from support.trench import CASE, READINGS, write_case

from tests.support.commands import said_findings

ACCURACY = 0.01e-3
QUANTILE = norm.ppf(0.975)
MISFIT = "The model does not fit the readings"


def _computed(case: Path, E: float, K0: float) -> np.ndarray:
    """(6,) readings, m: three of each stage."""
    start = [f"parameters.E.start={E:.17g} Pa", f"parameters.K0.start={K0:.17g}"]
    sets = [word for text in start for word in ("--set", text)]
    found = json.loads(run_command("simulate", str(case), "--json", "-q", *sets).stdout)
    return np.array([reading["value"] for reading in found["readings"]])


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """What the fit tells, and the derivatives (6, 2) of the readings with ln E and K0 there."""
    case = write_case(tmp_path_factory.mktemp("told"))
    fit = json.loads(run_command("fit", str(case), "--json", "-q").stdout)
    E, K0 = (fit["parameters"][name]["value"] for name in ("E", "K0"))
    h = 1e-4
    columns = [
        _computed(case, E * np.exp(h), K0) - _computed(case, E * np.exp(-h), K0),
        _computed(case, E, K0 + h) - _computed(case, E, K0 - h),
    ]
    return fit, _computed(case, E, K0), np.stack(columns, axis=1) / (2 * h)


def _covariance(jacobian: np.ndarray) -> np.ndarray:
    """(2, 2) of ln E and K0 from the three readings of the first stage."""
    return np.linalg.inv(jacobian[:3].T @ jacobian[:3] / ACCURACY**2)


def test_discrepancy_is_the_sum_of_squared_residuals_in_accuracies(told):
    fit, computed, _ = told
    measured = [float(row.split(",")[2]) * 1e-3 for row in READINGS.splitlines()[1:4]]
    expected = np.sum(((np.array(measured) - computed[:3]) / ACCURACY) ** 2)
    assert fit["objective"] == pytest.approx(expected, rel=1e-8)


def test_intervals_of_parameters_are_1_96_deviations_to_both_sides(told):
    fit, _, jacobian = told
    sd = np.sqrt(np.diag(_covariance(jacobian)))
    E, K0 = (fit["parameters"][name] for name in ("E", "K0"))
    assert E["sd"] == pytest.approx(E["value"] * sd[0], rel=1e-5)
    assert E["lower95"] == pytest.approx(E["value"] * np.exp(-QUANTILE * sd[0]), rel=1e-5)
    assert E["upper95"] == pytest.approx(E["value"] * np.exp(QUANTILE * sd[0]), rel=1e-5)
    assert K0["sd"] == pytest.approx(sd[1], rel=1e-5)
    assert K0["lower95"] == pytest.approx(K0["value"] - QUANTILE * sd[1], rel=1e-5)
    assert K0["upper95"] == pytest.approx(K0["value"] + QUANTILE * sd[1], rel=1e-5)


def test_bands_of_predictions_are_1_96_deviations_to_both_sides(told):
    fit, computed, jacobian = told
    later = jacobian[3:]
    sd = np.sqrt(np.diag(later @ _covariance(jacobian) @ later.T) + ACCURACY**2)
    assert [p["gauge"] for p in fit["predictions"]] == ["CV", "S", "X.a"]
    for name, expected in (
        ("mean", computed[3:]),
        ("sd", sd),
        ("lower95", computed[3:] - QUANTILE * sd),
        ("upper95", computed[3:] + QUANTILE * sd),
    ):
        given = [prediction[name] for prediction in fit["predictions"]]
        np.testing.assert_allclose(given, expected, rtol=1e-5, err_msg=name)


@pytest.mark.parametrize(
    "off", [1.95, -1.97, *(pytest.param(off, marks=pytest.mark.slow) for off in (-1.95, 1.97))]
)
def test_a_reading_is_inside_its_band_up_to_1_96_deviations(told, tmp_path, off):
    """The sentence that counts, for one reading of the second stage put near an end of its band."""
    fit, _, _ = told
    CV = fit["predictions"][0]
    value = (CV["mean"] + off * CV["sd"]) * 1e3
    case = write_case(tmp_path)
    moved = READINGS.replace("CV,second,-1.077", f"CV,second,{value!r}")
    case.with_name("readings.csv").write_text(moved)
    again = json.loads(run_command("fit", str(case), "--json", "-q").stdout)
    (note,) = [note for note in again["notes"] if note.startswith("Predicted stage")]
    others = [(p["measured"] - p["mean"]) / p["sd"] for p in fit["predictions"][1:]]
    rms = np.sqrt(np.mean(np.square([off, *others])))
    count = 3 if abs(off) < QUANTILE else 2
    assert note == (
        f"Predicted stage 'second': {count} of 3 readings inside the 95 % band"
        f" ({100 * count / 3:.0f} %), RMS of the standardized residuals {rms:.2f}."
    )


@pytest.mark.parametrize(
    "times", [2.5, 2.65, 3.85, 3.93, pytest.param(12.0, marks=pytest.mark.slow)]
)
def test_residuals_that_errors_do_not_explain_have_consequences(told, tmp_path, times):
    """Three readings less two parameters leave one degree of freedom: a normal variable."""
    fit, _, _ = told
    accuracy = 0.01 * np.sqrt(fit["objective"]) / times
    case = write_case(tmp_path)
    case.write_text(CASE.replace("accuracy: 0.01 mm", f"accuracy: {accuracy:.12g} mm"))
    run = run_command("fit", str(case), "--json", "-q")
    found = json.loads(run.stdout)
    chance = 2.0 * norm.sf(times)
    assert found["diagnostics"]["misfit"] == pytest.approx(times, rel=1e-6)
    assert found["diagnostics"]["above"] == pytest.approx(chance, rel=1e-5)
    poor = chance < 1e-4
    assert (MISFIT in found["reason"]) == poor
    shown = f"{times:.1f}" if times < 10.0 else f"{times:.3g}"
    told_so = f"{shown} times as large as the stated accuracies explain"
    assert (told_so in found["reason"]) == poor
    assert any(told_so in text for text in said_findings(found)) == (chance < 0.01)
    assert found["status"] == ("poor-fit" if poor else "converged")
    assert run.exit_code == (4 if poor else 0)

"""Fits of many channels: as exact as with few, in little memory, or refused before computing."""

import json

import h5py
import numpy as np
import pytest

from geoident.workflow.estimating import model_error, model_error_covariance
from tests.support.commands import run_command, said_findings
from tests.support.many_channels import cost_of_fit, write_many_channels


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """300 channels in two stages, and a third one to be predicted."""
    folder = tmp_path_factory.mktemp("many")
    return write_many_channels(folder, 300, 2, elements=(30, 25))


QUICK = ("--set", "fit.mesh_error=false", "--set", "fit.backtest=false")


def fitted(case, *more):
    """Parameters, half widths and bands of a fit that was made anew."""
    done = run_command("fit", case, "--fresh", "--force", "--json", *QUICK, *more)
    assert done.exit_code == 0, done.output
    with h5py.File(case.with_name("case.fit.h5")) as found:
        low, high = np.log(found["parameters/ci95"][()]).T
        bands = found["prediction/mean"][:, 2], found["prediction/sd"][:, 2]
        value = np.log(found["parameters/value"][()])
    return value, 0.5 * (high - low), *bands, json.loads(done.stdout)


@pytest.mark.slow  # two large fits
def test_what_is_approximated_of_many_readings_moves_no_answer(case, monkeypatch):
    """600 readings with 150 columns of their model error, and with all of them."""
    value, half, mean, sd, _ = fitted(case)
    monkeypatch.setattr(model_error_covariance, "MOST_MODES", 150)
    other, width, there, spread, said = fitted(case)
    assert np.abs(other - value).max() > 0.0  # it is another computation
    assert np.all(np.abs(other - value) < 0.1 * half)
    np.testing.assert_allclose(width, half, rtol=0.05)
    assert np.abs(there - mean).max() < 0.1 * sd.max()
    np.testing.assert_allclose(spread, sd, rtol=0.05)
    assert not any("too many for the full model error" in text for text in said_findings(said))


def test_points_that_stand_too_densely_are_said(case, monkeypatch):
    monkeypatch.setattr(model_error_covariance, "MOST_MODES", 12)
    *_, said = fitted(case, "--set", "fit.model_error=30 %")
    (found,) = (text for text in said_findings(said) if "too many for the full model error" in text)
    assert found.startswith("600 readings are too many for the full model error")
    assert "every fifth" in found


def test_too_many_readings_are_refused_before_anything_is_computed(case, monkeypatch):
    monkeypatch.setattr(model_error, "MOST_MODES", 100)
    monkeypatch.setattr(model_error, "free_memory", lambda: 1e6)
    done = run_command("fit", case, "--fresh", "--force")
    assert done.exit_code == 3, done.output
    assert "600 readings of 300 channels need about 0." in done.output
    assert "0.0 GB are free, and 1 min" in done.output
    assert "every tenth" in done.output
    assert "'model_error: none'" in done.output
    monkeypatch.setattr(model_error, "free_memory", lambda: None)
    monkeypatch.setattr(model_error, "most_modes", lambda readings: 99)
    done = run_command("fit", case, "--fresh", "--force")
    assert "more than 160000 readings allow" in " ".join(done.output.split())


@pytest.mark.slow
def test_ten_thousand_channels_in_five_stages(tmp_path):
    """All that a fit does, in 4 GB; sixteen times the channels take 20 times as long at most.

    Quick: `test_what_is_approximated_of_many_readings_moves_no_answer`.
    """
    few, _ = cost_of_fit(write_many_channels(tmp_path / "few", 625, 5))
    many, memory = cost_of_fit(write_many_channels(tmp_path / "many", 10_000, 5))
    assert memory < 4e9
    assert many < 20.0 * few


def test_the_screen_shows_the_readings_that_are_farthest_off(case):
    fitted(case, "--set", "fit.model_error=none")
    shown = run_command("show", case.with_name("case.fit.h5")).output
    assert "the 300 of 600 that are farthest off; the result file has all" in shown
    table = shown[shown.index("Readings (") : shown.index("Most influential")].splitlines()
    rows = [line.split() for line in table if line.startswith("L.P")]
    assert len(rows) == 300
    with h5py.File(case.with_name("case.fit.h5")) as found:
        far = np.abs(found["diagnostics/standardized"][()])
        assert far.size == 900  # of the stage that is predicted, too
    least = min(abs(float(row[5])) for row in rows)
    assert least == pytest.approx(np.sort(far[np.isfinite(far)])[-300], abs=0.051)

"""Minima nearly as low as the answer are named, and nothing is said as if they were not there."""

from __future__ import annotations

import json

import numpy as np
import pytest
from support.commands import run_command
from support.strata import TRUTH, write_case, write_readings

from geoident.io.result.file import read_result
from geoident.model.results.findings import sentences_of
from geoident.model.results.rivals import Rivals
from geoident.report.text.result import result_text

FEW = ("h", "v", "d1", "d2", "d3")
SECOND = {**TRUTH, "dip": np.radians(52.4), "K0": 1.4}


@pytest.fixture(scope="module")
def tension_limit(tmp_path_factory):
    """A fit whose five readings two or three attitudes of the strata meet alike."""
    case = write_case(tmp_path_factory.mktemp("torn"), gauges=FEW)
    write_readings(case, SECOND, seed=5)
    ended = run_command("fit", str(case), "--json")
    return case.with_name("case.fit.h5"), ended.exit_code, json.loads(ended.stdout)


def test_a_rival_of_like_odds_is_named_and_leaves_the_dip_undetermined(tension_limit):
    path, code, told = tension_limit
    result = read_result(path)
    rivals = result.rivals
    assert code == 4
    assert result.status == "not-determined"
    assert len(rivals) >= 2
    assert np.all(rivals.objectives - rivals.objectives[0] <= 4.0)
    assert rivals.odds.sum() == pytest.approx(1.0)
    truth = np.array(list(SECOND.values()))
    sd = np.sqrt(np.diagonal(rivals.covariance, axis1=1, axis2=2))
    assert np.any(np.all(np.abs(rivals.values - truth) < 3.0 * sd, axis=1))  # one of them is right
    assert not result.parameters.determined[2]
    assert np.isnan(result.parameters.upper95[2])
    (said,) = [text for text in sentences_of(result.findings) if "nearly as low" in text]
    assert "dip" in said
    assert "odds" in said
    assert told["parameters"]["dip"]["value"] is None
    assert len(told["rivals"]) == len(rivals)
    assert "rival 1" in result_text(result)


def test_predictions_hold_what_each_of_the_minima_lets_expect(tension_limit):
    path, _, _ = tension_limit
    result = read_result(path)
    second = result.gauges.stages.index("second")
    band = result.prediction.upper95[:, second] - result.prediction.lower95[:, second]
    normal = 2 * 1.96 * result.prediction.sd[:, second]
    assert np.all(np.abs(band - normal) < normal)  # finite, of the size of both together
    inside = (result.gauges.measured >= result.prediction.lower95) & (
        result.gauges.measured <= result.prediction.upper95
    )
    assert inside[:, second].mean() >= 0.8


def test_a_prediction_from_the_result_holds_the_minima_too(tension_limit):
    path, _, _ = tension_limit
    ended = run_command("predict", str(path), "--force")
    assert ended.exit_code == 0, ended.output
    one, other = (read_result(p).prediction for p in (path, path.with_name("case.predict.h5")))
    for name in ("mean", "sd", "lower95", "upper95"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-6)


def test_a_prediction_of_another_case_holds_the_minima_too(tension_limit, tmp_path):
    """The same ground in a copy of the case: predictions are as uncertain as in the case.

    But for what lies along a bound, which is followed in the case of the fit alone.
    """
    path, _, _ = tension_limit
    for name in ("case.yaml", "adit.inp", "readings.csv"):
        (tmp_path / name).write_bytes((path.parent / name).read_bytes())
    text = (tmp_path / "case.yaml").read_text()
    (tmp_path / "case.yaml").write_text(text.replace("Adit in strata", "The same elsewhere"))
    new = tmp_path / "new.predict.h5"
    ended = run_command("predict", path, "--case", tmp_path / "case.yaml", "-o", new)
    assert ended.exit_code == 0, ended.output
    one, other = read_result(path), read_result(new)
    second = one.gauges.stages.index("second")
    mine, theirs = one.prediction, other.prediction
    np.testing.assert_allclose(theirs.mean[:, second], mine.mean[:, second], rtol=1e-6)
    np.testing.assert_allclose(theirs.sd[:, second], mine.sd[:, second], rtol=0.2)
    assert np.all(theirs.upper95[:, second] > theirs.mean[:, second])
    assert not any("nearly as low, which these bands leave out" in note for note in other.notes)


def test_where_the_mesh_of_the_fit_has_changed_it_is_said_that_minima_are_left_out(
    tension_limit, tmp_path
):
    path, _, _ = tension_limit
    for name in ("case.yaml", "adit.inp", "readings.csv", "case.fit.h5"):
        (tmp_path / name).write_bytes((path.parent / name).read_bytes())
    (tmp_path / "new.yaml").write_text(
        (tmp_path / "case.yaml").read_text().replace("adit.inp", "other.inp")
    )
    mesh = (tmp_path / "adit.inp").read_text()
    (tmp_path / "other.inp").write_text(mesh)
    (tmp_path / "adit.inp").write_text("** changed\n" + mesh)
    new = tmp_path / "new.predict.h5"
    fit = tmp_path / "case.fit.h5"
    ended = run_command("predict", fit, "--case", tmp_path / "new.yaml", "-o", new)
    assert ended.exit_code == 0, ended.output
    (note,) = [note for note in read_result(new).notes if "leave out" in note]
    assert "the mesh of the fit has changed" in note
    assert "too narrow" in note


def test_with_more_gauges_the_answer_is_settled(tmp_path):
    case = write_case(tmp_path)
    write_readings(case, SECOND, seed=5)
    ended = run_command("fit", str(case))
    result = read_result(case.with_name("case.fit.h5"))
    assert ended.exit_code == 0
    assert result.rivals is None
    assert "dip is an angle" in " ".join(result.notes)
    assert result.evidence.readings == 9


@pytest.mark.slow  # rivals as such: above
def test_rivals_are_those_of_the_accuracies_that_were_estimated(tmp_path):
    """Ten times too good accuracies put rivals hopelessly high; estimated, they come back."""
    stated = "{stages: [dig], model_error: none, mesh_error: false}"
    given = {"accuracy": "0.02 mm", "gauges": (*FEW, "e3")}
    case = write_case(tmp_path, fit=stated.replace("}", ", accuracies: estimate}"), **given)
    strict = write_case(tmp_path, fit=stated, name="stated.yaml", **given)
    truth = {**TRUTH, "dip": np.radians(-71.2), "K0": 0.84}
    write_readings(case, truth, seed=2, noise=10.0)
    ended = run_command("fit", str(case), "--json")
    told = json.loads(ended.stdout)
    result = read_result(case.with_name("case.fit.h5"))
    lowest = result.objective
    assert told["accuracies"][0]["factor"] is not None
    assert len(result.rivals) >= 2
    assert np.all(result.rivals.objectives >= lowest - 0.1)
    assert np.all(result.rivals.objectives <= lowest + 4.0)
    run_command("fit", strict)
    assert read_result(strict.with_name("stated.fit.h5")).rivals is None


def test_an_explicit_number_of_starts_is_a_key_of_the_case(tmp_path):
    fit = "{stages: [dig], mesh_error: false, model_error: none, gauss-newton: {starts: NUMBER}}"
    case = write_case(tmp_path, fit=fit.replace("NUMBER", "1"))
    write_readings(case, SECOND, seed=5)
    run_command("fit", str(case))
    notes = " ".join(read_result(case.with_name("case.fit.h5")).notes)
    assert "starts" not in notes
    write_case(tmp_path, fit=fit.replace("NUMBER", "automatic"), name="auto.yaml")
    assert run_command("check", str(tmp_path / "auto.yaml")).exit_code == 0
    write_case(tmp_path, fit=fit.replace("NUMBER", "many"), name="many.yaml")
    refused = run_command("check", str(tmp_path / "many.yaml"))
    assert refused.exit_code == 3
    assert "'many' is not a whole number from 1 on, or 'automatic'" in refused.stderr


def test_the_odds_of_one_minimum_are_settled_from_19_to_1_on():
    def pair(part):
        return Rivals(
            np.zeros((2, 1)), np.zeros(2), np.array([part, 1.0 - part]), np.ones((2, 1, 1))
        )

    assert pair(0.951).settled
    assert not pair(0.949).settled

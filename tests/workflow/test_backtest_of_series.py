"""A backtest of a series looks as far ahead as the prediction, and says what it tests."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from geoident.api import fit, load_case
from geoident.cli.app import geoident
from geoident.io.result.file import read_result
from tests.support.settlement_plates import days_of, hyperbola, measured, settlement, write_plate

DAY = 86400.0


def plate(folder, truth, *, fitted, more="", seed=1, count=24):
    """The path of a case whose fits make a backtest, and the days of its readings."""
    rng = np.random.default_rng(seed)
    days = days_of(rng, count)
    path = write_plate(folder, days, measured(rng, truth, days), fitted=fitted, more=more)
    path.write_text(path.read_text().replace("backtest: false", "backtest: true"))
    return path, days


def backtest_note(result):
    [text] = [
        text
        for text in (*result.notes, *(one.sentence for one in result.findings))
        if text.startswith("Backtest of ")
    ]
    return text


def test_it_looks_as_far_ahead_as_the_prediction(tmp_path):
    """What is left of some forty readings after thirty is predicted: as far ahead is tested."""
    path, days = plate(tmp_path, settlement(np.random.default_rng(101)), fitted=30, count=40)
    result = fit(load_case(str(path))).data
    end = days[29]
    reach, asked = result.backtest.reach, days[-1] - end
    assert reach.asked == pytest.approx(asked * DAY)
    begin = days[days <= end - asked][-1]
    assert result.gauges.stages[reach.step] == f"d{begin:.0f}"
    assert reach.far == pytest.approx((end - begin) * DAY)
    assert reach.readings == reach.stages == np.count_nonzero((days > begin) & (days <= end))
    assert 1.0 <= reach.independent < reach.readings
    text = backtest_note(result)
    assert f"from the readings up to d{begin:.0f}" in text
    assert f"{reach.readings} readings up to {end - begin:.3g} days ahead" in text
    assert "independent readings" in text
    assert "nothing tests it beyond" not in text


def test_what_no_fit_can_test_is_said(tmp_path):
    """Of 12 readings seven are needed for a model error: five are left to look ahead."""
    path, days = plate(tmp_path, settlement(np.random.default_rng(101)), fitted=12)
    result = fit(load_case(str(path))).data
    assert result.gauges.stages[result.backtest.reach.step] == f"d{days[6]:.0f}"
    asked, far = days[-1] - days[11], days[11] - days[6]
    said = f"The prediction looks {asked:.3g} days ahead: nothing tests it beyond {far:.3g} days."
    assert said in backtest_note(result)


def test_one_reading_says_that_it_says_nothing(tmp_path):
    """All is fitted, and so nothing is predicted: the last reading alone is left."""
    path, _ = plate(tmp_path, hyperbola(), fitted=24)
    text = backtest_note(fit(load_case(str(path))).data)
    assert "1 of 1 reading of the next stage is inside its band (100 %)" in text
    assert "So few say nothing of whether the 95 % bands hold." in text
    assert "bands hold: " not in text


def test_bands_that_hold_for_the_next_reading_only_do_not_hold(tmp_path):
    """A law without error: from reading to reading it is met, a hundred days ahead it is not."""
    truth = settlement(np.random.default_rng(101))
    path, _ = plate(tmp_path, truth, fitted=18, more=", model_error: none")
    ended = CliRunner().invoke(geoident, ["backtest", str(path)])
    assert ended.exit_code == 4, ended.output
    found = read_result(path.with_suffix(".backtest.h5"))
    assert found.status == "bands-fail"
    assert " days ahead are inside their bands" in found.reason
    horizons = found.backtest.horizons
    assert [(one.first, one.last) for one in horizons] == [
        (1, 1), (2, 3), (4, 7), (8, 15), (16, 23),
    ]  # fmt: skip
    coverage = [one.inside / one.readings for one in horizons]
    assert coverage[0] > 2.0 * coverage[3]
    shown = CliRunner().invoke(geoident, ["show", str(path.with_suffix(".backtest.h5"))]).output
    assert "Predictions by how far they look ahead" in shown
    as_json = CliRunner().invoke(
        geoident, ["show", str(path.with_suffix(".backtest.h5")), "--json"]
    )
    said = json.loads(as_json.output)["backtest"]
    assert [one["readings"] for one in said["horizons"]] == [one.readings for one in horizons]
    assert said["reach"]["inside"] == found.backtest.reach.inside


def test_stages_of_construction_are_tested_by_the_next(tmp_path):
    """Five stages that were read are no series, whatever is predicted."""
    path, _ = plate(tmp_path, hyperbola(), fitted=5, more=", model_error: 10 %")
    result = fit(load_case(str(path))).data
    assert result.backtest.reach is None
    assert result.backtest.horizons == ()
    assert "of the next stage" in backtest_note(result)

"""Readings, residuals, predictions and influence, against numbers worked out by hand.

The example has accuracies of 0.1 mm and predictions of sd 0.15 mm; EX-1.a8 at bench 1 is off by
0.8 mm.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from geoident.model.gauges import Reading
from geoident.model.results.model_error import ModelErrorTable
from geoident.report.text.csv_tables import csv_tables
from geoident.report.text.gauges import (
    fit_table,
    fit_title,
    prediction_table,
    reading_table,
    reading_text,
    readings_csv,
)
from geoident.report.text.residuals import (
    OUTLIER,
    diagnostics_object,
    in_sd_note,
    influence_table,
    influence_title,
    outliers,
    rms,
    scored,
    unexplained,
)
from geoident.report.text.result import result_text
from tests.support.cases import displacement
from tests.support.results import changed_gauges, example_result

FIRST, BENCH, LAST = 0, 1, 2


def rows(table):
    """(gauge, stage) to the cells of a row."""
    return {(row[0], row[1]): list(row[2:]) for row in table.rows}


def changed(result, name, place, value):
    """The result with one entry of its table of gauges changed."""
    values = getattr(result.gauges, name).copy()
    values[place] = value
    return replace(result, gauges=changed_gauges(result.gauges, **{name: values}))


def row(result, channel, stage):
    """The row of the only reading of a channel in a stage."""
    (found,) = result.gauges.rows[channel, stage]
    return found


@pytest.fixture(scope="module")
def result():
    return example_result()


def test_columns_have_their_names(result):
    first = ("gauge", "stage")
    assert [tuple(table(result).header) for table in (
        fit_table, prediction_table, reading_table, influence_table,
    )] == [
        (*first, "measured", "computed", "residual", "in sd", ""),
        (*first, "predicted", "from", "to", "measured", ""),
        (*first, "measured", "computed", "95 % band", "residual", "in sd", "unexplained", ""),
        (*first, "in sd", "leverage", "weight", "changes most", "by sd"),
    ]  # fmt: skip


def test_readings_are_written_in_mm_and_blanks_are_empty():
    given = [Reading("EX-1.a2", "bench 1", 0.00125), Reading("CV", "bench 1", None)]
    channels = [displacement("EX-1.a2", (0.0, 0.0), (1.0, 0.0)), displacement("CV", (), ())]
    assert readings_csv(given, channels).splitlines()[1:] == [
        "EX-1.a2,bench 1,1.25,mm",
        "CV,bench 1,,mm",
    ]


@pytest.mark.parametrize(
    ("accuracy", "shown"),
    [
        (np.nan, "1.23"),
        (1e-2, "1.23"),
        (1e-4, "1.23"),
        (9e-5, "1.235"),
        (1e-5, "1.235"),
        (1e-9, "1.234568"),
    ],
)
def test_one_decimal_more_is_shown_than_the_best_gauge_can_read(result, accuracy, shown):
    sd = np.where(np.isfinite(result.gauges.sd), accuracy, np.nan)
    sd[0, 0] = 0.0  # no accuracy
    table = changed_gauges(result.gauges, sd=sd)
    assert reading_text(table, 0, 1.2345678e-3) == shown


def test_the_title_counts_the_used_readings_and_has_the_misfit(result):
    assert fit_title(result) == "Readings (mm; 6 used, misfit 12.5)"
    assert fit_title(replace(result, objective=np.nan)) == "Readings (mm; 6 used)"


def test_residuals_are_measured_minus_computed_in_mm_and_in_accuracies(result):
    found = rows(fit_table(result))
    assert found["EX-1.a8", "bench 1"] == ["1.90", "1.10", "0.80", "8.0", ""]
    assert found["EX-1.a4", "bench 1"] == ["0.60", "0.70", "-0.10", "-1.0", ""]
    assert len(found) == 6  # those of bench 2 are among the predictions
    coarse = changed(result, "sd", (2, BENCH), 4e-4)
    assert rows(fit_table(coarse))["EX-1.a8", "bench 1"][2:4] == ["0.80", "2.0"]


def test_readings_that_were_not_used_or_are_bad_are_marked(result):
    off = changed(result, "used", (2, BENCH), False)
    assert rows(fit_table(off))["EX-1.a8", "bench 1"][-1] == "not used"
    bad = changed(off, "bad", (2, BENCH), True)
    assert rows(fit_table(bad))["EX-1.a8", "bench 1"][-1] == "bad"


def test_bands_are_those_of_the_prediction_and_hold_95_percent(result):
    found = rows(prediction_table(result))
    half = norm.ppf(0.975) * 0.15  # mm
    for name, mean in (("EX-1.a2", 0.8), ("CV-1", -9.0)):
        predicted, low, high = map(float, found[name, "bench 2"][:3])
        assert predicted == pytest.approx(mean, abs=5e-3)
        assert (low, high) == pytest.approx((mean - half, mean + half), abs=5.1e-3)


def test_a_reading_on_the_end_of_its_band_is_inside(result):
    place = (0, LAST)
    for end, step in ((result.prediction.lower95, -1e-9), (result.prediction.upper95, 1e-9)):
        on = changed(result, "measured", place, end[place])
        off = changed(result, "measured", place, end[place] + step)
        assert rows(prediction_table(on))["EX-1.a2", "bench 2"][-1] == "inside"
        assert rows(prediction_table(off))["EX-1.a2", "bench 2"][-1] == "outside"
        assert (scored(on), scored(off)) == ((4, 4), (3, 4))


def test_predictions_without_a_reading_or_a_band_say_so(result):
    unread = changed(result, "measured", (0, LAST), np.nan)
    assert rows(prediction_table(unread))["EX-1.a2", "bench 2"][-2:] == ["-", ""]
    assert scored(unread) == (3, 3)
    half = replace(result.prediction, upper95=np.full((5, 3), np.inf))
    assert rows(prediction_table(replace(result, prediction=half)))["CV-1", "bench 2"][:3] == (
        ["-"] * 3
    )
    assert rows(prediction_table(result))["ST-1", "bench 2"] == [
        "-", "-", "-", "3.50", "not determined",
    ]  # fmt: skip


def test_used_and_bad_readings_do_not_count_for_the_score(result):
    assert scored(changed(result, "used", (0, LAST), True)) == (3, 3)
    assert scored(changed(result, "bad", (0, LAST), True)) == (3, 3)
    assert scored(replace(result, prediction=None)) == (0, 0)


def test_beside_predictions_their_own_sd_tells_what_is_unexplained(result):
    found = unexplained(result)
    assert found[2, BENCH] == pytest.approx(0.8 / 0.1)
    assert found[0, LAST] == pytest.approx(-0.1 / 0.15)
    assert np.isnan(found[4, LAST])  # predicted without being determined
    assert np.isnan(found[0, FIRST])  # not read


def test_the_table_of_the_page_has_every_reading_with_its_state(result):
    found = rows(reading_table(result))
    assert len(found) == 4 + 5 + 2  # bench 1, bench 2, the settlement at the drift and bench 1
    assert found["EX-1.a8", "bench 1"] == ["1.90", "1.10", "-", "0.80", "8.0", "8.0", "used"]
    assert found["EX-1.a2", "bench 2"] == [
        "0.70", "0.80", "0.51 to 1.09", "-0.10", "-1.0", "-0.7", "predicted",
    ]  # fmt: skip
    alone = replace(result, prediction=None)
    assert rows(reading_table(alone))["EX-1.a2", "bench 2"][-3:] == ["-0.10", "-1.0", "not used"]


def test_readings_beyond_three_standard_deviations_stand_out_the_farthest_first(result):
    computed = result.gauges.computed[0, BENCH]
    near = changed(result, "measured", (0, BENCH), computed + 2.999e-4)
    far = changed(result, "measured", (0, BENCH), computed - 3.001e-4)
    assert OUTLIER == 3.0
    assert [o.channel for o in outliers(near)] == ["EX-1.a8"]
    assert [o.channel for o in outliers(far)] == ["EX-1.a8", "EX-1.a2"]
    assert outliers(far)[1].residual == pytest.approx(-3.001)
    assert outliers(changed(far, "bad", (2, BENCH), True))[0].channel == "EX-1.a2"


def test_the_root_mean_square_counts_used_readings_only(result):
    used = np.array([1.0, -1.0, 8.0, 2.0, 1.0, -1.0])
    assert rms(result) == pytest.approx(np.sqrt(np.mean(used**2)))
    without = changed(result, "used", (2, BENCH), False)
    assert rms(without) == pytest.approx(np.sqrt(np.mean(np.delete(used, 2) ** 2)))


def test_the_title_of_the_influential_readings_says_how_large_residuals_are(result):
    found = replace(result.diagnostics, scale=0.5432, loss="squared")
    title = "Most influential readings (residuals: 0.54 standard deviations of all errors)"
    assert influence_title(found) == title
    assert len(influence_title(replace(found, scale=0.0123))) <= 80
    robust = influence_title(result.diagnostics).splitlines()
    assert robust[1] == "Loss huber (delta 1.345); plain weighted squares 75"


def test_the_most_influential_readings_come_first_and_name_what_they_move(result):
    distance = result.diagnostics.distance.copy()
    distance[row(result, 3, BENCH)] = 100.0  # above the 64 of the reading that is off
    moved = replace(result, diagnostics=replace(result.diagnostics, distance=distance))
    first, second, *rest = influence_table(moved).rows
    assert list(first) == ["CV-1", "bench 1", "2.0", "0.50", "0.50", "E_rock", "+0.20"]
    assert list(second) == ["EX-1.a8", "bench 1", "8.0", "0.50", "0.50", "E_rock", "+0.80"]
    assert len(rest) == 3  # five of six


def test_a_reading_that_alone_determines_a_parameter_moves_all_of_it(result):
    influence = result.diagnostics.influence.copy()
    influence[row(result, 2, BENCH)] = [0.5, -np.inf, 0.1]
    alone = replace(result, diagnostics=replace(result.diagnostics, influence=influence))
    assert list(influence_table(alone).rows[0])[-2:] == ["sigma_v", "all"]


def test_programs_get_all_diagnostics_by_influence(result):
    found = diagnostics_object(result)
    assert (found["loss"], found["weighted_squares"]) == ("huber (delta 1.345)", 75.0)
    assert found["scale"] == 1.4826
    distances = [reading["distance"] for reading in found["readings"]]
    assert distances == sorted(distances, reverse=True)
    assert len(distances) == 6
    worst = found["readings"][0]
    assert worst["influence"] == pytest.approx({"E_rock": 0.8, "sigma_v": 0.0, "K0": 0.4})
    assert [worst[k] for k in ("standardized", "studentized", "weight", "leverage")] == (
        pytest.approx([8.0, 8.0, 0.5, 0.5])
    )
    assert diagnostics_object(replace(result, diagnostics=None)) == {}


def test_in_sd_and_unexplained_have_one_meaning_in_all_tables_and_sentences(result):
    """Of 0.8 mm, 8 accuracies, a model error leaves 2.5 standard deviations unexplained."""
    found = result.diagnostics
    found = replace(found, standardized=np.where(found.standardized > 5.0, 2.5, 0.25))
    error = ModelErrorTable(
        "given", 0.1, 0.1, 0.1, 10.0, np.empty(0), np.empty(0), (), np.empty((0, 0)),
        np.empty((0, 0)),
    )  # fmt: skip
    given = replace(result, diagnostics=found, model_error=error)
    place = "EX-1.a8", "bench 1"
    assert rows(fit_table(given))[place][3:5] == ["8.0", "2.5"]
    assert rows(reading_table(given))[place][4:6] == ["8.0", "2.5"]
    assert rows(influence_table(given))[place][0] == "2.5"
    assert influence_table(given).header[2] == "unexplained"
    csv = {row[:2]: row for row in csv_tables(given)["gauges"].rows}
    assert csv[place][7:9] == (pytest.approx(8.0), 2.5)
    assert not [one for one in outliers(given) if one.used]
    assert rms(given) == pytest.approx(np.sqrt((5 * 0.25**2 + 2.5**2) / 6))
    assert "Unexplained: what is left of the residual when the model error" in in_sd_note(given)
    assert in_sd_note(given) in " ".join(result_text(given).split())
    assert "unexplained" not in in_sd_note(result)  # the fit's own readings: both are the same
    assert "unexplained is the residual in" in in_sd_note(result, predictions=True)

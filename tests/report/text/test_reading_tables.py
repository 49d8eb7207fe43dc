"""Tables of readings, cell by cell, calculated from the noise that the example is made of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geoident.model.gauges import Reading
from geoident.model.parameter import Prior
from geoident.report.text.gauges import fit_table, prediction_table, reading_table, readings_csv
from geoident.report.text.parameters import parameter_table, prior_interval
from geoident.report.text.residuals import influence_table, outliers, scored
from tests.support.cases import displacement
from tests.support.results import CHANNELS, STAGES, changed_gauges, example_result

RESULT = example_result(2)
NOISE = 1e-4 * np.array([[0, 1, -1], [0, -1, 1], [0, 8, 1], [0, 2, -1], [-1, 1, 0]])  # m
COMPUTED = RESULT.gauges.computed
USED = [(4, 0), (0, 1), (1, 1), (2, 1), (3, 1), (4, 1)]
BAND_SD = 1.5e-4
"""Of the predictions, m; that of ST-1 is not determined."""


def mm(length):
    """In the way of a gauge with an accuracy of 0.1 mm."""
    return f"{1e3 * length:.2f}".replace("-0.00", "0.00")


def rows(table):
    return [list(row) for row in table.rows]


def start_of_row(i, j):
    return [CHANNELS[i], STAGES[j]]


def test_used_readings_stand_beside_what_is_computed_and_the_difference():
    assert rows(fit_table(RESULT)) == [
        [
            *start_of_row(i, j),
            mm(COMPUTED[i, j] + NOISE[i, j]),
            mm(COMPUTED[i, j]),
            mm(NOISE[i, j]),
            f"{NOISE[i, j] / 1e-4:.1f}",
            "",
        ]
        for i, j in USED
    ]


def test_predictions_stand_between_the_ends_of_their_bands():
    half = 1.96 * BAND_SD
    expected = [
        [
            *start_of_row(i, 2),
            *(mm(COMPUTED[i, 2] + by) for by in (0.0, -half, half, NOISE[i, 2])),
            "inside",
        ]
        for i in range(4)
    ]
    assert rows(prediction_table(RESULT)) == [
        *expected,
        [*start_of_row(4, 2), "-", "-", "-", mm(3.5e-3), "not determined"],
    ]


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize(("off", "where"), [(1.95, "inside"), (1.97, "outside")])
def test_a_prediction_holds_up_to_the_ends_of_its_band(side, off, where):
    measured = RESULT.gauges.measured.copy()
    measured[1, 2] = COMPUTED[1, 2] + side * off * BAND_SD
    table = prediction_table(
        replace(RESULT, gauges=changed_gauges(RESULT.gauges, measured=measured))
    )
    assert [row[-1] for row in table.rows] == ["inside", where, *["inside"] * 2, "not determined"]


def test_a_prediction_without_a_reading_is_neither_inside_nor_outside():
    measured = RESULT.gauges.measured.copy()
    measured[:, 2] = np.nan
    unread = replace(RESULT, gauges=changed_gauges(RESULT.gauges, measured=measured))
    assert [row[-2:] for row in rows(prediction_table(unread))] == [
        *[["-", ""]] * 4,
        ["-", "not determined"],
    ]
    assert scored(unread) == (0, 0)


def test_the_page_has_all_readings_and_what_each_was_for():
    """Residuals are in sd of the gauge; what is unexplained of a prediction in sd of its band."""
    half = 1.96 * BAND_SD
    used = [
        [
            *start_of_row(i, j),
            mm(COMPUTED[i, j] + NOISE[i, j]),
            mm(COMPUTED[i, j]),
            "-",
            mm(NOISE[i, j]),
            *[f"{NOISE[i, j] / 1e-4:.1f}"] * 2,
            "used",
        ]
        for i, j in USED
    ]
    predicted = [
        [
            *start_of_row(i, 2),
            mm(COMPUTED[i, 2] + NOISE[i, 2]),
            mm(COMPUTED[i, 2]),
            f"{mm(COMPUTED[i, 2] - half)} to {mm(COMPUTED[i, 2] + half)}",
            mm(NOISE[i, 2]),
            f"{NOISE[i, 2] / 1e-4:.1f}",
            f"{NOISE[i, 2] / BAND_SD:.1f}",
            "predicted",
        ]
        for i in range(4)
    ]
    lacking = [*start_of_row(4, 2), "3.50", "not determined", "-", "-", "-", "-", "predicted"]
    assert rows(reading_table(RESULT)) == [*used, *predicted, lacking]


def test_what_is_neither_used_nor_predicted_is_said():
    """Without predictions the residuals of the last stage count in the gauge's deviation."""
    bad = np.zeros((5, 3), dtype=bool)
    bad[3, 2] = True
    plain = replace(RESULT, prediction=None, gauges=changed_gauges(RESULT.gauges, bad=bad))
    last = [row for row in rows(reading_table(plain)) if row[1] == STAGES[2]]
    assert [row[-2:] for row in last] == [
        ["-1.0", "not used"],
        ["1.0", "not used"],
        ["1.0", "not used"],
        ["-1.0", "known to be wrong"],
        ["0.0", "not used"],
    ]
    assert [row[-1] for row in rows(fit_table(plain))[-5:]] == [
        *["not used"] * 3,
        "bad",
        "not used",
    ]
    assert scored(plain) == (0, 0)


def test_outliers_come_with_the_farthest_first():
    measured = RESULT.gauges.measured.copy()
    measured[0, 1] = COMPUTED[0, 1] - 9e-4  # used: nine times the sd of the gauge
    measured[3, 2] = COMPUTED[3, 2] + 6e-4  # predicted: four times the sd of the prediction
    found = outliers(replace(RESULT, gauges=changed_gauges(RESULT.gauges, measured=measured)))
    assert [(one.channel, one.stage, one.used) for one in found] == [
        ("EX-1.a2", "bench 1", True),
        ("EX-1.a8", "bench 1", True),
        ("CV-1", "bench 2", False),
    ]
    assert [one.residual for one in found] == pytest.approx([-9.0, 8.0, 4.0])


def test_lengths_have_a_decimal_more_than_the_best_gauge():
    for sd, text in ((1e-4, "0.40"), (1e-5, "0.400"), (3e-5, "0.400"), (1e-3, "0.40")):
        table = changed_gauges(
            RESULT.gauges, sd=np.where(np.isfinite(RESULT.gauges.sd), sd, np.nan)
        )
        row = rows(fit_table(replace(RESULT, gauges=table)))[1]
        assert row[3] == text


def row_of(channel, stage):
    """Row of a reading in the long table."""
    readings = RESULT.gauges.readings
    return list(zip(readings.channel, readings.stage, strict=True)).index((channel, stage))


def test_influence_names_the_parameter_that_changes_most():
    """In the example the change is 0.1, 0 and 0.05 of the residual; its square is the distance."""
    assert RESULT.diagnostics is not None
    influence = RESULT.diagnostics.influence.copy()
    influence[row_of("CV-1", "bench 1")] = [0.3, 0.0, -0.4]
    influence[row_of("EX-1.a2", "bench 1")] = [0.0, np.inf, 0.0]
    found = replace(RESULT.diagnostics, influence=influence)
    table = rows(influence_table(replace(RESULT, diagnostics=found)))
    assert table[:2] == [
        ["EX-1.a8", "bench 1", "8.0", "0.50", "0.50", "E_rock", "+0.80"],
        ["CV-1", "bench 1", "2.0", "0.50", "0.50", "K0", "-0.40"],
    ]
    assert len(table) == 5
    assert ["EX-1.a2", "bench 1", "1.0", "0.50", "0.50", "sigma_v", "all"] in table


def test_parameters_of_the_page():
    assert rows(parameter_table(RESULT.parameters).filled) == [
        ["E_rock", "GPa", "12.3", "11.6 to 13.1", "14 ± 2.5 (lognormal)", "20", "2 to 80", ""],
        ["sigma_v", "MPa", "as its prior", "-", "8 ± 0.8", "8", "2 to 20", ""],
        ["K0", "-", "3.00", "2.80 to 3.00", "-", "1", "0.3 to 3", "at its upper bound"],
    ]


def test_interval_of_a_prior_has_95_of_100_draws():
    """The lognormal one has the median 8 MPa and a standard deviation of 1/8 of the logarithm."""
    draws = np.random.default_rng(1).normal(size=100_000)
    for kind, values in (("normal", 8e6 + 1e6 * draws), ("lognormal", 8e6 * np.exp(draws / 8))):
        interval = prior_interval(Prior(8e6, 1e6, kind))
        assert interval == pytest.approx(np.quantile(values, [0.025, 0.975]), rel=3e-3)


def test_a_reading_without_a_value_is_an_empty_cell():
    channels = [displacement(name, (), ()) for name in ("EX, 1", "CV")]
    text = readings_csv([Reading("EX, 1", "a", 0.0123), Reading("CV", "a", None)], channels)
    assert text == 'gauge,stage,value,unit\n"EX, 1",a,12.3,mm\nCV,a,,mm\n'

"""Fits to readings of stages that last, held against Terzaghi's series with noise.

The truth is the closed form of the layer, computed apart from the program: K. Terzaghi,
Erdbaumechanik, 1925.
"""

from __future__ import annotations

import json
import re
from datetime import date, timedelta
from pathlib import Path

import h5py
import numpy as np
import pytest
from support.column import DAY, FILL, E, K, settlement, write_column
from support.commands import run_command

from geoident.api import fit
from geoident.io.result.file import read_result
from geoident.report.drawing.gauges.axis import stage_axis
from geoident.workflow.identifiability import identifiability
from geoident.workflow.running.jobs import load_inputs

BEGIN = date(2024, 3, 1)
DAYS = (2, 5, 9, 16, 30, 45, 60, 90, 130, 180)
ONE_STAGE = f"  - {{name: fill, {FILL}, lasts: 200 d}}"


def write_readings(folder: Path, days=DAYS, sd=0.2e-3, seed=1) -> None:
    """Settlements of the series at some days after the load, with noise, as a wide table."""
    noise = np.random.default_rng(seed).normal(0.0, sd, len(days))
    values = 1e3 * (settlement(DAY * np.array(days)) + noise)
    rows = [f"{BEGIN + timedelta(d)},{v:.3f}" for d, v in zip(days, values, strict=True)]
    (folder / "read.csv").write_text("\n".join(["date,S1 (mm)", *rows, ""]))


FIRST_130 = ", model_error: none, until: fill + 130 d"


def times_of_date(day: date) -> float:
    """Seconds since 1970."""
    return (day - date(1970, 1, 1)).days * DAY


DATED = f"dates: {{virgin: {BEGIN}}}\nreadings: {{file: read.csv, layout: wide}}\n"


def test_modulus_and_permeability_follow_from_ten_dates(tmp_path):
    write_readings(tmp_path)
    case = write_column(tmp_path, stages=ONE_STAGE, more=DATED)
    found = fit(case).parameters
    assert found["E"].value == pytest.approx(E, rel=0.03)
    assert found["k"].value == pytest.approx(K, rel=0.04)
    for name, truth in (("E", E), ("k", K)):
        assert found[name].lower95 < truth < found[name].upper95


def test_later_readings_are_predicted_from_the_first_four_months(tmp_path):
    write_readings(tmp_path)
    case = write_column(tmp_path, stages=ONE_STAGE, more=DATED, fit=FIRST_130)
    done = run_command("fit", case)
    assert done.exit_code == 0, done.output
    told = json.loads(run_command("show", tmp_path / "case.fit.h5", "--json").stdout)
    used = {row["stage"] for row in told["readings"] if row["used"]}
    assert used == {f"fill + {d} d" for d in DAYS if d <= 130}
    later = {row["stage"]: row for row in told["predictions"]}
    for day, name in ((180, "fill + 180 d"), (200, "fill")):
        band = later[name]
        assert band["lower95"] < settlement(day * DAY)[0] < band["upper95"]
        assert band["upper95"] - band["lower95"] < 0.2 * band["mean"]
    # what is ahead is less certain the farther it is
    assert later["fill + 180 d"]["sd"] < later["fill"]["sd"]

    times = {row["stage"]: row for row in told["times"]}
    assert times["fill + 30 d"]["date"] == "2024-03-31T00:00:00"
    assert times["fill + 30 d"]["since"] == times["fill + 30 d"]["elapsed"] == 30 * DAY
    assert times["fill"]["moment_of"] == "fill"

    # tables show ends of stages, what was read and what is to come; pictures the logarithm of time
    text = run_command("show", tmp_path / "case.fit.h5").stdout
    predictions = text[text.index("Predictions (") : text.index("Reactions of supports")]
    rows = [re.split(r"\s{2,}", line) for line in predictions.splitlines()[2:] if line]
    assert [row[1] for row in rows] == ["fill + 180 d", "fill"]
    forces = text[text.index("Reactions of supports") :].split("\n\n")[0]
    assert "fill + " not in forces
    assert forces.count("fill ") == 3
    axis = stage_axis(read_result(tmp_path / "case.fit.h5"))
    assert axis.log
    assert axis.of_reading(0, times_of_date(BEGIN + timedelta(30))) == pytest.approx(30.0)

    # a prediction has the moments of its fit, and says the same
    assert run_command("predict", tmp_path / "case.fit.h5").exit_code == 0
    again = read_result(tmp_path / "case.predict.h5")
    before = read_result(tmp_path / "case.fit.h5")
    assert again.gauges.stages == before.gauges.stages
    np.testing.assert_allclose(again.gauges.computed, before.gauges.computed, rtol=1e-9)
    np.testing.assert_allclose(again.prediction.sd, before.prediction.sd, rtol=1e-6)


def test_staged_fills_and_the_end_as_a_date(tmp_path):
    """Three lifts whose durations follow from dates; readings of the first two tell the third."""
    loads, begins = (40e3, 30e3, 30e3), (0, 30, 70)
    rng = np.random.default_rng(4)

    def truth(day):
        return sum(
            settlement(max(day - b, 0) * DAY, q)[0] for b, q in zip(begins, loads, strict=True)
        )

    days = [1, 3, 7, 14, 21, 29, 31, 34, 40, 50, 60, 69, 71, 80, 90, 100, 110, 150]
    rows = [f"{BEGIN + timedelta(d)},{1e3 * (truth(d) + rng.normal(0, 2e-4)):.3f}" for d in days]
    (tmp_path / "read.csv").write_text("\n".join(["date,S1 (mm)", *rows, ""]))
    ends = (30, 70, 200)
    stages = "\n".join(
        f"  - {{name: fill {n}, loads: {{f{n}: {{on: y1, pressure: {q} Pa}}}}, lasts: dates}}"
        for n, q in enumerate(loads, 1)
    )
    dates = ", ".join(f"fill {n}: {BEGIN + timedelta(d)}" for n, d in enumerate(ends, 1))
    case = write_column(
        tmp_path,
        stages=stages,
        more=DATED.replace("}", f", {dates}}}", 1),
        fit=f", model_error: none, until: {BEGIN + timedelta(110)}",
    )
    fit(case)
    result = read_result(tmp_path / "case.fit.h5")
    values = result.parameters
    for n, value in enumerate((E, K)):
        assert values.lower95[n] < value < values.upper95[n]
    told = result.gauges
    axis = stage_axis(result)
    assert axis.dated
    assert np.diff(list(axis.marks.values())) == pytest.approx([40.0, 130.0])
    at = told.stages.index("fill 3 + 80 d")
    prediction = result.prediction
    assert prediction.lower95[0, at] < truth(150) < prediction.upper95[0, at]
    # each lift adds to what the ones before go on doing
    assert told.computed[0, told.stages.index("fill 2 + 10 d")] == pytest.approx(
        truth(40), rel=0.02
    )


def test_series_of_pictures_has_days(tmp_path):
    stages = f"""  - {{name: rest, lasts: 0 d}}
  - {{name: fill, {FILL}, lasts: 50 d, moments: [1, 10 d]}}"""
    case = write_column(tmp_path, stages=stages)
    fields = tmp_path / "fields.vtkhdf"
    done = run_command("simulate", case, "--fields", fields, "-o", tmp_path / "readings.csv")
    assert done.exit_code == 0, done.output
    with h5py.File(fields) as file:
        values = file["VTKHDF/Steps/Values"]
        assert values.attrs["unit"] == "d"
        np.testing.assert_allclose(values[:], [0.0, 0.0, 1.0, 10.0, 50.0], atol=1e-3)
        assert (np.diff(values[:]) > 0.0).all()
    text = (tmp_path / "readings.csv").read_text()
    lines = [line for line in text.splitlines() if line[:1] not in "#"]
    assert [line.split(",")[1] for line in lines[1:]] == [
        "rest",
        "fill + 1 d",
        "fill + 10 d",
        "fill",
    ]
    # what was simulated is read again at the same moments
    again = write_column(
        tmp_path, stages=stages, more="readings: readings.csv\n", name="again.yaml"
    )
    read = load_inputs(str(again)).case
    assert [reading.stage for reading in read.readings] == [
        "rest",
        "fill + 1 d",
        "fill + 10 d",
        "fill",
    ]


@pytest.mark.slow
def test_bands_hold_for_dates_ahead(tmp_path):
    """Of 30 records up to day 130, day 180 lies inside its 95 % band nearly always."""
    inside = 0
    for seed in range(30):
        write_readings(tmp_path, seed=seed)
        case = write_column(tmp_path, stages=ONE_STAGE, more=DATED, fit=", until: fill + 130 d")
        fit(case)
        result = read_result(tmp_path / "case.fit.h5")
        at = result.gauges.stages.index("fill + 180 d")
        low, high = result.prediction.lower95[0, at], result.prediction.upper95[0, at]
        inside += low < result.gauges.measured[0, at] < high
    assert inside >= 26


def judged(folder: Path, *, dates=(), at=()):
    """What `check --identifiability` says of a list of dates without values."""
    folder.mkdir()
    rows = [f"{BEGIN + timedelta(day)}," for day in dates]
    (folder / "read.csv").write_text("\n".join(["date,S1 (mm)", *rows, ""]))
    case = write_column(folder, stages=ONE_STAGE.replace("200 d", "400 d"), more=DATED)
    return identifiability(str(case), overrides=at)


def test_early_dates_tell_permeability_over_modulus_alone(tmp_path):
    """Early settlement is 2 q (k t / (pi gamma E))^(1/2), which tells k / E."""
    days = np.array([1, 2, 3, 4])
    early = judged(tmp_path / "early", dates=days.tolist())
    assert early.listed
    assert early.readings == 4
    (finding,) = early.findings
    assert (finding.kind, finding.subject) == ("not-separated", "E, k")
    said = re.search(r"k / E is determined: (\S+) \(95 %: (\S+) to (\S+),", finding.sentence)
    ratio, low, high = map(float, said.groups())
    assert ratio == pytest.approx(1e-9 / 3e6, rel=1e-3)
    settled = 2.0 * 100e3 * np.sqrt(ratio * days * DAY / (np.pi * 9810.0))
    alone = 1.96 * 2.0 * 0.2e-3 / np.sqrt(np.sum(settled**2))
    # what the water stores makes it a little wider, since E is not known at all
    assert alone < np.log(high / low) / 2.0 < 2.0 * alone
    late = judged(tmp_path / "late", dates=(100, 200, 300, 390))
    assert late.parameters.determined.all()


@pytest.mark.slow
def test_dates_without_values_foretell_the_intervals_of_the_fit(tmp_path):
    (tmp_path / "fitted").mkdir()
    write_readings(tmp_path / "fitted")
    stages = ONE_STAGE.replace("200 d", "400 d")
    case = write_column(tmp_path / "fitted", stages=stages, more=DATED, fit=", model_error: none")
    found = fit(case).parameters
    at = [
        f"parameters.{name}.start={found[name].value!r} {unit}"
        for name, unit in (("E", "Pa"), ("k", "m/s"))
    ]
    plan = judged(tmp_path / "planned", dates=DAYS, at=at)
    wanted = [found["E"].sd, found["k"].sd]
    np.testing.assert_allclose(plan.parameters.sd, wanted, rtol=0.02)


def test_a_list_that_is_not_there_yet_leaves_the_moments_of_the_stage(tmp_path):
    case = write_column(tmp_path, stages=ONE_STAGE, more=DATED)
    assert not identifiability(str(case)).listed

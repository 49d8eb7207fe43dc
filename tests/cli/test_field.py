"""A fit to readings as sites have them: wrong ones among them, flagged ones, dates, offsets."""

import csv
import io

import numpy as np
import pytest
import xarray

from tests.support.commands import said_findings

ALL = ["--set", "fit.stages=[first, second]", "--set", "fit.backtest=false"]
HUBER = [*ALL, "--set", "fit.loss=huber"]
MORE = """\
gauge,stage,value,unit
CV,first,-0.598,mm
S,first,-0.1226,mm
X.a,first,0.0627,mm
CV,second,-1.077,mm
S,second,0.9,mm
X.a,second,0.282,mm
"""


@pytest.fixture
def wrong(trench):
    """The trench with a settlement of the second stage that was read wrongly."""
    (trench / "readings.csv").write_text(MORE)
    return trench


def flag(folder, bad):
    with (folder / "case.yaml").open("a") as case:
        case.write(f"bad: {bad}\n")


def inside(found):
    parameters = found["parameters"]
    return {
        name: bool(parameters[name]["sd"])
        and parameters[name]["lower95"] < truth < parameters[name]["upper95"]
        for name, truth in (("E", 5e9), ("K0", 1.5))
    }


@pytest.mark.parametrize("loss", ["huber", pytest.param("student-t", marks=pytest.mark.slow)])
def test_one_wrong_reading_spoils_least_squares_and_not_a_robust_fit(wrong, run_json, loss):
    (plain,) = run_json("fit", "case.yaml", *ALL)
    assert not all(inside(plain).values())
    (robust,) = run_json("fit", "case.yaml", *ALL, "--set", f"fit.loss={loss}", "--force")
    assert all(inside(robust).values())
    assert robust["objective"] < robust["diagnostics"]["weighted_squares"]
    assert plain["diagnostics"]["weighted_squares"] == pytest.approx(plain["objective"])


def test_the_reading_that_bears_most_and_those_far_off_are_named(wrong, run_json, run):
    (found,) = run_json("fit", "case.yaml", *HUBER)
    far = [sentence for sentence in said_findings(found) if "far from the model" in sentence]
    assert "S at second" in far[0]
    assert any("most influential reading" in sentence for sentence in said_findings(found))
    worst = max(found["diagnostics"]["readings"], key=lambda r: abs(r["standardized"]))
    assert (worst["gauge"], worst["stage"]) == ("S", "second")
    assert worst["weight"] < 0.1
    assert worst["influence"].keys() == {"E", "K0"}
    shown = run("show", "case.fit.h5").stdout
    assert "Most influential readings (residuals:" in shown
    assert "Loss huber (delta 1.345); plain weighted squares" in shown


def test_the_diagnostics_are_in_the_result_for_xarray(wrong, run_json):
    (found,) = run_json("fit", "case.yaml", *HUBER)
    with xarray.open_dataset("case.fit.h5", group="diagnostics", engine="h5netcdf") as table:
        assert table.influence.dims == ("gauge", "stage", "parameter")
        assert table.attrs["loss"] == "huber (delta 1.345)"
        assert float(table.leverage.sum()) == pytest.approx(2.0, abs=1e-6)
        worst = found["diagnostics"]["readings"][0]
        at = table.sel(gauge=worst["gauge"], stage=worst["stage"])
        assert float(at.studentized) == worst["studentized"]
        np.testing.assert_array_equal(list(worst["influence"].values()), at.influence)


def test_a_prediction_from_a_robust_fit_knows_what_it_left_of_each_reading(wrong, run_json):
    """The bands of readings that took no part do not depend on how they are asked for."""
    options = ["--set", "fit.loss=huber", "--set", "fit.huber.delta=0.5"]
    (fitted,) = run_json("fit", "case.yaml", *options)
    (predicted,) = run_json("predict", "case.fit.h5", "--stages", "second")
    sd = [[band["sd"] for band in found["predictions"]] for found in (fitted, predicted)]
    np.testing.assert_allclose(sd[0], sd[1], rtol=1e-9)
    assert min(r["weight"] for r in fitted["diagnostics"]["readings"]) < 1.0


def test_condensation_refuses_a_robust_loss_at_its_key(wrong, run):
    done = run("fit", "case.yaml", *HUBER, "--set", "fit.method=condensation")
    assert done.exit_code == 3
    assert "the loss is huber. Possible are gauss-newton, simplex, scan" in done.stderr


def test_a_flagged_reading_is_kept_with_its_reason_and_not_used(wrong, run, run_json):
    flag(wrong, "[{gauge: S, stage: second, reason: prism hit by a truck}]")
    (found,) = run_json("fit", "case.yaml", *ALL)
    assert all(inside(found).values())
    (flagged,) = [g for g in found["gauges"] if g["bad"]]
    assert (flagged["gauge"], flagged["used"]) == ("S", False)
    assert flagged["measured"] == pytest.approx(0.9e-3)
    note = "S at second is not used, flagged as bad: prism hit by a truck."
    assert note in found["notes"]
    assert "prism hit by a truck" in run("show", "case.fit.h5").stdout
    assert "prism hit by a truck" in run("check", "case.yaml").stdout


def test_a_flagged_reading_does_not_score_a_prediction(wrong, run_json):
    (all_of_them,) = run_json("fit", "case.yaml")
    flag(wrong, "[{gauge: S, stage: second, reason: hit}]")
    (good_ones,) = run_json("fit", "case.yaml", "--force")
    assert any("2 of 3 readings" in note for note in all_of_them["notes"])
    assert any("2 of 2 readings" in note for note in good_ones["notes"])
    (again,) = run_json("predict", "case.fit.h5", "--stages", "second")
    assert any("2 of 2 readings" in note for note in again["notes"])


def sheet(rows):
    text = io.StringIO()
    csv.writer(text, delimiter=";").writerows(rows)
    return text.getvalue()


@pytest.fixture
def dated(trench):
    """The same readings as a spreadsheet has them: wide, with dates, commas and semicolons."""
    rows = [
        ["Datum", "CV (mm)", "S (mm)", "X.a (mm)"],
        ["05.03.2024", "-0,590", "-0,1226", "0,0627"],
        ["20.03.2024", "-0,606", "-0,1226", "0,0627"],
        ["02.04.2024", "-1,077", "0,0376", "0,282"],
    ]
    (trench / "sheet.csv").write_text(sheet(rows))
    description = (
        "dates: {first: 2024-03-01, second: 2024-04-01}\n"
        "readings: {file: sheet.csv, layout: wide, columns: {date: Datum}, delimiter: ';',\n"
        "  decimal: ',', date_format: DD.MM.YYYY, several: SEVERAL}\n"
    )

    def write(several):
        text = (trench / "case.yaml").read_text()
        text = text.replace("readings: readings.csv\n", description.replace("SEVERAL", several))
        (trench / f"{several}.yaml").write_text(text)
        return f"{several}.yaml"

    return write


def estimate(found):
    return np.array([[p["value"], p["sd"]] for p in found["parameters"].values()])


def test_all_readings_of_a_stage_say_what_their_mean_says(dated, run_json):
    (mean,) = run_json("fit", dated("mean"))
    (each,) = run_json("fit", dated("all"))
    (last,) = run_json("fit", dated("last"))
    np.testing.assert_allclose(estimate(mean), estimate(each), rtol=1e-5)
    assert abs(estimate(last)[0, 0] / estimate(mean)[0, 0] - 1.0) > 1e-3
    measured = {(g["gauge"], g["stage"]): (g["measured"], g["sd"]) for g in each["gauges"]}
    assert measured["CV", "first"] == pytest.approx((-0.598e-3, 1e-5 / 2**0.5))
    assert len(each["diagnostics"]["readings"]) == 3


def test_an_offset_is_found_beside_the_modulus(trench, run_json):
    text = (trench / "case.yaml").read_text()
    text = text.replace("parameters:\n", "parameters:\n  off: {start: 0 mm, bounds: [-2, 2 mm]}\n")
    text = text.replace(
        "4 m, 3.5 m]], accuracy: 0.01 mm", "4 m, 3.5 m]], accuracy: 0.01 mm, offset: $off"
    )
    (trench / "offset.yaml").write_text(text)
    slipped = (trench / "readings.csv").read_text()
    slipped = slipped.replace("-0.598", "-0.298").replace("-1.077", "-0.777")
    (trench / "readings.csv").write_text(slipped)
    (found,) = run_json("fit", "offset.yaml", *ALL)
    off = found["parameters"]["off"]
    assert off["value"] == pytest.approx(0.3e-3, abs=4e-5)
    assert off["unit"] == "m"
    assert all(inside(found).values())


def described(readings):
    return f"dates: {{first: 2024-03-01, second: 2024-04-01}}\nreadings: {readings}\n"


def assert_alike(these, those):
    for one, other in zip(these, those, strict=True):
        assert one.keys() == other.keys()
        for key, value in other.items():
            number = isinstance(value, float)
            same = pytest.approx(value, rel=1e-9, abs=1e-15) if number else value
            assert one[key] == same, (key, one, other)


@pytest.fixture
def drifting(trench):
    """A convergence that drifts by 2 mm a month, read twice after the second stage."""
    rows = [
        "gauge,date,value,unit",
        "S,2024-03-05,-0.1226,mm",
        "X.a,2024-03-05,0.0627,mm",
        "CV,2024-04-06,-0.2,mm",
        "CV,2024-04-21,0.8,mm",
        "S,2024-04-03,0.0376,mm",
    ]
    (trench / "r.csv").write_text("\n".join(rows) + "\n")
    text = (trench / "case.yaml").read_text()
    text = text.replace(
        "readings: readings.csv\n", described("{file: r.csv, repeated_readings: all}")
    )
    text = text.replace(
        "4 m, 3.5 m]], accuracy: 0.01 mm",
        "4 m, 3.5 m]], accuracy: 0.01 mm, zero: first, drift: 2 mm/month",
    )
    (trench / "case.yaml").write_text(text)
    return trench


def table_of(path, group):
    with xarray.open_dataset(path, group=group, engine="h5netcdf") as table:
        return table.load()


def test_predict_knows_when_readings_were_taken(drifting, run, run_json):
    """A reading of a gauge that drifts is computed by predict as it was by fit."""
    (fitted,) = run_json("fit", "case.yaml", *ALL)
    (again,) = run_json("predict", "case.fit.h5", "--stages", "second")
    assert_alike(again["gauges"], fitted["gauges"])
    (later,) = run_json("fit", "case.yaml", "--force")  # predicts the second stage by itself
    (same,) = run_json("predict", "case.fit.h5", "--force")
    assert_alike(same["predictions"], later["predictions"])
    files = [table_of(f"case.{kind}.h5", "readings") for kind in ("fit", "predict")]
    np.testing.assert_allclose(files[1].computed, files[0].computed, rtol=1e-9)
    np.testing.assert_array_equal(files[1].time, files[0].time)


def test_the_long_table_has_every_reading_with_its_time_and_what_became_of_it(
    drifting, run, run_json
):
    flag(drifting, "[{gauge: S, stage: first, reason: prism hit}]")
    (fitted,) = run_json("fit", "case.yaml", *ALL)
    table = table_of("case.fit.h5", "readings")
    assert table.channel.values.tolist() == ["S", "X.a", "CV", "CV", "S"]
    assert table.gauge.values.tolist() == ["S", "X", "CV", "CV", "S"]
    assert table.stage.values.tolist() == ["first"] * 2 + ["second"] * 3
    assert table.reason.values.tolist() == ["flagged as bad: prism hit", "", "", "", ""]
    assert table.used.values.tolist() == [0, 1, 1, 1, 1]
    days = (table.time.values - table.time.values[0]) / 86400
    np.testing.assert_allclose(days, [0, 0, 32, 47, 29])
    # the model drifts between the two readings of one stage, 15 days of 2 mm a month
    month = 365.25 / 12
    assert float(table.computed[3] - table.computed[2]) == pytest.approx(2e-3 * 15 / month)
    np.testing.assert_allclose(table.residual, table.value - table.computed)
    used = table.used.values == 1
    residual = (table.residual / table.sd).values
    np.testing.assert_allclose(table.standardized.values[used], residual[used])
    # what was minimised knows when each was read, too
    assert fitted["objective"] == pytest.approx(float(np.sum(residual[used] ** 2)))
    assert np.isnan(table.leverage.values[~used]).all()
    assert float(table.leverage.values[used].sum()) == pytest.approx(2.0)
    assert set(table.unit.values) == {"m"}
    assert table.influence.dims == table.sensitivity.dims == ("reading", "parameter")
    (shown,) = run_json("show", "case.fit.h5")
    assert [r["reason"] for r in shown["readings"]] == table.reason.values.tolist()
    assert [r["time"] for r in shown["readings"]][2:4] == [
        "2024-04-06T00:00:00",
        "2024-04-21T00:00:00",
    ]
    assert shown["readings"][3]["value"] == pytest.approx(0.8e-3)
    assert shown["readings"][3]["unit"] == "m"
    text = run("export", "case.fit.h5", "--table", "readings").stdout
    rows = list(csv.DictReader(io.StringIO(text)))
    assert [(r["gauge"], r["value"], r["unit"], r["used"]) for r in rows[:3]] == [
        ("S", "-0.1226", "mm", "no"),
        ("X.a", "0.0627", "mm", "yes"),
        ("CV", "-0.2", "mm", "yes"),
    ]
    assert rows[0]["reason"] == "flagged as bad: prism hit"
    assert float(rows[3]["computed"]) == pytest.approx(1e3 * float(table.computed[3]))
    wide = table_of("case.fit.h5", "gauges").sel(gauge="CV", stage="second")
    assert float(wide.measured) == pytest.approx(0.3e-3)
    assert float(wide.sd) == pytest.approx(1e-5 / 2**0.5)
    both = table_of("case.fit.h5", "diagnostics").sel(gauge="CV", stage="second")
    assert float(both.leverage) == pytest.approx(float(table.leverage[2] + table.leverage[3]))


def test_readings_less_a_measured_zero_have_the_error_of_both(trench, run, run_json):
    rows = [
        "gauge,date,value,unit,accuracy",
        "CV,2024-02-20,10,mm,",
        "CV,2024-03-05,9.402,mm,",
        "S,2024-02-20,3,mm,0.03",
        "S,2024-03-05,2.8774,mm,0.04",
        "X.a,2024-02-20,5,mm,",
        "X.a,2024-03-05,5.0627,mm,",
    ]
    (trench / "r.csv").write_text("\n".join(rows) + "\n")
    text = (trench / "case.yaml").read_text()
    (trench / "case.yaml").write_text(
        text.replace("readings: readings.csv\n", described("{file: r.csv, rezero: true}"))
    )
    (found,) = run_json("fit", "case.yaml")
    sd = {g["gauge"]: g["sd"] for g in found["gauges"] if g["stage"] == "first"}
    assert sd["CV"] == pytest.approx(2**0.5 * 1e-5)
    assert sd["S"] == pytest.approx(5e-5)  # 0.03 and 0.04
    (note,) = [note for note in found["notes"] if "measured zero" in note]
    assert "CV, S, X.a are differences" in note
    assert "root of the sum of the squares" in note
    assert "share the error of its zero" in note
    assert "measured zero" in run("check", "case.yaml").stdout
    # a later reading is a difference too, also in a prediction from the result
    (again,) = run_json("predict", "case.fit.h5")
    for prediction in (found["predictions"], again["predictions"]):
        (cv,) = [p for p in prediction if p["gauge"] == "CV"]
        assert cv["sd"] > 2**0.5 * 1e-5
    bands = [[p["sd"] for p in each["predictions"]] for each in (found, again)]
    np.testing.assert_allclose(bands[0], bands[1], rtol=1e-9)

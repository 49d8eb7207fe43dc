"""Shared errors and estimated accuracies through the commands: result file, text, JSON, CSV."""

import csv
import io
import json

import h5py
import numpy as np
import pytest

from geoident.io.result.file import read_result
from geoident.workflow.estimating import accuracies
from tests.support.commands import said_findings
from tests.support.trench import CASE

GAUGES = """\
gauges:
  CV: {kind: convergence, between: [[2 m, 3.5 m], [4 m, 3.5 m]], accuracy: A, survey: tape}
  CW: {kind: convergence, between: [[2 m, 4 m], [4 m, 4 m]], accuracy: A, survey: tape}
  S1: {kind: settlement, point: [1 m, 4 m], accuracy: A, survey: level}
  S2: {kind: settlement, point: [5 m, 4 m], accuracy: A, survey: level}
  S3: {kind: settlement, point: [0.5 m, 4 m], accuracy: A, survey: level}
  S4: {kind: settlement, point: [1.5 m, 4 m], accuracy: A, survey: level}
  S5: {kind: settlement, point: [4.5 m, 4 m], accuracy: A, survey: level}
  X: {kind: extensometer, head: [2 m, 3 m], anchors: {a: [1 m, 3 m], b: [0.5 m, 3 m]}, accuracy: A}
  Y: {kind: extensometer, head: [4 m, 3 m], anchors: {a: [5 m, 3 m], b: [5.5 m, 3 m]}, accuracy: A}
"""
SHARED = "{reading: 2 um, zero: 4 um, head: 3 um, epoch: 4 um}"
ROOMY = "{reading: 6 um, zero: 12 um, head: 9 um, epoch: 12 um}"  # three times as much
LEAN = "mesh_error: false, backtest: false"


@pytest.fixture
def site(trench, run):
    """Readings of both stages with shared errors; only the first is used."""

    def write(accuracy, *, read="readings: readings.csv", fit=""):
        head, _, _ = CASE.partition("gauges:")
        end = f"{read}\nfit: {{method: gauss-newton, stages: [first], {LEAN}{fit}}}\n"
        (trench / "case.yaml").write_text(head + GAUGES.replace("y: A", f"y: {accuracy}") + end)

    write(ROOMY, read="readings: []")
    truth = ["--set", "parameters.E.start=5 GPa", "--set", "parameters.K0.start=1.5"]
    made = run("simulate", "case.yaml", *truth, "--noise", "--seed", "4")
    (trench / "readings.csv").write_text(made.stdout)
    return write


def test_noise_of_simulated_readings_is_shared(site, run):
    """The mean of all settlements of one survey varies by much more than the root of their number
    would let it."""
    site(ROOMY, read="readings: []")
    means = []
    for seed in range(8):
        text = run("simulate", "case.yaml", "--noise", "--seed", str(seed)).stdout
        rows = list(csv.DictReader(io.StringIO(text)))
        read = [float(r["value"]) for r in rows if r["gauge"][0] == "S" and r["stage"] == "first"]
        means.append(1e3 * np.mean(read))
    independent = ROOMY_TOTAL / 5**0.5
    assert np.std(means, ddof=1) > 1.3 * independent


ROOMY_TOTAL = float(np.hypot.reduce([6.0, 12.0, 9.0, 12.0]))  # um


def test_a_fit_knows_what_is_shared_and_a_prediction_from_it_knows_the_same(site, run, run_json):
    site(ROOMY)
    (found,) = run_json("fit", "case.yaml")
    (again,) = run_json("predict", "case.fit.h5")
    for name in ("mean", "sd"):
        one, other = ([p[name] for p in each["predictions"]] for each in (found, again))
        np.testing.assert_allclose(one, other, rtol=1e-12)
    with h5py.File("case.fit.h5") as file:
        more = found["model_error"]["scatter"]
        sizes = np.array([6e-6, 12e-6, 9e-6, 12e-6, 0.0])
        np.testing.assert_allclose(file["gauges/error_sd"][0], more * sizes)
        assert [t.decode() for t in file["gauges/error_part"]] == [
            "reading", "zero", "head", "epoch", "along",
        ]  # fmt: skip
        assert file["gauges/survey"].asstr()[0] == "tape"
        np.testing.assert_allclose(file["readings/own_sd"][()], more * 6e-6)
        np.testing.assert_allclose(file["readings/sd"][()], more * 1e-6 * ROOMY_TOTAL)
    assert "accuracies" not in found
    # the error of a zero is known in part: a band is narrower than the accuracy of the gauge
    (found,) = run_json("fit", "case.yaml", "--force", "--set", "fit.model_error=none")
    sd = {p["gauge"]: p["sd"] for p in found["predictions"]}
    assert sd["S1"] < 1e-6 * ROOMY_TOTAL


def test_accuracies_stated_too_good_are_told_from_a_model_error_as_far_as_can_be(site, run_json):
    """With the one stage that is read they cannot."""
    site(SHARED)
    (found,) = run_json("fit", "case.yaml")
    (finding,) = [text for text in said_findings(found) if "cannot separate a model error" in text]
    assert "times less accurate than stated" in finding
    assert "'accuracies: estimate' under 'fit'" in finding
    assert found["model_error"]["size"] > 0.1


@pytest.mark.slow  # one of them: below, and of a model error `test_a_fit_knows_what_is_shared...`
def test_accuracies_and_a_model_error_are_estimated_together(site, run_json):
    site(SHARED)
    both = ("--set", "fit.accuracies=estimate", "--set", "fit.stages=[first, second]")
    (found,) = run_json("fit", "case.yaml", *both)
    assert not [note for note in found["notes"] if "did not come to rest" in note]
    assert found["model_error"]["lower95"] < found["model_error"]["size"]
    for entry in found["accuracies"]:
        assert 1.0 < entry["factor"] < 5.0


@pytest.mark.usefixtures("plain_pictures")
def test_accuracies_stated_three_times_too_good_are_found(site, run, run_json):
    site(SHARED, fit=", model_error: none")
    (stated,) = run_json("fit", "case.yaml")
    (finding,) = [text for text in said_findings(stated) if "stated accuracies" in text]
    assert "write 'accuracies: estimate' under 'fit'" in finding
    (found,) = run_json("fit", "case.yaml", "--force", "--set", "fit.accuracies=estimate",
                        "--set", "fit.stages=[first, second]")  # fmt: skip
    factors = {entry["errors"]: entry for entry in found["accuracies"]}
    assert set(factors) == {"convergence", "settlement", "extensometer"}
    one = factors["settlement"]
    assert one["lower95"] < 3.0 < one["upper95"]
    assert one["lower95"] < one["factor"] < one["upper95"]
    assert not [text for text in said_findings(found) if "as large as the stated" in text]
    assert found["parameters"]["E"]["sd"] > 1.5 * stated["parameters"]["E"]["sd"]
    for name, truth in (("E", 5e9), ("K0", 1.5)):
        assert found["parameters"][name]["lower95"] < truth < found["parameters"][name]["upper95"]
    shown = run("show", "case.fit.h5").stdout
    assert "Accuracies estimated from the residuals" in shown
    assert "times what is stated" in shown
    assert json.loads(run("show", "--json", "case.fit.h5").stdout)["accuracies"]
    with h5py.File("case.fit.h5") as file:
        np.testing.assert_allclose(
            sorted(file["accuracies/values"]), sorted(e["factor"] for e in found["accuracies"])
        )
        sized = file["gauges/error_sd"][2]
        np.testing.assert_allclose(sized[:4], one["factor"] * np.array([2e-6, 4e-6, 3e-6, 4e-6]))
    text = run("export", "case.fit.h5", "--table", "accuracies").stdout
    assert text.startswith("errors,sd,factor,lower95,upper95,unit,determined")
    assert run("report", "case.fit.h5").exit_code == 0


def test_accuracies_that_do_not_come_to_rest_are_said(site, run_json, monkeypatch):
    monkeypatch.setattr(accuracies, "ROUNDS", 1)
    site(SHARED, fit=", model_error: none, accuracies: estimate")
    (found,) = run_json("fit", "case.yaml")
    said = "arameters and estimated accuracies did not come to rest in 1 rounds"
    assert any(said in note for note in found["notes"])


def test_one_accuracy_for_a_kind_from_scratch(site, run, run_json):
    site("estimate", fit=", model_error: none")
    assert "estimate" in run("check", "case.yaml").stdout
    (found,) = run_json("fit", "case.yaml", "--set", "fit.stages=[first, second]")
    names = [entry["errors"] for entry in found["accuracies"]]
    assert names == ["convergence: reading", "settlement: reading", "extensometer: reading"]
    for entry in found["accuracies"]:
        assert entry["part"] == "reading"
        assert entry["unit"] == "m"
        assert 2e-6 < entry["sd"] < 100e-6


def test_too_few_readings_to_estimate_are_refused(site, run, trench):
    site("estimate")
    (trench / "readings.csv").write_text(
        "gauge,stage,value,unit\nCV,first,-0.6,mm\nS1,first,-0.12,mm\n"
    )
    done = run("fit", "case.yaml")
    assert done.exit_code == 3
    said = " ".join(done.stderr.split())
    assert "2 usable readings cannot determine 2 parameters (E, K0) and how accurate" in said


OWN = """\
gauge,stage,value,unit,accuracy
CV,first,-0.598,mm,
S,first,-0.1226,mm,
X.a,first,0.0627,mm,
CV,second,-1.277,mm,0.2
S,second,0.2376,mm,0.2
X.a,second,0.102,mm,0.2
"""
"""The gauges read within 0.01 mm; in the second stage they were read within 0.2 mm, as it says."""


@pytest.fixture
def coarsely_read(trench):
    (trench / "readings.csv").write_text(OWN)


def of_stage(found, stage, what):
    return {one["gauge"]: one[what] for one in found["predictions"] if one["stage"] == stage}


PARTS = "{reading: 0.008 mm, zero: 0.006 mm, head: 0 mm, epoch: 0 mm}"


@pytest.mark.usefixtures("coarsely_read")
@pytest.mark.parametrize("zero", [0.0, 6e-6])
def test_a_later_reading_is_judged_by_its_own_accuracy(trench, zero, run, run_json):
    """sd^2 = J cov J^T + 0.2^2, and of a zero what the fit leaves of it."""
    if zero:
        text = (trench / "case.yaml").read_text()
        (trench / "case.yaml").write_text(text.replace("accuracy: 0.01 mm", f"accuracy: {PARTS}"))
    (fit,) = run_json("fit", "case.yaml", "--set", "fit.model_error=none")
    (found,) = run_json("predict", "case.fit.h5")
    for one in (fit, found):
        for sd in of_stage(one, "second", "sd").values():
            assert 0.2e-3 < sd < 0.2015e-3
    said = " ".join(run("show", "case.predict.h5").stdout.split())
    assert "Predicted stage 'second': 3 of 3 readings inside the 95 % band" in said
    assert run("sample", "case.fit.h5", "--draws", "400", "--effective", "100").exit_code in (0, 4)
    (drawn,) = run_json("show", "case.sample.h5")
    for sd in of_stage(drawn, "second", "sd").values():
        assert 0.17e-3 < sd < 0.23e-3


@pytest.mark.usefixtures("coarsely_read")
def test_a_backtest_judges_readings_by_their_own_accuracy(run, run_json):
    ended = run("backtest", "case.yaml")
    assert ended.exit_code == 0, ended.stderr
    assert "3 of 3 readings of the next stage are inside their bands" in ended.stderr
    (found,) = run_json("show", "case.backtest.h5")
    score = found["backtest"]["next"]
    assert score["inside"] == 3
    # the density of a normal reading within about one accuracy, in accuracies: about -1.4
    assert -2.5 < score["log_score"] < -0.9


@pytest.mark.usefixtures("coarsely_read")
def test_a_residual_is_said_in_the_accuracy_of_its_own_reading(trench, run_json):
    """0.17 mm off: with an accuracy of 0.2 mm nothing is said, 8.3 times one of 0.02 mm is."""
    whole = ("fit", "case.yaml", "--force", "--set", "fit.stages=[first, second]")
    (found,) = run_json(*whole)
    assert not [text for text in said_findings(found) if "accuracies" in text or "against" in text]
    (trench / "readings.csv").write_text(OWN.replace("0.102,mm,0.2", "0.102,mm,0.02"))
    (found,) = run_json(*whole, "--set", "fit.model_error=none")
    (said,) = [text for text in said_findings(found) if "of its accuracies" in text]
    assert said.startswith("X.a at second is 0.167 mm from what is computed, 8.3 of its accuracies")


def test_the_model_meets_readings_within_their_own_accuracies(site, trench, run, run_json):
    site("0.01 mm")
    header, *rows = (trench / "readings.csv").read_text().splitlines()
    own = [f"{row},{'0.05' if row.startswith('X.a') else ''}" for row in rows]
    (trench / "readings.csv").write_text("\n".join([f"{header},accuracy", *own]) + "\n")
    (found,) = run_json("fit", "case.yaml", "--set", "fit.stages=[first, second]")
    assert {row["gauge"] for row in found["gauges"] if row["sd"] > 2e-5} == {"X.a"}
    shown = " ".join(run("show", "case.fit.h5").stdout.split())
    (least, most) = (f"{1e3 * end(row['sd'] for row in found['gauges']):.2g}" for end in (min, max))
    assert f"The model meets the readings within {least} to {most} mm and" in shown


DATED = (
    "dates: {first: 2024-03-01, second: 2024-04-01}\n"
    "readings: {file: readings.csv, repeated_readings: S}"
)
SEVERAL = """\
gauge,date,value,unit,accuracy
CV,2024-03-02,-0.598,mm,
S,2024-03-02,-0.1226,mm,
X.a,2024-03-02,0.0627,mm,
CV,2024-04-02,-1.077,mm,0.2
CV,2024-04-03,-1.079,mm,
S,2024-04-02,0.0376,mm,
S,2024-04-03,0.0380,mm,
S,2024-04-04,0.0384,mm,
S,2024-04-05,0.0380,mm,
X.a,2024-04-02,0.282,mm,0.3
X.a,2024-04-03,0.282,mm,0.4
"""


@pytest.mark.parametrize(
    ("several", "sd"),
    [  # of a mean the root of the sum of squares by n; of all the weighted mean is what is judged
        ("mean", {"CV": np.hypot(0.2, 0.01) / 2, "S": 0.01 / 2, "X.a": np.hypot(0.3, 0.4) / 2}),
        ("all", {"CV": 0.01 / np.hypot(1, 0.05), "S": 0.01 / 2, "X.a": 0.24}),
        ("last", {"CV": 0.01, "S": 0.01, "X.a": 0.4}),
    ],
)
def test_several_readings_of_a_stage_are_judged_by_what_they_are_worth(
    trench, several, sd, run_json
):
    text = (trench / "case.yaml").read_text()
    text = text.replace("readings: readings.csv", DATED.replace("S}", f"{several}}}"))
    (trench / "case.yaml").write_text(text)
    (trench / "readings.csv").write_text(SEVERAL)
    (found,) = run_json("fit", "case.yaml", "--set", "fit.model_error=none")
    read = {row["gauge"]: 1e3 * row["sd"] for row in found["gauges"] if row["stage"] == "second"}
    assert read == pytest.approx(sd, rel=1e-9)
    alone = run_json("predict", "case.fit.h5")[0]
    fit = read_result("case.fit.h5")  # what the parameters add to it
    J = fit.sensitivity[:, 1]
    by_parameters = np.sqrt(np.einsum("ij,jk,ik->i", J, fit.parameters.covariance, J))
    expected = np.hypot(1e-3 * np.array([sd["CV"], sd["S"], sd["X.a"]]), by_parameters)
    for one in (found, alone):
        np.testing.assert_allclose(
            list(of_stage(one, "second", "sd").values()), expected, rtol=0.02
        )


def test_a_residual_is_said_in_stated_accuracies_where_the_fit_has_found_larger_ones(
    site, run_json
):
    site("0.002 mm")
    (found,) = run_json("fit", "case.yaml", "--set", "fit.stages=[first, second]")
    rows = [row for row in found["gauges"] if row["used"]]
    assert min(row["sd"] for row in rows) > 2.5e-6
    most = max(abs(row["measured"] - row["computed"]) for row in rows)
    (said,) = [text for text in said_findings(found) if "of its accuracies" in text]
    assert f"{1e3 * most:.3g} mm from what is computed, {most / 2e-6:.1f} of its" in said


def test_several_readings_share_their_zero_which_does_not_average_out(trench, run_json):
    """In the table beside the band: readings of 8 um, of two the root of a half, a zero of 6 um."""
    text = (trench / "case.yaml").read_text().replace("accuracy: 0.01 mm", f"accuracy: {PARTS}")
    text = text.replace("readings: readings.csv", DATED.replace("S}", "all}"))
    (trench / "case.yaml").write_text(text)
    (trench / "readings.csv").write_text(SEVERAL)
    (found,) = run_json("fit", "case.yaml", "--set", "fit.model_error=none")
    read = {row["gauge"]: row["sd"] for row in found["gauges"] if row["stage"] == "second"}
    assert read["S"] == pytest.approx(np.hypot(8e-6 / 2, 6e-6), rel=1e-9)

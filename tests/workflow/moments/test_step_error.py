"""The error of readings by the steps in time, beside Terzaghi's column, whose answer is known."""

import json
import re

import numpy as np
import pytest
from support.column import DAY, FILL, E, K, settlement, write_column
from support.commands import run_command

from geoident.io.result.file import read_result

DAYS = (30, 50, 70, 100, 130, 160, 200)
STAGES = f"  - {{name: fill, lasts: 400 d, moments: [300 d], {FILL}}}"
SAID = re.compile(r"error by the steps in time is at most ([\d.]+) mm at S1 in fill, [\d.]+ acc")


def write(folder, accuracy, *, more="", fit=", model_error: none"):
    """A column read seven times with errors of an accuracy, mm; its end is to be predicted."""
    rng = np.random.default_rng(1)
    read = {d: 1e3 * settlement(d * DAY)[0] + accuracy * rng.normal() for d in DAYS}
    rows = [f"S1,fill + {d} d,{value:.5f},mm" for d, value in read.items()]
    (folder / "read.csv").write_text("\n".join(["gauge,stage,value,unit", *rows, ""]))
    case = write_column(folder, stages=STAGES, more=f"readings: read.csv\n{more}", fit=fit)
    case.write_text(case.read_text().replace("accuracy: 0.2 mm", f"accuracy: {accuracy} mm"))
    return case


def fitted(case, *overrides):
    done = run_command("fit", case, *(f"--set={one}" for one in overrides))
    assert done.exit_code == 0, done.output
    result = read_result(case.with_name("case.fit.h5"))
    words = " ".join(f.sentence for f in result.findings if f.kind == "step-error")
    return result, words, " ".join(note for note in result.notes if "steps in time" in note)


def exact(result):
    """Settlements (n_stages,) at the parameters of a fit, m."""
    e, k = result.parameters.values
    since = result.gauges.times.since
    return settlement(since * (e * k) / (E * K)) * E / e


def test_coarse_steps_are_told_and_counted(tmp_path):
    case = write(tmp_path, 0.02, more="time_steps: 2\n")
    result, words, _ = fitted(case)
    told, true = result.gauges.step_errors[0], exact(result) - result.gauges.computed[0]
    large = np.abs(true) > 8e-5  # the mesh adds 3e-5 m
    assert np.count_nonzero(large) >= 4
    np.testing.assert_array_less(1.0 / 3.0, (told / true)[large])
    np.testing.assert_array_less((told / true)[large], 3.0)
    # without them E is off by three of its standard deviations
    parameters, prediction = result.parameters, result.prediction
    for n, value in enumerate((E, K)):
        assert parameters.lower95[n] < value < parameters.upper95[n]
    truth = settlement(result.gauges.times.since)
    ahead = np.isfinite(prediction.mean[0])
    assert np.count_nonzero(ahead) == 2
    np.testing.assert_array_less(prediction.lower95[0, ahead], truth[ahead])
    np.testing.assert_array_less(truth[ahead], prediction.upper95[0, ahead])

    # a prediction has them, too
    assert run_command("predict", tmp_path / "case.fit.h5").exit_code == 0
    again = read_result(tmp_path / "case.predict.h5")
    np.testing.assert_allclose(again.prediction.sd, prediction.sd, rtol=1e-6)

    # another case has those of its own steps
    coarse = tmp_path / "coarse.yaml"
    coarse.write_text(case.read_text().replace("time_steps: 2", "time_steps: 1"))
    done = run_command(
        "predict", tmp_path / "case.fit.h5", "--case", coarse, "-o", tmp_path / "c.h5"
    )
    assert done.exit_code == 0, done.output
    other = read_result(tmp_path / "c.h5")
    at = other.gauges.stages.index("fill")
    off = exact(other)[at] - other.gauges.computed[0, at]
    assert other.gauges.step_errors[0, at] == pytest.approx(off, rel=0.2)
    assert SAID.search(" ".join(other.notes))
    assert other.prediction.lower95[0, at] < truth[-1] < other.prediction.upper95[0, at]

    # the remedy of the finding makes it a note
    assert "Intervals and bands allow for it." in words
    remedy = re.search(r"Write 'time_steps: (\d+)' in the case: (\d+) times as many", words)
    assert remedy is not None
    assert int(remedy[1]) == 2 * int(remedy[2])
    (tmp_path / "case.fit.h5").unlink()
    better, words, note = fitted(case, f"time_steps={remedy[1]}")
    assert words == ""
    assert "at most" in note
    assert better.gauges.step_errors is None


def test_usual_steps_are_told_and_change_no_band(tmp_path):
    result, words, note = fitted(write(tmp_path, 0.2))
    assert words == ""
    size, share = re.search(r"at most ([\d.]+) mm at S1 in .*, ([\d.]+) accuracies", note).groups()
    assert float(size) < 0.04
    assert float(share) == pytest.approx(float(size) / 0.2, rel=0.05)
    assert result.gauges.step_errors is None


def test_gauges_better_than_stated_notice_the_steps(tmp_path):
    case = write(
        tmp_path, 0.05, more="time_steps: 2\n", fit=", model_error: none, accuracies: estimate"
    )
    case.write_text(case.read_text().replace("accuracy: 0.05 mm", "accuracy: 5 mm"))
    result, words, _ = fitted(case)
    assert "Write 'time_steps: " in words
    assert result.gauges.step_errors is not None


def test_check_says_how_many_steps_there_are(tmp_path):
    for of_each in (6, 7):  # six lengths, and two steps more
        said = run_command("check", write(tmp_path, 0.2), f"--set=time_steps={of_each}").stdout
        assert f"take {6 * of_each + 2} steps in time" in " ".join(said.split())


def test_check_tells_the_error_at_the_start(tmp_path):
    case = write(tmp_path, 0.2, more="time_steps: 1\n")
    at = ("--set=parameters.E.start=4 MPa", "--set=parameters.k.start=2e-9 m/s")
    said = json.loads(run_command("check", case, "--mesh-error", "--json", *at).stdout)
    (computed,) = (row["computed"] for row in said["readings"] if row["stage"] == "fill")
    told = next(found for note in said["notes"] if (found := SAID.search(note)))
    true = 1e3 * abs(settlement(400 * DAY)[0] - computed)
    assert float(told[1]) == pytest.approx(true, rel=0.1)

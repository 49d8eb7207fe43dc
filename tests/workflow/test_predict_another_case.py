"""Predictions of another case than that of a fit: of which gauges the fit knows the errors.

The model is v = w t c with one unknown c, weights w of gauges and t of stages. With errors of
zeros z everything is Gaussian, so what a prediction and its band must be follows from the joint
normal distribution of c, z and the readings.
"""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from geoident.io.result.file import read_result, write_result
from geoident.model.results.findings import Finding, sentences_of
from tests.support.commands import run_command, said_findings
from tests.support.trench import CASE, READINGS, write_case

SCRIPT = """\
W = {weights}
T = {{"begin": 0.0, "one": 1.0, "two": 2.0, "three": 3.5}}


def readings(values):
    return {{g: {{s: 1e-3 * w * t * values["c"] for s, t in T.items()}} for g, w in W.items()}}
"""
SECTION = """\
format: geoident-case/1
model: {{kind: python, function: "{name}:readings"}}
parameters:
  c: {{start: 5, bounds: [-1000, 1000]}}
stages: [{{name: begin}}, {{name: one}}, {{name: two}}, {{name: three}}]
gauges:
  P: {{kind: reading, zero: begin, accuracy: {{reading: 0.1 mm, zero: 0.3 mm}}}}
  Q: {{kind: reading, zero: begin, accuracy: {{reading: 0.2 mm, zero: 0.4 mm}}}}
readings: {name}.csv
fit: {{backtest: false, stages: [one, two]}}
"""
READ = {("P", "one"): 11.02, ("P", "two"): 21.1, ("Q", "one"): 19.3, ("Q", "two"): 39.2}
LATER = {("P", "three"): 36.0, ("Q", "three"): 69.0}
OWN, ZERO = {"P": 0.1, "Q": 0.2}, {"P": 0.3, "Q": 0.4}
TIMES = {"one": 1.0, "two": 2.0, "three": 3.5}
A, B = {"P": 1.0, "Q": 2.0}, {"P": 3.0, "Q": 0.5}


def write_section(folder, name, weights, read, text=SECTION):
    (folder / f"{name}.py").write_text(SCRIPT.format(weights=weights))
    rows = [f"{gauge},{stage},{value},mm\n" for (gauge, stage), value in read.items()]
    (folder / f"{name}.csv").write_text("gauge,stage,value,unit\n" + "".join(rows))
    (folder / f"{name}.yaml").write_text(text.format(name=name))


@pytest.fixture(scope="module")
def once_fitted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fitted")
    write_section(folder, "a", A, READ | LATER)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        done = run_command("fit", "a.yaml", "--trust", "-q")
    assert done.exit_code in (0, 4), done.output
    return folder


@pytest.fixture
def fitted(once_fitted, tmp_path, monkeypatch):
    """The section A, fitted to its readings of the stages one and two."""
    shutil.copytree(once_fitted, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def predicted(*words):
    done = run_command("predict", "a.fit.h5", "--trust", *words, "-o", "new.h5", "--force")
    assert done.exit_code == 0, done.output
    found = json.loads(run_command("show", "new.h5", "--json").stdout)
    bands = {
        (row["gauge"], row["stage"]): (1e3 * row["mean"], 1e3 * row["sd"])
        for row in found["predictions"]
    }
    return bands, found, " ".join(done.stderr.split())


def expected(weights, places, *, same_zeros):
    """Mean and standard deviation, mm: c and the zeros of A from its readings, then what follows.

    Posterior of x = (c, z_P, z_Q) of a flat prior of c: of the normal equations.
    """
    gauges = list(ZERO)
    rows = [[A[g] * TIMES[s], *(float(g == one) for one in gauges)] for g, s in READ]
    H, weight = np.array(rows), np.array([OWN[g] ** -2 for g, _ in READ])
    prior = np.diag([0.0, *(ZERO[g] ** -2 for g in gauges)])
    covariance = np.linalg.inv(H.T @ (weight[:, None] * H) + prior)
    x = covariance @ H.T @ (weight * np.array(list(READ.values())))
    found = {}
    for gauge, stage in places:
        h = np.array([weights[gauge] * TIMES[stage], *(float(gauge == one) for one in gauges)])
        if same_zeros:
            found[gauge, stage] = h @ x, np.sqrt(h @ covariance @ h + OWN[gauge] ** 2)
        else:
            variance = h[0] ** 2 * covariance[0, 0] + ZERO[gauge] ** 2 + OWN[gauge] ** 2
            found[gauge, stage] = h[0] * x[0], np.sqrt(variance)
    return found


def test_another_section_takes_over_no_error_of_a_gauge_of_the_same_name(fitted):
    read = {place: 0.99 * B[place[0]] * TIMES[place[1]] * 10 for place in READ | LATER}
    write_section(fitted, "b", B, read)
    bands, found, said = predicted("--case", "b.yaml")
    truth = expected(B, READ | LATER, same_zeros=False)
    assert bands.keys() == truth.keys()  # all stages: the fit has used no reading of this section
    for place, (mean, sd) in truth.items():
        assert bands[place] == pytest.approx((mean, sd), rel=1e-6), place
    assert not any(row["used"] for row in found["gauges"])
    assert "errors of gauges that the fit has estimated are not used" in said
    assert "P at one" in said
    # what the fit says of its own readings is not said of those of the same names
    before = said_findings(json.loads(run_command("show", "a.fit.h5", "--json").stdout))
    assert any("most influential reading" in text for text in before)
    assert said_findings(found)[1:] == [f"Of the fit: {text}" for text in before]


def test_a_prediction_does_not_repeat_the_collapses_of_its_fit(fitted):
    """It has its own, of what it computed."""
    fit = read_result("a.fit.h5")
    fallen = Finding("collapse", "three", "With these parameters, the ground falls at stage three.")
    write_result(replace(fit, findings=(fallen, *fit.findings)), "a.fit.h5", overwrite=True)
    _, found, _ = predicted()
    assert said_findings(found) == list(sentences_of(fit.findings))


def test_the_same_section_with_later_readings_keeps_the_zeros_of_its_gauges(fitted):
    """Read once more at the stage two as well, which changes nothing of what the fit used."""
    write_section(fitted, "b", A, READ | LATER)
    bands, found, said = predicted("--case", "b.yaml")
    truth = expected(A, LATER, same_zeros=True)
    assert bands.keys() == truth.keys()
    for place, (mean, sd) in truth.items():
        assert bands[place] == pytest.approx((mean, sd), rel=1e-6), place
    assert sum(row["used"] for row in found["gauges"]) == len(READ)
    assert "its gauges are those of the fit" in said
    alone, _, said = predicted()
    assert alone == bands
    assert "its gauges are" not in said


def test_the_error_of_a_zero_that_a_gauge_of_values_states_is_shared(tmp_path, monkeypatch):
    """Such as that of a pressure cell before it was built in: it has no stage, and is in all."""
    monkeypatch.chdir(tmp_path)
    write_section(tmp_path, "a", A, READ | LATER, SECTION.replace("zero: begin, ", ""))
    assert run_command("fit", "a.yaml", "--trust", "-q").exit_code in (0, 4)
    bands, _, _ = predicted()
    for place, (mean, sd) in expected(A, LATER, same_zeros=True).items():
        assert bands[place] == pytest.approx((mean, sd), rel=1e-6), place


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("zero: 0.3 mm", "zero: 0.31 mm"), "the gauge 'P' is written otherwise"),
        (("zero: begin", "zero: one"), "the gauge 'P' is written otherwise"),
        (("readings: b.csv", "readings: []"), "the reading of P at one"),
    ],
)
def test_what_makes_gauges_others_is_said(fitted, change, words):
    write_section(fitted, "b", A, READ | LATER)
    text = (fitted / "b.yaml").read_text()
    (fitted / "b.yaml").write_text(text.replace(change[0], change[1], 1))
    bands, _, said = predicted("--case", "b.yaml", "--stages", "three")
    assert words in said
    if "begin" in change[0]:
        return
    for place, (mean, sd) in expected(A, LATER, same_zeros=False).items():
        assert bands[place] == pytest.approx((mean, sd), rel=0.03), place


def test_a_further_reading_of_a_stage_that_was_fitted_is_not_said_to_be_used(fitted):
    write_section(fitted, "b", A, READ | LATER)
    with (fitted / "b.csv").open("a") as file:
        file.write("P,two,25,mm\n")
    text = (fitted / "b.yaml").read_text()
    text = text.replace("readings: b.csv", "readings: {file: b.csv, repeated_readings: all}")
    (fitted / "b.yaml").write_text(text)
    _, found, said = predicted("--case", "b.yaml")
    assert "its gauges are those of the fit" in said
    (further,) = [row for row in found["readings"] if row["value"] == 25e-3]
    assert further["reason"] == "the fit has not used it"
    assert sum(row["used"] for row in found["readings"]) == len(READ)
    (row,) = [r for r in found["gauges"] if (r["gauge"], r["stage"]) == ("P", "two")]
    assert 1e3 * row["measured"] == pytest.approx(READ["P", "two"])


def test_a_corrected_reading_makes_the_case_another(fitted):
    write_section(fitted, "b", A, READ | LATER | {("Q", "two"): 39.4})
    _, found, said = predicted("--case", "b.yaml")
    assert "the reading of Q at two" in said
    assert not any(row["used"] for row in found["gauges"])


ERRORS = "{reading: 0.01 mm, zero: 0.02 mm, head: 0 mm, epoch: 0.01 mm}"
CHANGED = "readings: other.csv"


def fitted_trench(folder, *, scattering=False):
    """The trench and a fit of E with shared errors and a model error of 10 %.

    Or of readings that scatter more than their accuracies, in which the fit finds a factor.
    """
    text = CASE.replace("$K0", "1.5").replace("  K0: {start", "  # {start")
    text, readings = text.replace("accuracy: 0.01 mm", f"accuracy: {ERRORS}"), READINGS
    if scattering:
        text, readings = text.replace(ERRORS, "0.005 mm"), ROUGH
        text = text.replace("stages: [first]", "backtest: false, stages: [first, second]")
        text = text.replace("gauges:\n", "  - {name: third}\ngauges:\n")
    else:
        text = text.replace("mesh_error: false", "model_error: 10 %")
    write_case(folder).write_text(text)
    (folder / "readings.csv").write_text(readings)
    assert run_command("fit", "case.yaml", "-q").exit_code in (0, 4)


ROUGH = """\
gauge,stage,value,unit,accuracy
CV,first,-0.590,mm,
S,first,-0.133,mm,
X.a,first,0.044,mm,
CV,second,-1.100,mm,
S,second,0.0576,mm,0.02
X.a,second,0.262,mm,0.03
CV,third,-1.077,mm,0.2
S,third,0.0376,mm,
"""
"""Scattering more than gauges of 0.005 mm; some with an accuracy of their own."""


def bands_of(folder, case, *words):
    path = folder / case.replace(".yaml", ".predict.h5")
    more = () if case == "case.yaml" else ("--case", case)
    done = run_command("predict", "case.fit.h5", *more, *words, "-o", path)
    assert done.exit_code == 0, done.output
    return read_result(str(path))


@pytest.mark.parametrize("scattering", [False, True])
def test_a_copy_of_the_case_is_predicted_as_the_case_itself(tmp_path, monkeypatch, scattering):
    """With all that its readings tell of shared errors, of the model's and of the scatter."""
    monkeypatch.chdir(tmp_path)
    fitted_trench(tmp_path, scattering=scattering)
    assert (read_result("case.fit.h5").model_error.factor > 1.2) == scattering
    (tmp_path / "copy.yaml").write_text((tmp_path / "case.yaml").read_text())
    one, other = bands_of(tmp_path, "case.yaml"), bands_of(tmp_path, "copy.yaml")
    for name in ("mean", "sd", "lower95", "upper95"):
        mine, theirs = getattr(one.prediction, name), getattr(other.prediction, name)
        np.testing.assert_allclose(theirs, mine, rtol=1e-9)
    np.testing.assert_allclose(other.gauges.sd, one.gauges.sd, rtol=1e-12)
    assert np.isfinite(one.prediction.sd).any()


def test_the_model_error_of_another_section_is_unknown_and_as_large(tmp_path, monkeypatch):
    """Of the first stage, one step D: sd^2 = J cov J^T + errors of the gauge + (0.1 D)^2 and more.

    More is what a reading has however little it changes: at most a tenth of the gauges' motion.
    """
    monkeypatch.chdir(tmp_path)
    fitted_trench(tmp_path)
    rows = "gauge,stage,value,unit\nCV,first,-0.7,mm\n"
    (tmp_path / "other.csv").write_text(rows)
    text = (tmp_path / "case.yaml").read_text().replace("readings: readings.csv", CHANGED)
    (tmp_path / "section.yaml").write_text(text)
    found, alone = bands_of(tmp_path, "section.yaml"), read_result("case.fit.h5")
    J, covariance = found.sensitivity[:, 0], alone.parameters.covariance
    parameters = np.einsum("ij,jk,ik->i", J, covariance, J)
    step = found.gauges.computed[:, 0]
    gauge = 1e-10 + 4e-10 + 1e-10  # reading, zero, set-up
    whole = np.sqrt(parameters + gauge + (0.1 * step) ** 2)
    np.testing.assert_allclose(found.prediction.mean[:, 0], step, rtol=1e-12)
    assert np.all(found.prediction.sd[:, 0] >= whole * (1 - 1e-6))
    more = np.sqrt(found.prediction.sd[:, 0] ** 2 - whole**2 * (1 - 1e-6))
    assert np.all(more < 0.1 * 0.1 * 2 * np.abs(step).max())
    assert not found.gauges.used.any()

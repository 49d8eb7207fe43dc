"""The command, and how its result is shown, drawn, exported and compared."""

import csv
import io
import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from geoident.io.result.file import read_result
from geoident.report.drawing.backtest import settling_figure
from geoident.report.text.gauges import reading_table
from geoident.report.text.residuals import rms
from geoident.report.text.result import outcome_sentences
from tests.support.lifts import LIFTS, SAME, TWO_ROCKS, readings_of, write_case, write_readings
from tests.support.pictures import laid_out


def write_pit(folder):
    path = write_case(folder)
    write_readings(folder, readings_of(path, SAME, seed=1))


@pytest.fixture
def pit(after):
    return after(write=write_pit)


@pytest.fixture
def tested(after):
    """The pit with its backtest."""
    return after(("backtest", "case.yaml"), write=write_pit)


def test_its_path_on_stdout_the_rest_on_stderr(pit, run):
    done = run("backtest", "case.yaml")
    assert (done.exit_code, done.stdout) == (0, "case.backtest.h5\n")
    assert "up to lift 2: converged, 8 readings" in done.stderr
    assert "The 95 % bands hold" in done.stderr
    assert "geoident report case.backtest.h5" in done.stderr
    assert not list(pit.glob("*.checkpoint"))
    assert not list(pit.glob("*.vtkhdf"))


def test_exit_code_4_says_why(pit, run):
    write_readings(pit, readings_of(pit / "case.yaml", TWO_ROCKS, seed=1))
    done = run("backtest", "-q", "case.yaml")
    assert done.exit_code == 4
    assert "bands-fail: The 95 % bands do not hold" in done.stderr


def test_a_result_of_the_same_input_is_kept_and_of_another_is_not_lost(tested, run):
    before = (tested / "case.backtest.h5").read_bytes()
    assert "up to date" in run("backtest", "case.yaml").stderr
    assert (tested / "case.backtest.h5").read_bytes() == before
    other = ("backtest", "case.yaml", "--set", "parameters.E.start=3 GPa")
    assert run(*other).exit_code == 0
    assert (tested / "case.backtest.1.h5").read_bytes() == before


def test_json_has_all_of_it(pit, run_json):
    (found,) = run_json("backtest", "case.yaml")
    told = found["backtest"]
    assert [fit["up_to"] for fit in told["fits"]] == list(LIFTS)
    assert told["next"]["readings"] == 15
    assert told["next"]["coverage"] == told["next"]["inside"] / 15
    ahead = [one for one in told["predictions"] if one["next"]]
    assert len(ahead) == 15
    assert {one["unit"] for one in ahead} == {"m"}
    assert all(one["lower95"] < one["mean"] < one["upper95"] for one in ahead)
    assert told["fits"][0]["parameters"]["E"]["unit"] == "Pa"


def test_the_picture_of_what_settles_is_in_the_unit_that_it_names(tested, run):
    result = read_result("case.backtest.h5")
    figure = laid_out(lambda: settling_figure(result, result.backtest))
    (axes,) = [one for one in figure.axes if one.get_title(loc="left") == "E (GPa)"]
    (told,) = [json.loads(run("show", "--json", "case.backtest.h5").stdout)]
    fits = [fit["parameters"]["E"] for fit in told["backtest"]["fits"]]
    np.testing.assert_allclose(axes.get_lines()[0].get_ydata(), [1e-9 * f["value"] for f in fits])
    bars = np.array(axes.collections[0].get_segments())[:, :, 1]
    np.testing.assert_allclose(bars, [[1e-9 * f["lower95"], 1e-9 * f["upper95"]] for f in fits])


@pytest.mark.usefixtures("tested")
def test_a_backtest_up_to_a_stage_that_is_not_there_is_damaged(run):
    with h5py.File("case.backtest.h5", "r+") as file:
        file["backtest/last"][0] = 99
    refused = run("show", "case.backtest.h5")
    assert refused.exit_code == 3
    assert "names a stage that is not there" in refused.stderr


def test_show_has_tables_of_fits_scores_and_errors(tested, run):
    shown = run("show", "case.backtest.h5").stdout
    assert "Fits of the first stages" in shown
    assert "next           15" in shown
    lines = shown.splitlines()
    header = next(line.split() for line in lines if line.startswith("gauge  lift 2"))
    assert header == ["gauge", "lift", "2", "lift", "3", "lift", "4"]
    assert "E is constant within its intervals: " in " ".join(shown.split())


def test_show_fits_a_terminal_of_80_columns(pit, run):
    """Also with five parameters, of which each fit says value and interval."""
    changed = (pit / "case.yaml").read_text()
    for n in range(3):
        number = (
            f"E{n}: {{start: 2 GPa, bounds: [0.1 GPa, 50 GPa], prior: {{mean: 5 GPa, sd: 1 GPa}}}}"
        )
        changed = changed.replace("parameters:\n", f"parameters:\n  {number}\n")
    changed = changed.replace("materials:\n", "materials:\n  a: {E: $E0, nu: 0.2}\n"
                              "  b: {E: $E1, nu: 0.2}\n  c: {E: $E2, nu: 0.2}\n")  # fmt: skip
    for n, name in enumerate(("lift-1", "lift-2", "lift-3")):
        changed = changed.replace(f"{name}: rock", f"{name}: {'abc'[n]}")
    (pit / "case.yaml").write_text(changed)
    done = run("backtest", "case.yaml")
    assert done.exit_code in (0, 4), done.output
    shown = run("show", "case.backtest.h5").stdout
    part = shown.split("Fits of the first stages")[1].split("Scores of the predictions")[0]
    assert max(map(len, part.splitlines())) <= 80
    assert part.count("up to ") >= 2
    assert "E2 (GPa)" in part


@pytest.mark.usefixtures("plain_pictures")
def test_the_page_has_both_figures(tested, run):
    assert run("report", "case.backtest.h5").exit_code == 0
    page = (tested / "case.backtest.html").read_text()
    for title in ("Parameters as readings are added", "Predictions against later readings",
                  "further ahead, last fitted &gt; predicted stage"):  # fmt: skip
        assert title in page


def test_export_writes_predictions_and_parameters(tested, run):
    run("export", "case.backtest.h5", "-o", "out")
    text = (tested / "out" / "case.backtest.backtest.csv").read_text()
    rows = list(csv.DictReader(io.StringIO(text)))
    assert len(rows) == 30  # 15 of the next stage, 15 further ahead
    assert {row["unit"] for row in rows} == {"mm"}
    first = rows[0]
    assert (first["up_to"], first["stage"], first["next"]) == ("lift 1", "lift 2", "yes")
    low, high, read = (float(first[name]) for name in ("lower95", "upper95", "measured"))
    assert low < read < high
    table = run("export", "case.backtest.h5", "--table", "backtest-parameters").stdout
    assert len(table.splitlines()) == 1 + 4 * 2


def test_the_file_is_plain_hdf5(tested, run):
    with h5py.File("case.backtest.h5") as file:
        group = file["backtest"]
        assert group["fit"].asstr()[:].tolist() == list(LIFTS)
        assert group["mean"].shape == (4, 5, 4)
        assert [d.keys()[0] for d in group["mean"].dims] == ["fit", "gauge", "stage"]
        assert group["mean"].attrs["unit"] == "m"


def test_diff_compares_fits_predictions_and_scores(tested, run):
    run("backtest", "case.yaml", "--set", "fit.stages=[lift 1, lift 3]", "-o", "other.h5")
    assert run("diff", "case.backtest.h5", "case.backtest.h5").exit_code == 0
    said = run("diff", "case.backtest.h5", "other.h5")
    assert said.exit_code == 1
    assert "Fit up to lift 2" in said.stdout
    assert "Scores" in said.stdout


def test_diff_says_what_it_compares_of_a_fit_and_a_backtest(tested, run):
    run("fit", "case.yaml")
    said = run("diff", "case.fit.h5", "case.backtest.h5").stdout
    assert "A is a fit, B a backtest" in said
    told = json.loads(run("diff", "--json", "case.fit.h5", "case.backtest.h5").stdout)
    assert told["kinds"] == ["fit", "backtest"]


def test_predict_refuses_a_backtest(tested, run):
    done = run("predict", "case.backtest.h5")
    assert done.exit_code == 3
    assert "the result of a fit is expected" in done.stderr


@pytest.mark.usefixtures("plain_pictures")
def test_a_fit_shows_its_last_stage(pit, run):
    run("fit", "case.yaml")
    shown = run("show", "case.fit.h5").stdout
    assert "Backtest: the last fitted stage, predicted from those before it" in shown
    assert "Backtest of lift 4 from the readings up to lift 3: the 95 % bands hold" in shown
    run("report", "case.fit.h5")
    assert "Predictions against later readings" in (pit / "case.fit.html").read_text()


@pytest.mark.usefixtures("in_this_process")
def test_several_cases(pit, run):
    (pit / "b").mkdir()
    write_case(pit / "b")
    write_readings(pit / "b", readings_of(pit / "case.yaml", SAME, seed=2))
    quick = ("-j", "1", "--set", "fit.mesh_error=false")
    done = run("backtest", "-q", "case.yaml", "b/case.yaml", *quick)
    assert done.exit_code == 0
    assert done.stdout.split() == ["case.backtest.h5", "b/case.backtest.h5"]


def test_a_dry_run_computes_nothing(pit, run):
    done = run("backtest", "--dry-run", "case.yaml")
    assert done.exit_code == 0
    assert "Would write case.backtest.h5" in done.stdout
    assert not (pit / "case.backtest.h5").exists()


def test_a_reading_is_judged_by_the_band_that_predicted_it_in_all_forms(tested, run, run_json):
    """In sd of its gauge and unexplained by the band: text, page, CSV and JSON agree."""
    (told,) = run_json("show", "case.backtest.h5")
    z = {
        (one["gauge"], one["stage"]): one["z"]
        for one in told["backtest"]["predictions"]
        if one["next"]
    }
    assert len(z) == 15
    in_sd = {}
    for one in told["gauges"]:
        if one["measured"] is not None:
            place = one["gauge"], one["stage"]
            in_sd[place] = (one["measured"] - one["computed"]) / one["sd"]
            assert one["residual_in_sd"] == pytest.approx(in_sd[place])
            assert one["unexplained"] == (pytest.approx(z[place]) if place in z else None)
    rows = list(
        csv.DictReader(io.StringIO(run("export", "case.backtest.h5", "--table", "gauges").stdout))
    )
    read = [row for row in rows if row["measured"]]
    assert len(read) == 18
    for row in read:
        place = row["gauge"], row["stage"]
        given = f"{z[place]:.6g}" if place in z else ""
        assert (f"{float(row['unexplained']):.6g}" if row["unexplained"] else "") == given
        assert float(row["residual_in_sd"]) == pytest.approx(in_sd[place])
        assert float(row["residual"]) / float(row["sd"]) == pytest.approx(in_sd[place])
    result = read_result("case.backtest.h5")
    table = {tuple(row[:2]): row for row in reading_table(result).rows}
    for place, row in table.items():
        assert row[-2] == (f"{z[place]:z.1f}" if place in z else "-")
        assert row[-3] == f"{in_sd[place]:z.1f}"
        assert row[-1] == ("predicted" if place in z else "used")
    said = run("show", "case.backtest.h5").stdout
    assert "Readings, each beside its prediction by the fit before (mm)" in said
    assert "in standard deviations of that prediction" in " ".join(said.split())
    assert rms(result) == pytest.approx(result.backtest.next.rms)
    assert "errors of the predictions of the next stage" in " ".join(outcome_sentences(result))


OPENING = """\
format: geoident-case/1
analysis: plane-strain
parameters: {S: {start: 9 MPa, bounds: [1 MPa, 40 MPa]}}
materials: {rock: {elastic: isotropic, E: 5 GPa, nu: 0.25}}
groups: {rock: rock, tunnel: rock}
in_situ: {model: heim, vertical: $S, K0: 1.0}
stages:
  - {name: half, excavate: [tunnel], release: {tunnel: 0.5}}
  - {name: whole, release: {tunnel: 1.0}}
gauges:
  A: {kind: convergence, between: [[-2 m, 0 m], [2 m, 0 m]], accuracy: 1 mm}
  B: {kind: convergence, between: [[0 m, -2 m], [0 m, 2 m]], accuracy: 2 mm}
  C: {kind: convergence, between: [[-1.2 m, -1.6 m], [1.2 m, 1.6 m]], accuracy: 2 mm}
  D: {kind: convergence, between: [[1.2 m, -1.6 m], [-1.2 m, 1.6 m]], accuracy: 2 mm}
readings:
  - {gauge: A, stage: half, value: -5 mm}
  - {gauge: B, stage: whole, value: -14 mm}
  - {gauge: C, stage: whole, value: -15 mm}
  - {gauge: D, stage: whole, value: -6 mm}
fit: {method: closed-form, model_error: none, closed-form: {centre: [0, 0 m], radius: 2 m}}
"""


def test_how_odd_the_errors_are_is_that_of_predictions_with_one_error_in_common(tmp_path, run_json):
    """Walls come together by 2 (1 + nu) a S / E: the error of S is common to B, C and D.

    The stress is known from A alone. Each prediction has half its variance from that, so that
    errors are correlated by 0.5: their chance is drawn here without the program.
    """
    (tmp_path / "case.yaml").write_text(OPENING)
    (found,) = run_json("backtest", str(tmp_path / "case.yaml"))
    motion = 2 * 1.25 * 2.0 / 5e3 * 1e3  # mm per MPa, all released
    stress, sd = 5.0 / (0.5 * motion), 1.0 / (0.5 * motion)
    common, own = (motion * sd) ** 2, 2.0**2
    z = (np.array([14.0, 15.0, 6.0]) - motion * stress) / np.sqrt(common + own)
    assert found["backtest"]["next"]["rms"] == pytest.approx(np.sqrt(np.mean(z**2)), rel=1e-6)
    random = np.random.default_rng(7)
    drawn = np.sqrt(common) * random.standard_normal((200_000, 1))
    drawn = (drawn + np.sqrt(own) * random.standard_normal((200_000, 3))) / np.sqrt(common + own)
    far = np.mean((drawn**2).sum(axis=1) >= (z**2).sum())
    assert found["backtest"]["chance_of_so_large_errors"] == pytest.approx(far, abs=0.008)


def test_the_last_fit_is_that_of_the_command_fit(tmp_path, run, run_json, monkeypatch):
    """The readings of the first stage have two minima, of which the later ones choose the other.

    A search that begins where the first stage led stays there.
    """
    monkeypatch.chdir(tmp_path)
    rows = [f"{k},{k / 5},{(k / 5 - 3.0) ** 2:.6f},{k / 5}" for k in range(31)]
    Path("runs.csv").write_text("\n".join(["run,a,g @ one [mm],h @ two [mm]", *rows, ""]))
    Path("case.yaml").write_text(TWO_MINIMA)
    fitted, tested = (
        run_json(command, "case.yaml")[0]["parameters"]["a"] for command in ("fit", "backtest")
    )
    assert fitted["value"] == pytest.approx(4.0, abs=0.01)
    assert tested["value"] == pytest.approx(fitted["value"], rel=1e-6)
    assert tested["upper95"] == pytest.approx(fitted["upper95"], rel=1e-6)


TWO_MINIMA = """\
format: geoident-case/1
model: {kind: table, file: runs.csv}
parameters: {a: {start: 1, bounds: [0, 6]}}
stages: [{name: one}, {name: two}]
gauges:
  g: {kind: reading, accuracy: 0.1 mm}
  h: {kind: reading, accuracy: 0.5 mm}
readings:
  - {gauge: g, stage: one, value: 1 mm}
  - {gauge: h, stage: two, value: 4 mm}
fit: {method: gauss-newton, gauss-newton: {starts: 6}}
"""

"""A table of runs as the model: its fits are those of the formula behind it, its bands hold."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from support.external import OWN, READINGS, TABLE, gauge_values, write_table_case

import geoident as api
from geoident.cli.app import geoident
from geoident.errors import InputError, UsageError
from geoident.forward.external.surfaces.surface import calibration
from geoident.io.result.file import read_result
from geoident.model.results.findings import sentences_of
from geoident.workflow.estimating.estimate import assess_fit
from geoident.workflow.estimating.finished import evaluation_log
from geoident.workflow.estimating.search import estimated
from geoident.workflow.estimating.setup import prepare
from geoident.workflow.fit import fit
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Request, build_model, load_inputs, plan_fit

POLYNOMIAL = TABLE.replace("runs.csv", "runs.csv, surface: polynomial")


def run(*words):
    found = CliRunner().invoke(geoident, [*map(str, words)])
    assert found.exit_code == 0, found.output
    return found.output


def fitted(case, **kwargs):
    return fit(plan_fit(Request(str(case), **kwargs)), Control()).result


@pytest.fixture(scope="module")
def dense(tmp_path_factory):
    """A fit through 200 runs, and its case."""
    case = write_table_case(tmp_path_factory.mktemp("dense"), 200)
    return case, fitted(case)


@pytest.fixture(scope="module")
def coarse(tmp_path_factory):
    """A fit through 30 runs by polynomials, which know little, and its case."""
    case = write_table_case(tmp_path_factory.mktemp("coarse"), 30, model=POLYNOMIAL)
    return case, fitted(case)


def closed_form(folder):
    """The fit of the formula itself to the same readings."""
    readings = READINGS
    for name in "HVD":
        readings = readings.replace(f"\n{name},", f"\n{name}.a,")
    (folder / "readings.csv").write_text(readings)
    (folder / "case.yaml").write_text(OWN)
    return fitted(folder / "case.yaml")


def test_its_fit_is_that_of_the_formula_within_what_it_says_of_its_error(dense, tmp_path):
    found, own = dense[1], closed_form(tmp_path)
    assert found.status == own.status == "converged"
    p, truth = found.parameters, own.parameters
    np.testing.assert_allclose(p.values, truth.values, rtol=1e-3)
    np.testing.assert_allclose(p.sd, truth.sd, rtol=0.02)
    assert np.all((p.lower95 <= truth.values) & (truth.values <= p.upper95))
    error = found.gauges.computed - own.gauges.computed
    shift = np.einsum("...j,j->...", own.sensitivity, p.values - truth.values)
    left = np.abs(error - shift)
    own_error = found.surface.own.reshape(2, 3).T
    assert np.all(left < 3.0 * own_error)
    assert found.surface.part < 0.1
    assert found.surface.runs == 200


def test_runs_are_counted_as_evaluations_of_surfaces_and_nothing_is_run(dense):
    case, found = dense
    assert 0 < found.counts.evaluations < 20
    assert not list(case.parent.glob("*.runs"))
    with pytest.raises(UsageError, match="runs nothing"):
        api.trust(case)


def test_derivatives_of_the_model_are_exact(coarse):
    model = build_model(load_inputs(str(coarse[0])))
    response = model.response([("H", "half"), ("D", "open"), ("V", "open")])
    p = np.array([7e9, 0.9])
    _, jacobian = response.evaluate(p)
    for j, h in enumerate(1e-3 * p):
        moved = [response.readings(p + k * h * np.eye(2)[j]) for k in (-2, -1, 1, 2)]
        slope = (moved[0] - 8 * moved[1] + 8 * moved[2] - moved[3]) / (12 * h)
        np.testing.assert_allclose(jacobian[:, j], slope, rtol=1e-6, atol=1e-6 * abs(slope).max())


def test_the_error_of_the_surfaces_is_in_covariance_and_intervals(coarse):
    case, found = coarse
    model = build_model(load_inputs(str(case)))
    p = found.parameters.values
    J = found.sensitivity.reshape(-1, 2)  # channel by channel
    surfaces = model.surfaces
    u = model.coordinates.of(p)
    z = np.column_stack([s.errors / s.expected for s in surfaces])
    sd = np.array([calibration(s) * s.deviation(u) for s in surfaces])
    order = [3 * stage + channel for channel in range(3) for stage in range(2)]
    root = model.error_root(p).swapaxes(0, 1).reshape(6, -1)
    own = root @ root.T
    np.testing.assert_allclose(np.sqrt(np.diag(own)), sd[order], rtol=1e-9)
    R = np.corrcoef(z[:, order].T)
    assert np.corrcoef((own / np.outer(sd[order], sd[order])).ravel(), R.ravel())[0, 1] > 0.98

    sigma = 2e-5**2 * np.eye(6) + own
    expected = np.linalg.inv(J.T @ np.linalg.solve(sigma, J))
    np.testing.assert_allclose(found.parameters.sd, np.sqrt(np.diag(expected)), rtol=0.1)
    without = np.linalg.inv(J.T @ J) * 2e-5**2
    assert np.all(np.diag(expected) > 2.0 * np.diag(without))
    assert found.surface.part > 0.5
    assert any(
        "Runs around these parameters" in finding for finding in sentences_of(found.findings)
    )


def test_a_result_keeps_the_surfaces_and_their_errors(coarse, tmp_path):
    case, found = coarse
    kept = read_result(str(case.with_suffix(".fit.h5")))
    assert kept.surface.words == found.surface.words
    np.testing.assert_array_equal(kept.surface.own, found.surface.own)
    np.testing.assert_array_equal(kept.surface.left_out, found.surface.left_out)
    for one, other in zip(kept.gauges.errors, found.gauges.errors, strict=True):
        assert one.surface == other.surface
        assert len(one.surface) == 2


@pytest.mark.usefixtures("plain_pictures")
def test_its_errors_are_shown(coarse):
    case, found = coarse
    result = case.with_suffix(".fit.h5")
    shown = run("show", result)
    assert "Response surfaces\nreading    surface" in shown
    assert "polynomial of order 4" in shown
    assert "Through 30 runs of runs.csv" in shown
    surface = json.loads(run("show", result, "--json"))["surface"]
    assert surface["runs"] == 30
    assert surface["readings"][0]["left_out"] == pytest.approx(found.surface.left_out[0])
    checked = run("check", case)
    assert "the 30 runs of runs.csv, and response surfaces between" in checked
    assert "polynomial of order 4" in checked
    assert json.loads(run("check", case, "--json"))["surface"]["file"] == "runs.csv"
    page = case.parent / "report.html"
    run("report", result, "-o", page)
    assert "Response surfaces" in page.read_text()
    assert "polynomial of order 4" in page.read_text()


def test_predictions_have_the_error_of_the_surfaces(coarse):
    case, _ = coarse
    output = case.parent / "half.fit.h5"
    run("fit", case, "--set", "fit.stages=[half]", "-o", output, "-q")
    found = read_result(str(output))
    run("predict", output)
    predicted = read_result(str(case.parent / "half.predict.h5"))
    np.testing.assert_allclose(predicted.prediction.sd[:, 1], found.prediction.sd[:, 1], rtol=1e-9)
    np.testing.assert_allclose(
        predicted.prediction.mean[:, 1], found.prediction.mean[:, 1], rtol=1e-9
    )
    J, p = found.sensitivity, found.parameters
    assert np.isfinite(found.prediction.sd[:, 1]).all()
    own = found.surface.own[3:]
    # readings of both stages are proportional: what one tells of the surfaces the other shares
    assert np.all(found.prediction.sd[:, 1] > 2e-5)
    assert np.all(found.prediction.sd[:, 1] ** 2 < 2e-5**2 + own**2 + 4 * (J[:, 1] ** 2 @ p.sd**2))


def test_another_table_is_predicted_with_its_own_errors(coarse, tmp_path):
    case, found = coarse
    other = write_table_case(tmp_path / "other", 60, seed=8, readings="gauge,stage,value,unit\n")
    run("predict", case.with_suffix(".fit.h5"), "--case", other, "-o", tmp_path / "o.h5")
    predicted = read_result(str(tmp_path / "o.h5"))
    errors = [channel.surface for channel in predicted.gauges.errors]
    after = len(found.gauges.errors[0].surface[0][1])
    assert all(size == 0.0 for channel in errors for _, row in channel for size in row[:after])
    assert any(size > 0.0 for channel in errors for _, row in channel for size in row[after:])
    assert np.isfinite(predicted.prediction.sd).all()


@pytest.mark.parametrize("method", ["simplex", "scan"])
def test_other_methods_find_the_same(coarse, method):
    case, found = coarse
    output = case.parent / f"{method}.h5"
    grid = "fit.scan={grid: {E: {from: 8 GPa, to: 9 GPa, points: 7}, "
    grid += "K0: {from: 0.6, to: 1.2, points: 7}}}"
    more = ["--set", grid] if method == "scan" else ["--set", f"fit.method={method}"]
    command = "scan" if method == "scan" else "fit"
    run(command, case, *more, "-o", output, "-q")
    other = read_result(str(output))
    away = (other.parameters.values - found.parameters.values) / found.parameters.sd
    assert np.all(np.abs(away) < (2.0 if method == "scan" else 0.05))
    assert other.objective == pytest.approx(found.objective, abs=2.0 if method == "scan" else 1e-3)


def test_draws_identifiability_and_backtest_work_on_it(coarse):
    case, found = coarse
    run("sample", case.with_suffix(".fit.h5"), "--draws", 200, "--effective", 100, "-q")
    drawn = read_result(str(case.with_suffix(".sample.h5")))
    np.testing.assert_allclose(drawn.parameters.sd, found.parameters.sd, rtol=0.25)
    planned = json.loads(run("check", case, "--identifiability", "--json"))
    assert len(json.dumps(planned)) > 100
    run("backtest", case, "-q")
    run("simulate", case, "-o", case.parent / "simulated.csv")
    assert "H,open" in (case.parent / "simulated.csv").read_text()


def test_a_search_that_met_other_readings_than_the_model_gives_has_not_converged(coarse):
    """The misfit of a result is that of its readings, whatever the search has seen."""
    case, kept = coarse
    job = plan_fit(Request(str(case)))
    with evaluation_log(job, Control()) as log:
        setup, problem, outcome = estimated(prepare(job), job.methods, log, Control())
        met = assess_fit(setup, problem, outcome, fields=False)
        other = replace(outcome, objective=7.7e-28)
        assert kept.objective > 1.0
        contradicting = assess_fit(setup, problem, other, fields=False)
    assert (met.outcome.status, met.outcome.objective) == ("converged", outcome.objective)
    assert contradicting.outcome.status == "not-converged"
    assert contradicting.outcome.objective == pytest.approx(kept.objective)
    assert "gave a misfit of 7.7e-28 while they were searched and" in contradicting.outcome.reason


def test_beyond_the_runs_nothing_is_said(dense):
    model = build_model(load_inputs(str(dense[0])))
    assert model.admissible(np.array([6e9, 1.0])) is None
    assert model.admissible(np.array([0.9e9, 1.0])) == "E is beyond the runs of the table"
    with pytest.raises(InputError, match="is beyond the runs"):
        build_model(load_inputs(str(dense[0]), overrides=("parameters.E.bounds=[1 GPa, 80 GPa]",)))


def test_readings_beyond_the_runs_are_named(tmp_path):
    readings = READINGS.replace("V,open,1.22", "V,open,12200")
    case = write_table_case(tmp_path, 30, readings=readings)
    [note] = [
        note
        for note in build_model(load_inputs(str(case))).notes
        if note.startswith("readings beyond")
    ]
    assert note.startswith("readings beyond what any run of the table gave: V at open (1.22e+04 mm")
    assert "H at" not in note


def test_a_gauge_with_a_zero_reads_what_the_runs_changed_since(tmp_path):
    case = write_table_case(tmp_path, 40)
    text = case.read_text().replace("D: {kind: reading,", "D: {kind: reading, zero: half,")
    case.write_text(text)
    rows = [row for row in READINGS.splitlines(keepends=True) if not row.startswith("D,half")]
    (tmp_path / "readings.csv").write_text("".join(rows))
    model = build_model(load_inputs(str(case)))
    p = np.array([7e9, 0.9])
    found = gauge_values(*p)
    computed = model.computed(p)
    assert computed[2, 1] == pytest.approx(found["D", "open"] - found["D", "half"], rel=2e-3)
    assert computed[1, 1] == pytest.approx(found["V", "open"], rel=2e-3)
    root = model.error_root(p)
    assert not root[0, 2].any()
    assert root[1, 2].any()


SITE = """\
format: geoident-case/1
model: {{kind: table, file: runs.csv, surface: {surface}}}
parameters:
  E: {{start: 15 GPa, bounds: [{lower}, 50 GPa], scale: log}}
  K0: {{start: 1.0, bounds: [0.3, 2.85]}}
stages: [{{name: half}}, {{name: open}}]
gauges:
  H: {{kind: reading, accuracy: {accuracy} mm}}
  V: {{kind: reading, accuracy: {accuracy} mm}}
  D: {{kind: reading, accuracy: {accuracy} mm}}
readings:
{readings}
fit: {{backtest: false}}
"""


def site(folder, surface, runs, accuracy, seed):
    """A table and readings of their own, and the truth behind them: (case, E, K0)."""
    rng = np.random.default_rng(seed)
    case = write_table_case(folder, runs, seed=seed, lower="5 GPa")
    truth = 5e9 * 10.0 ** rng.uniform(0.1, 0.9), 0.3 + 2.55 * rng.uniform(0.1, 0.9)
    lines = [
        f"  - {{gauge: {g}, stage: {s}, value: {1e3 * v + accuracy * rng.standard_normal()!r} mm}}"
        for (g, s), v in gauge_values(*truth).items()
    ]
    words = {"surface": surface, "accuracy": accuracy, "lower": "5 GPa"}
    case.write_text(SITE.format(**words, readings="\n".join(lines)))
    return case, truth


def searched(case, *overrides):
    """The end of a search, and what is known there."""
    job, control = plan_fit(Request(str(case), overrides, str(case.parent / "o.h5"))), Control()
    setup = prepare(job)
    with evaluation_log(job, control, setup.model) as log:
        found = estimated(setup, job.methods, log, control)
    return found, assess_fit(*found, fields=False).assessment


def covered(folder, surface, runs, accuracy, seed):
    """Whether the intervals hold the truth; and how large the error of the surfaces is."""
    case, truth = site(folder, surface, runs, accuracy, seed)
    found, known = searched(case)
    inside = (known.lower95 <= truth) & (truth <= known.upper95)
    return inside, found.setup.surface.part


# surfaces whose errors are about as large as those of the gauges, and some that are exact
KINDS = [("gaussian-process", 20, 0.002), ("polynomial", 30, 0.005), ("auto", 200, 0.02)]


def slopes(pairs, here, there):
    """The derivatives (g, 2) of the formula in the mean of the way from one place to another."""
    mean = np.zeros((len(pairs), 2))
    for t, weight in zip(*np.polynomial.legendre.leggauss(4), strict=True):
        at = 0.5 * (here + there) + 0.5 * t * (there - here)
        for j, step in enumerate(1e-5 * at):
            ends = [gauge_values(*(at + k * step * np.eye(2)[j])) for k in (1, -1)]
            change = [(ends[0][pair] - ends[1][pair]) / (2.0 * step) for pair in pairs]
            mean[:, j] += 0.5 * weight * np.array(change)
    return mean


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(("surface", "runs", "accuracy"), KINDS[:2])
def test_what_is_found_is_off_by_the_errors_of_gauges_and_surfaces(
    tmp_path, surface, runs, accuracy, seed
):
    """And the intervals are those of these errors: of any table and any readings.

    Where J^T S^-1 (m - s) = 0, with the surfaces s and their derivatives J, the mean derivatives F
    of the formula f on the way from the truth lead to J^T S^-1 (m - f(truth) + f - s - F dp) = 0.
    That the surfaces err as much as they say is for `tests/forward/external/test_surfaces.py`.
    """
    case, truth = site(tmp_path, surface, runs, accuracy, seed)
    found, known = searched(case, "fit.model_error=none")
    p, model, readings = found.outcome.values, found.setup.model, found.setup.readings
    pairs = list(readings.pairs)
    s, J = model.response(pairs).evaluate(p)
    root = model.error_root(p)
    case_of = model.case
    places = [
        ([t.name for t in case_of.stages].index(b), [c.name for c in case_of.channels].index(a))
        for a, b in pairs
    ]
    own = np.array([root[place] for place in places])
    S = (1e-3 * accuracy) ** 2 * np.eye(len(pairs)) + own @ own.T
    weights = np.linalg.solve(S, J).T
    there, here = (gauge_values(*at) for at in (truth, p))
    errors = readings.value - [there[pair] for pair in pairs] + [here[pair] for pair in pairs] - s
    off = np.linalg.solve(weights @ slopes(pairs, np.array(truth), p), weights @ errors)
    sd = np.sqrt(np.diag(np.linalg.inv(weights @ J)))
    np.testing.assert_allclose((p - truth) / sd, off / sd, atol=0.02)
    np.testing.assert_allclose(known.sd, sd, rtol=0.02)
    assert found.setup.surface.part > 0.05


@pytest.mark.slow
@pytest.mark.parametrize(("surface", "runs", "accuracy"), KINDS)
def test_intervals_hold_the_truth_as_often_as_they_say(tmp_path, surface, runs, accuracy):
    found = [covered(tmp_path, surface, runs, accuracy, seed) for seed in range(400)]
    assert 0.93 <= np.mean([inside for inside, _ in found]) <= 0.97
    if runs < 100:
        assert np.median([part for _, part in found]) > 0.2


CAMPAIGN = """\
format: geoident-campaign/1
command: simulate
case: own.yaml
variations:
  sample:
    count: 40
    values:
      parameters.E.start: {from: 1 GPa, to: 50 GPa, scale: log}
      parameters.K0.start: {from: 0.3, to: 2.85}
"""


@pytest.mark.slow  # campaigns: tests/workflow/campaign; a table and its fit: above
@pytest.mark.usefixtures("plain_pictures", "answered_here")
def test_a_campaign_of_simulations_is_a_model_whose_fit_is_that_of_the_case(tmp_path):
    readings = READINGS
    for name in "HVD":
        readings = readings.replace(f"\n{name},", f"\n{name}.a,")
    (tmp_path / "own.yaml").write_text(OWN)
    (tmp_path / "many.yaml").write_text(CAMPAIGN)
    case = write_table_case(tmp_path, model=TABLE.replace("runs.csv", "many.batch"))
    (tmp_path / "readings.csv").write_text(readings)
    run("batch", tmp_path / "many.yaml", "-j", 1)
    text = case.read_text()
    for name in "HVD":
        text = text.replace(f"  {name}: {{kind", f"  {name}.a: {{kind")
    case.write_text(text)
    found, own = fitted(case), fitted(tmp_path / "own.yaml")
    assert found.status == own.status == "converged"
    np.testing.assert_allclose(found.parameters.values, own.parameters.values, rtol=1e-2)
    np.testing.assert_allclose(found.parameters.sd, own.parameters.sd, rtol=0.1)
    assert found.surface.file == "many.batch"
    assert found.surface.runs == 40
    run("report", tmp_path / "case.fit.h5")
    again = CliRunner().invoke(geoident, ["batch", str(tmp_path / "many.yaml")])
    assert "40 up to date" in again.output
    assert "up to date" in CliRunner().invoke(geoident, ["fit", str(case)]).output

"""A convergence law fitted: truth in its intervals, lost and final convergence, projects."""

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from support.commands import run_command
from support.convergence import CASE, FIXED, READ, TRUTH, write_law

import geoident as package
from geoident.cli.app import geoident
from geoident.errors import UsageError
from geoident.identify.assessment.uncertainty import assess
from geoident.identify.problem.methods import identify
from geoident.identify.problem.problem import Problem
from geoident.io.case.file import parse_case
from geoident.model.methods import GaussNewtonOptions, SquaredOptions
from geoident.model.results.findings import sentences_of
from geoident.workflow.fit import fit
from geoident.workflow.project.plan import ProjectRequest, plan_project
from geoident.workflow.project.run import fit_project
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Request, build_model, load_inputs, plan_fit

PAIRS = [(gauge, stage) for gauge in "HV" for stage in READ]
SD = 1e-4


def readings_of(folder, text, p, seed=None):
    """Readings at p (n,), with noise where a seed is given, by gauge and stage."""
    v = build_model(load_inputs(str(write_law(folder, text)))).response(PAIRS).readings(np.array(p))
    if seed is not None:
        v = v + SD * np.random.default_rng(seed).standard_normal(len(v))
    return dict(zip(PAIRS, v.tolist(), strict=True))


def fitted(case):
    return fit(plan_fit(Request(str(case))), Control()).result


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """The fit of four parameters to ten readings with noise; its case."""
    folder = tmp_path_factory.mktemp("law")
    readings = readings_of(folder, FIXED, TRUTH[:4], seed=5)
    case = write_law(folder, FIXED + "fit: {backtest: false}\n", readings)
    return case, fitted(case)


def numbers(text):
    return [float(x) for x in re.findall(r"(?<![\w.])-?\d+\.?\d*(?= mm| to)", text)]


def test_the_truth_is_in_intervals_lost_and_final_convergence_and_prediction(found):
    case, result = found
    p = result.parameters
    assert result.status in ("converged", "not-determined")
    assert np.all((p.lower95 <= TRUTH[:4]) & (TRUTH[:4] <= p.upper95))
    [note] = [n for n in result.notes if n.startswith("convergence of H: ")]
    lost, final, rest = np.array(numbers(note)).reshape(3, 3)
    for (value, lower, upper), truth in zip((lost, final, rest), (13.125, 78, 64.875), strict=True):
        assert lower < value < upper
        assert lower <= truth <= upper
        assert upper - lower < 0.5 * truth
    assert lost[0] + rest[0] == pytest.approx(final[0], abs=0.02)
    exported = run_command("export", case.with_suffix(".fit.h5"), "--table", "convergence").stdout
    [row] = [one for one in csv.DictReader(exported.splitlines()) if one["gauge"] == "H"]
    assert (row["zero"], row["unit"]) == ("first", "mm")
    columns = [f"{part}{end}" for part in ("lost", "final", "shown")
               for end in ("", "_lower95", "_upper95")]  # fmt: skip
    told = [*lost, *final, *rest]
    assert [float(row[name]) for name in columns] == pytest.approx(told, abs=0.006)
    later = build_model(load_inputs(str(case))).response([("H", "later")])
    [truth] = later.readings(np.array(TRUTH[:4]))
    j = result.gauges.stages.index("later")
    assert result.prediction.lower95[0, j] <= truth <= result.prediction.upper95[0, j]


def test_it_is_shown_checked_and_in_the_report(found, tmp_path):
    case, _ = found
    runs = [("check", case), ("show", case.with_suffix(".fit.h5"))]
    texts = []
    for words in runs:
        ran = CliRunner().invoke(geoident, [*map(str, words)])
        assert ran.exit_code == 0, ran.output
        texts.append(" ".join(ran.output.split()))
    assert "convergence law in distance to the face and time (Sulem" in texts[0]
    assert "lost before its first reading at 'first'; in the end" in texts[1]
    assert "of the computed change (95 %): the residuals hardly show a model error" in texts[1]
    with pytest.raises(UsageError, match="runs nothing"):
        package.trust(case)


def test_intervals_hold_their_95_per_cent(tmp_path):
    """Of 60 times four intervals 228 are expected to hold: three deviations are 13."""
    case = write_law(tmp_path, FIXED)
    model = build_model(load_inputs(str(case)))
    response, truth = model.response(PAIRS), np.array(TRUTH[:4])
    v, draw = response.readings(truth), np.random.default_rng(11)
    lost, final = model.lost(truth).value, model.final(truth).value
    inside = np.zeros(6)
    for _ in range(60):
        measured = v + SD * draw.standard_normal(len(v))
        problem = Problem(
            response, measured, np.full(len(v), SD), model.case.parameters, SquaredOptions()
        )
        p = identify(problem, [GaussNewtonOptions()], lambda _: None).values
        computed, jacobian = response.evaluate(p)
        known = assess(problem, p, jacobian, computed)
        inside[:4] += (known.lower95 <= truth) & (truth <= known.upper95)
        for k, (dual, exact) in enumerate(((model.lost(p), lost), (model.final(p), final))):
            slope = dual.columns[0, 1:]
            sd = np.sqrt(slope @ known.covariance @ slope)
            inside[4 + k] += abs(dual.value[0] - exact[0]) <= 1.96 * sd
    assert 215 <= inside[:4].sum() <= 240
    assert inside.min() >= 51


def test_what_readings_of_a_few_days_cannot_tell_is_said(tmp_path):
    """Exponent, time and size of the growth are not told apart by its beginning."""
    readings = readings_of(tmp_path, CASE, TRUTH, seed=7)
    first = {pair: v for pair, v in readings.items() if pair[1] in READ[:3]}
    result = fitted(write_law(tmp_path, CASE + "fit: {backtest: false}\n", first))
    assert result.status == "not-determined"
    said = " ".join(sentences_of(result.findings))
    assert re.search(r"cannot separate (\w+, )*\w+ and T", said), said
    assert re.search(r"cannot separate (\w+, )*\w+ and n", said), said


def test_it_is_a_section_of_a_project(tmp_path):
    """Two sections with one X, T and m, and a C of their own."""
    case = FIXED + "fit: {backtest: false}\n"
    for name, C in (("a", 30e-3), ("b", 55e-3)):
        folder = tmp_path / name
        folder.mkdir()
        write_law(folder, case, readings_of(folder, FIXED, (C, *TRUTH[1:4]), seed=ord(name)))
    project = tmp_path / "project.yaml"
    project.write_text(
        "format: geoident-project/1\ntitle: Two\nsections:\n"
        "  - {name: A, case: a/case.yaml}\n  - {name: B, case: b/case.yaml}\n"
        "shared: [X, m, T]\n"
    )
    result = fit_project(plan_project(ProjectRequest(str(project))), Control()).result
    truth = {"X": 9.0, "m": 1.6, "T": TRUTH[3]}
    assert {one.name for one in result.common} == set(truth)
    for one in result.common:
        assert one.lower95 <= truth[one.name] <= one.upper95
    own = {one.section: one.value for one in result.parameters if one.parameter == "C"}
    assert own["B"] / own["A"] == pytest.approx(55 / 30, rel=0.02)


def test_the_case_of_the_page_is_right():
    page = Path(package.__file__).parent / "docs" / "how-to" / "convergence-law.md"
    [text] = re.findall(r"```yaml\n(.*?)```", page.read_text(encoding="utf-8"), re.S)
    text = re.sub("readings: .*\n", "", text)
    law = parse_case(text, "case.yaml").case.elsewhere
    assert law.distance[:, 0].tolist() == [2, 6, 13, 25, 25, 60, 150]

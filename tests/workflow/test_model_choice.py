"""Which model the readings ask for: two results compared, and a ladder in one command."""

from __future__ import annotations

import json
from math import nan

import numpy as np
import pytest
from support.commands import run_command
from support.jacking import LADDER, LYING, TRUTHS, write_case, write_readings

from geoident.io.result.file import read_result
from geoident.model.results.rivals import ModelScore
from geoident.workflow.scoring.comparison import support_sentences

TWO = f"[isotropic, {{elastic: transversely-isotropic, {LYING}}}]"
ALONE = "mesh_error: false, backtest: false"
FIT = f"{{ladder: {LADDER}, model_error: none, {ALONE}}}"


def _ladder(folder, rung, seed, fit=FIT, **changes):
    """The comparison of a ladder on readings of one of its models."""
    truth = write_case(folder, rock=rung, name="truth.yaml", **changes)
    write_readings(truth, TRUTHS[rung], seed)
    case = write_case(folder, fit=fit, **changes)
    ended = run_command("fit", str(case), "--force", "--json")
    return ended, json.loads(ended.stdout)


@pytest.mark.parametrize(
    "rung",
    [
        # that a simpler one may be chosen: with few readings, and by changes to the case, below
        pytest.param("isotropic", marks=pytest.mark.slow),
        # by readings of another seed in `test_every_model_has_a_result_and_the_chosen_one_predicts`
        pytest.param("transversely-isotropic", marks=pytest.mark.slow),
        "orthotropic",
    ],
)
def test_the_model_that_made_the_readings_is_chosen(tmp_path, rung):
    ended, told = _ladder(tmp_path, rung, seed=3)
    assert ended.exit_code == 0
    comparison = told["comparison"]
    assert comparison["chosen"] == rung
    assert comparison["decided"]
    assert "The readings support" in comparison["sentences"][0]
    assert set(told["parameters"]) == set(TRUTHS[rung])
    for name, truth in TRUTHS[rung].items():
        known = told["parameters"][name]
        assert abs(known["value"] - truth) < 4.0 * known["sd"]


@pytest.mark.slow  # the choice without one: above
def test_a_model_error_does_not_swallow_the_difference(tmp_path):
    """Its size is estimated for each model: of the too simple one it explains part, not all."""
    told = _ladder(tmp_path, "transversely-isotropic", 3, fit=f"{{ladder: {TWO}, {ALONE}}}")[1]
    assert told["model_error"]["kind"] == "estimated"
    assert told["comparison"]["chosen"] == "transversely-isotropic"
    assert told["comparison"]["decided"]


def test_with_few_readings_the_simpler_is_preferred_and_it_is_said_why(tmp_path):
    few = ((1.5, 0.5, 1.5),)
    fit = FIT.replace(LADDER, TWO)
    _, told = _ladder(tmp_path, "orthotropic", 1, points=few, accuracy="0.5 mm", fit=fit)
    comparison = told["comparison"]
    assert not comparison["decided"]
    assert comparison["chosen"] == "isotropic"
    assert "do not decide between" in comparison["sentences"][0]
    assert "is the simpler" in comparison["sentences"][0]


@pytest.fixture(scope="module")
def strata(tmp_path_factory):
    """A ladder on readings of strata: its folder, and what was said."""
    folder = tmp_path_factory.mktemp("strata")
    return folder, _ladder(folder, "transversely-isotropic", 1)[1]


def test_every_model_has_a_result_and_the_chosen_one_predicts(strata):
    tmp_path, told = strata
    for name in TRUTHS:
        assert read_result(tmp_path / f"case.{name}.fit.h5").evidence is not None
    result = read_result(tmp_path / "case.fit.h5")
    assert result.comparison.models[result.comparison.chosen].name == "transversely-isotropic"
    assert result.comparison.sentences == tuple(told["comparison"]["sentences"])
    assert np.isfinite(result.evidence.log_evidence)
    again = run_command("fit", str(tmp_path / "case.yaml"))
    assert "is up to date" in again.stderr
    assert "transversely-isotropic *" in run_command("show", str(tmp_path / "case.fit.h5")).stdout
    by_hand = run_command(
        "compare", *(str(tmp_path / f"case.{name}.fit.h5") for name in TRUTHS), "--json"
    )
    assert json.loads(by_hand.stdout)["chosen"] == "case.transversely-isotropic"


def test_a_richer_model_begins_where_the_simpler_one_ended(strata):
    tmp_path, _ = strata
    simple = read_result(tmp_path / "case.isotropic.fit.h5").parameters
    rich = read_result(tmp_path / "case.transversely-isotropic.fit.h5").parameters
    start = dict(zip(rich.names, rich.start, strict=True))
    assert start["E_p"] == pytest.approx(1.2 * simple.values[0], rel=1e-6)
    assert start["E_n"] == pytest.approx(simple.values[0] / 1.2, rel=1e-6)
    assert rich.units[rich.names.index("E_p")] == "GPa"


def test_models_by_changes_to_the_case(tmp_path):
    """The general form: any key, and a parameter that only the richer model has."""
    ladder = (
        "{ladder: [{name: one modulus}, {name: nu too, set: {materials.rock.nu: $nu, "
        f"parameters.nu: {{start: 0.2, bounds: [0.05, 0.45]}}}}}}], model_error: none, {ALONE}}}"
    )
    truth = write_case(tmp_path, name="truth.yaml")
    write_readings(truth, TRUTHS["isotropic"], seed=1)
    case = write_case(tmp_path, fit=ladder)
    told = json.loads(run_command("fit", str(case), "--json").stdout)
    assert told["comparison"]["chosen"] == "one modulus"
    assert [model["parameters"] for model in told["comparison"]["models"]] == [1, 2]
    assert (tmp_path / "case.nu-too.fit.h5").exists()


def test_a_wrong_model_is_refused_before_anything_is_computed(tmp_path):
    ladder = "{ladder: [isotropic, {name: odd, set: {materials.rock.mu: 3}}]}"
    write_readings(write_case(tmp_path, name="truth.yaml"), TRUTHS["isotropic"], seed=1)
    case = write_case(tmp_path, fit=ladder)
    for command in ("check", "fit"):
        ended = run_command(command, str(case))
        assert ended.exit_code == 3
        assert "case.yaml" in ended.stderr
        assert "model 'odd': materials.rock.mu" in ended.stderr
    assert not list(tmp_path.glob("*.h5"))


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ("transversely-isotropic", "has no orientation of strata"),
        ("{name: two, elastic: orthotropic, material: clay, " + LYING + "}", "no material 'clay'"),
        ("{set: {}}", "needs a name"),
        ("isotropic", "two models of the ladder are named 'isotropic'"),
        ("cubic", "cubic"),
        (None, "fit.ladder: found 1 entry; expected at least 2"),
    ],
)
def test_faults_of_a_ladder_are_said_where_they_stand(tmp_path, entry, words):
    write_readings(write_case(tmp_path, name="truth.yaml"), TRUTHS["isotropic"], seed=1)
    rungs = "isotropic" if entry is None else f"isotropic, {entry}"
    case = write_case(tmp_path, fit=f"{{ladder: [{rungs}]}}")
    ended = run_command("check", str(case))
    assert ended.exit_code == 3
    assert words in ended.stderr
    assert "fit.ladder" in ended.stderr or "'fit'" in ended.stderr or "ladder[1]" in ended.stderr


def test_fits_of_different_readings_are_not_compared(tmp_path):
    write_readings(write_case(tmp_path, name="truth.yaml"), TRUTHS["isotropic"], seed=1)
    write_case(tmp_path, name="all.yaml", fit=f"{{model_error: none, {ALONE}}}")
    write_case(
        tmp_path, name="some.yaml", fit=f"{{stages: [push-z, push-x], model_error: none, {ALONE}}}"
    )
    for name in ("all", "some"):
        run_command("fit", str(tmp_path / f"{name}.yaml"))
    ended = run_command("compare", *(str(tmp_path / f"{n}.fit.h5") for n in ("all", "some")))
    assert ended.exit_code == 3
    assert "fitted to other readings than all" in ended.stderr
    assert "p0x at push-y" in ended.stderr
    assert run_command("compare", str(tmp_path / "all.fit.h5")).exit_code == 2
    alone = run_command("compare", str(tmp_path / "all.yaml"), str(tmp_path / "all.fit.h5"))
    assert alone.exit_code == 3


def score(name, evidence, *, status="converged", backtest=nan, backtested=0):
    return ModelScore(name, f"{name}.h5", 1, status, 1.0, evidence, evidence, backtest, backtested)


POOR = {"status": "poor-fit"}


@pytest.mark.parametrize(
    ("models", "chosen", "said"),
    [
        (
            [score("A", 4.2), score("B", 0.0)], 0,
            ["The readings support A: odds of 67 to 1 (log Bayes factor 4.2) against B."],
        ),
        (
            [score("A", 1.0), score("B", 12.0), score("C", 5.5)], 1,
            ["The readings support B: odds of 6.7e+02 to 1 (log Bayes factor 6.5) against C, the "
             "next best."],
        ),
        (
            [score("A", 12.0), score("B", 2.0, **POOR)], 0,
            ["The readings support A: odds of over 10 000 to 1 (log Bayes factor 10.0) against B."],
        ),
        (
            [score("A", 5.0), score("B", 7.9), score("C", 6.0), score("D", 1.0)], 0,
            ["The readings do not decide between A, B and C (log Bayes factor +2.9 for B; it takes "
             "3, odds of 20 to 1): A is the simpler and is preferred.",
             "They speak against D: odds of 55 to 1 (log Bayes factor 4.0) for A."],
        ),
        (
            [score("A", 5.0, **POOR), score("B", 1.0)], 0,
            ["The readings support A: odds of 55 to 1 (log Bayes factor 4.0) against B.",
             "A does not meet the readings within their errors."],
        ),
        (
            [score("A", 5.0, **POOR), score("B", 1.0, **POOR)], 0,
            ["The readings support A: odds of 55 to 1 (log Bayes factor 4.0) against B.",
             "None of them meets the readings within their errors: the best of them is still "
             "wrong."],
        ),
    ],
)  # fmt: skip
def test_what_the_readings_support_is_said(models, chosen, said):
    """Odds are exp of the differences: 66.7, 665, 54.6 by hand."""
    assert support_sentences(models, chosen) == said


@pytest.mark.parametrize(
    ("mine", "other", "said"),
    [
        ((0.5, 10), (0.4, 10), ["The backtest agrees: A predicts the last fitted stage best."]),
        ((0.4, 10), (0.69, 10),
         ["The backtest does not contradict: B predicts hardly better."]),
        ((0.4, 12), (0.71, 10),
         ["The backtest favours B: its predictions of the last fitted stage have a log score "
          "higher by 0.31 a reading (10 readings)."]),
        ((nan, 0), (0.7, 10), []),
        ((0.7, 10), (nan, 0), []),
    ],
)  # fmt: skip
def test_whether_the_backtest_agrees_is_said(mine, other, said):
    """Of ten readings a log score of 0.3 each makes the odds of 20 to 1 that decide."""
    (score_a, n_a), (score_b, n_b) = mine, other
    models = [
        score("A", 9.0, backtest=score_a, backtested=n_a),
        score("B", 0.0, backtest=score_b, backtested=n_b),
    ]
    assert support_sentences(models, 0)[1:] == said

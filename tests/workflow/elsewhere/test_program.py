"""A program as the model: equal to geoident's own fit, each run once, failures survived."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.commands import run_command
from support.external import (
    EXTERNAL,
    OWN,
    PROGRAM,
    PYTHON,
    READINGS,
    SCRIPT,
    trusted,
    write_case,
)

from geoident.errors import ExitCode, InputError, Interrupted, ModelError
from geoident.io.result.file import read_result
from geoident.workflow.fit import fit
from geoident.workflow.programs.run_log import new_folder
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Request, build_model, load_inputs, plan_fit


def fitted(case, **options):
    with trusted():
        return fit(plan_fit(Request(str(case), **options)), Control()).result


def runs_of(case):
    lines = case.with_suffix(".runs").joinpath("runs.jsonl").read_text().splitlines()
    return [json.loads(line) for line in lines]


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A case, and what was found of it."""
    case = write_case(tmp_path_factory.mktemp("external"))
    return case, fitted(case)


@pytest.fixture(autouse=True)
def own_state(tmp_path, monkeypatch):
    """Decisions of these tests are not those of who runs them."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def test_the_fit_is_that_of_the_closed_form(done, tmp_path):
    _, found = done
    (tmp_path / "readings.csv").write_text(READINGS.replace("H,", "H.a,").replace("V,", "V.a,")
                                           .replace("D,", "D.a,"))  # fmt: skip
    (tmp_path / "own.yaml").write_text(OWN)
    own = fitted(tmp_path / "own.yaml")
    assert found.status == own.status == "converged"
    assert found.objective > 1.0  # the readings are not met exactly
    np.testing.assert_allclose(found.parameters.values, own.parameters.values, rtol=1e-6)
    np.testing.assert_allclose(found.parameters.sd, own.parameters.sd, rtol=1e-4)
    np.testing.assert_allclose(found.objective, own.objective, rtol=1e-6)


def test_costs_are_counted_in_runs_and_each_is_made_once(done):
    case, found = done
    made = runs_of(case)
    assert found.counts.evaluations == len(made) == len({run["key"] for run in made})
    assert len(made) < 60
    left = sorted(path.name for path in case.with_suffix(".runs").iterdir())
    assert [name for name in left if name.isdigit()] == []


def test_the_same_again_runs_nothing_and_gives_the_same_bits(done, monkeypatch):
    case, found = done
    number = len(runs_of(case))
    monkeypatch.setattr("subprocess.Popen", None)  # nothing can be started
    again = fitted(case, fresh=True, force=True)
    assert again.parameters.values.tobytes() == found.parameters.values.tobytes()
    assert again.parameters.sd.tobytes() == found.parameters.sd.tobytes()
    assert again.counts == found.counts
    assert len(runs_of(case)) == number


def test_a_search_that_was_cut_short_goes_on_from_the_log(done, tmp_path):
    case, found = done
    other = write_case(tmp_path)
    lines = case.with_suffix(".runs").joinpath("runs.jsonl").read_text().splitlines(keepends=True)
    (tmp_path / "case.runs").mkdir()
    half = "".join(lines[:12]) + lines[12][:40]  # the last line is cut off
    (tmp_path / "case.runs" / "runs.jsonl").write_text(half)
    again = fitted(other)
    np.testing.assert_array_equal(again.parameters.values, found.parameters.values)
    assert again.counts == found.counts


def test_failed_runs_are_survived_listed_and_their_folders_kept(tmp_path):
    script = PROGRAM.replace("if K > 2.9:", "if K > 1.5:")
    case = write_case(tmp_path, script=script)
    found = fitted(case, overrides=("parameters.K0.start=1.5",))
    assert found.status == "converged"
    [note] = [note for note in found.notes if "runs failed" in note]
    assert "ArithmeticError: no equilibrium" in note
    folder = Path(note.split("(")[1].split(")")[0])
    assert (folder / "opening.in").is_file()
    assert "ArithmeticError" in (folder / "stderr.txt").read_text()


@pytest.mark.parametrize(
    ("script", "extra", "said"),
    [
        ("raise SystemExit(3)", "", "exit code 3"),
        ("", "", "there is no file 'out.csv'"),
        ("open('out.csv','w').write('stage,H,V,D\\nhalf,1,2,nan\\nopen,1,1,1\\n')", "", "is nan"),
        ("open('out.csv','w').write('stage,H,V,D\\nhalf,1,2,3\\n')", "", "no rows with stage"),
        ("import time; time.sleep(30)", "\n  time_limit: 0.2 s", "took longer than 0.2 s"),
        ("import os; os.kill(os.getpid(), 11)", "", "signal 11"),
    ],
)
def test_whatever_goes_wrong_in_a_run_is_said(tmp_path, script, extra, said):
    model = EXTERNAL.rstrip("\n") + extra + "\n"
    case = write_case(tmp_path, model, script=script)
    model = build_model(load_inputs(str(case)))
    with trusted(), pytest.raises(ModelError, match=said):
        model.computed(np.array([6e9, 1.0]))
    assert runs_of(case)[0]["failed"]
    assert (tmp_path / "case.runs" / "00001" / "opening.in").is_file()


@pytest.mark.parametrize(
    ("command", "message", "hint"),
    [
        (
            "no-such-program",
            "there is no program 'no-such-program' on the search path (PATH)",
            "Install it, or write its path; one with / is seen from the folder of the case.",
        ),
        (
            "opening.py",
            "there is no program 'opening.py' on the search path (PATH)",
            "Write './opening.py' for the one beside the case.",
        ),
        ("./opening.py", "'HERE/opening.py' may not be executed", "chmod +x HERE/opening.py"),
        ("./openin.py", "there is no program 'HERE/openin.py'", "Did you mean 'opening.py'?"),
    ],
)
def test_a_program_that_cannot_be_run_is_said_with_what_to_do(tmp_path, command, message, hint):
    begun = EXTERNAL.partition("[")[2].partition("]")[0]
    case = write_case(tmp_path, EXTERNAL.replace(begun, command, 1))
    with trusted(), pytest.raises(InputError) as caught:
        build_model(load_inputs(str(case))).computed(np.array([6e9, 1.0]))
    (fault,) = caught.value.faults
    assert (fault.code, fault.path) == ("no-program", "model.command[0]")
    here = str(tmp_path)
    assert fault.message == message.replace("HERE", here)
    assert fault.hint == hint.replace("HERE", here)


def test_failed_runs_are_made_again_only_if_asked(tmp_path):
    case = write_case(tmp_path, script="raise SystemExit(3)")
    p = np.array([6e9, 1.0])
    for fresh, number in ((False, 1), (False, 1), (True, 2)):
        model = build_model(load_inputs(str(case)), fresh=fresh)
        with trusted(), pytest.raises(ModelError):
            model.computed(p)
        assert len(runs_of(case)) == number


def test_a_stop_ends_what_is_running(tmp_path):
    slow = "open('began','w'); import time; time.sleep(60)"
    case = write_case(tmp_path, script=slow)
    model = build_model(load_inputs(str(case)))

    def stop(state):
        if list((tmp_path / "case.runs").glob("*/began")):
            raise Interrupted("Interrupted.")

    model.on_state = stop
    with trusted(), pytest.raises(Interrupted):
        model.computed(np.array([6e9, 1.0]))
    assert not (tmp_path / "case.runs" / "runs.jsonl").exists()


def test_nothing_is_run_before_somebody_has_said_so(tmp_path):
    case = write_case(tmp_path)
    refused = run_command("simulate", case)
    assert refused.exit_code == ExitCode.INVALID_INPUT
    assert "case.yaml:4:3: model.command: the case runs" in refused.output
    assert "(with opening.py), and it is not trusted yet" in refused.output
    assert not (tmp_path / "case.runs").exists()
    checked = run_command("check", case)
    assert checked.exit_code == 0
    assert "the model is external: `" in checked.output
    assert not (tmp_path / "case.runs").exists()
    assert run_command("simulate", case, "--trust").exit_code == 0
    assert run_command("simulate", case).exit_code == 0  # remembered
    (tmp_path / "opening.py").write_text(PROGRAM + "\n# another\n")
    assert run_command("simulate", case).exit_code == ExitCode.INVALID_INPUT


def test_trust_that_comes_with_the_case_counts_for_nothing(tmp_path, monkeypatch):
    case = write_case(tmp_path)
    assert run_command("simulate", case, "--trust").exit_code == 0
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "of another user"))
    runs = tmp_path / "case.runs" / "runs.jsonl"
    runs.unlink()
    assert run_command("simulate", case).exit_code == ExitCode.INVALID_INPUT


@pytest.mark.usefixtures("plain_pictures")
def test_predict_scan_show_and_report_work_on_it(tmp_path):
    case = write_case(tmp_path)
    grid = "fit.scan={grid: {E: {from: 4 GPa, to: 8 GPa, points: 3}}}"
    steps = [
        ("fit", case, "--trust", "--set", "fit.stages=[half]", "-q"),
        ("predict", tmp_path / "case.fit.h5", "-q"),
        ("scan", case, "--set", grid, "-q"),
        ("show", tmp_path / "case.fit.h5", tmp_path / "case.predict.h5", tmp_path / "case.scan.h5"),
        ("report", tmp_path / "case.fit.h5", "-o", tmp_path / "page.html"),
    ]
    for step in steps:
        done = run_command(*step)
        assert done.exit_code == 0, done.output
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "The model is external (external): " in page
    fitted_half = read_result(tmp_path / "case.fit.h5").gauges.computed[:, 0]
    prediction = read_result(tmp_path / "case.predict.h5").prediction
    np.testing.assert_allclose(prediction.mean[:, 1], 2.0 * fitted_half, rtol=1e-2)
    assert np.all(prediction.sd[:, 1] > 0.0)


@pytest.mark.slow  # the simplex elsewhere: of a table, and in tests/identify
def test_a_simplex_search_needs_runs_only(tmp_path):
    case = write_case(tmp_path)
    found = fitted(
        case, overrides=("fit.method=simplex", "fit.simplex.delta=1e-3", "fit.model_error=none")
    )
    assert found.status == "converged"
    assert found.parameters.values[0] == pytest.approx(8.331e9, rel=1e-2)


def test_outputs_are_read_at_a_zero(tmp_path):
    model = EXTERNAL + "# zeroed\n"
    case = write_case(tmp_path, model)
    text = case.read_text().replace("H: {kind: reading,", "H: {kind: reading, zero: half,")
    case.write_text(text)
    readings = tmp_path / "readings.csv"
    readings.write_text(readings.read_text().replace("H,half,0.53,mm\n", ""))
    model = build_model(load_inputs(str(case)))
    with trusted():
        table = model.computed(np.array([6e9, 1.0]))
        absolute = next(model.runs.each([np.array([6e9, 1.0])], lambda: None))
    assert table[0].tolist() == [0.0, absolute[1, 0] - absolute[0, 0]]
    np.testing.assert_array_equal(table[1:], absolute[:, 1:].T)
    assert model.unreadable("H", "open") is None
    assert replace(model.case, title="x").elsewhere is not None


@pytest.mark.usefixtures("answered_here")
def test_several_cases_are_trusted_together(tmp_path):
    # functions, whose calls start no program each; what they find is not looked at
    cases = [write_case(tmp_path / name, PYTHON, script=SCRIPT) for name in ("a", "b")]
    one = ("-q", "-j", "1", "--set", "fit.model_error=none")
    assert run_command("fit", *cases, *one).exit_code == ExitCode.SOME_FAILED
    done = run_command("fit", *cases, *one, "--trust")
    assert done.exit_code == 0, done.output
    assert all(case.with_suffix(".fit.h5").exists() for case in cases)


def test_no_two_runs_share_a_folder(tmp_path):
    with ThreadPoolExecutor(8) as pool:
        made = list(pool.map(lambda _: new_folder(tmp_path / "case.runs"), range(64)))
    assert len(set(made)) == 64
    assert new_folder(tmp_path / "case.runs").name == "00065"

"""Dakota's files of parameters and results: as Dakota 6.24 wrote and reads them."""

import re
from pathlib import Path

import numpy as np
import pytest

from geoident.workflow.simulate import simulate
from tests.support.trench import CASE

STANDARD = """\
                                          2 variables
                      5.000000000000000e+00 E
                      1.500000000000000e+00 K0
                                          3 functions
                                          3 ASV_1:cv_first
                                          2 ASV_2:s_first
                                          1 ASV_3:x.a_second
                                          2 derivative_variables
                                          1 DVV_1:E
                                          2 DVV_2:K0
                                          0 analysis_components
                                          1 eval_id
                                          0 metadata
"""

APREPRO = """\
                    { DAKOTA_VARS     =                      2 }
                    { E               =  5.000000000000000e+00 }
                    { K0              =  1.500000000000000e+00 }
                    { DAKOTA_FNS      =                      3 }
                    { ASV_1:cv_first  =                      3 }
                    { ASV_2:s_first   =                      2 }
                    { ASV_3:x.a_second =                      1 }
                    { DAKOTA_DER_VARS =                      2 }
                    { DVV_1:E         =                      1 }
                    { DVV_2:K0        =                      2 }
                    { DAKOTA_AN_COMPS =                      0 }
                    { DAKOTA_EVAL_ID  =                      1 }
                    { DAKOTA_METADATA =                      0 }
"""


def asked(run, text, *words, results="results.out"):
    Path("params.in").write_text(text)
    return run("simulate", "case.yaml", "--dakota", "params.in", results, *words)


def readings(E, K0):
    overrides = [f"parameters.E.start={E!r} GPa", f"parameters.K0.start={K0!r}"]
    found = simulate("case.yaml", overrides=overrides).readings
    return {f"{r.channel}_{r.stage}".lower(): 1e3 * r.value for r in found}


@pytest.mark.parametrize("text", [STANDARD, APREPRO])
def test_what_is_asked_for_is_answered_in_its_order(trench, run, text):
    done = asked(run, text)
    assert (done.exit_code, done.stdout) == (0, "")
    values, gradients = [], []
    for line in Path("results.out").read_text().splitlines():
        if line.startswith("["):
            gradients.append([float(word) for word in line.strip("[] ").split()])
        else:
            values.append((line.split()[1], float(line.split()[0])))
    at = readings(5.0, 1.5)
    assert [name for name, _ in values] == ["cv_first", "x.a_second"]
    assert [value for _, value in values] == pytest.approx([at["cv_first"], at["x.a_second"]])
    h = 1e-5
    by_E = {k: (v - readings(5.0 - h, 1.5)[k]) / (2 * h) for k, v in readings(5.0 + h, 1.5).items()}
    by_K = {k: (v - readings(5.0, 1.5 - h)[k]) / (2 * h) for k, v in readings(5.0, 1.5 + h).items()}
    expected = [[by_E[name], by_K[name]] for name in ("cv_first", "s_first")]
    assert np.array(gradients) == pytest.approx(np.array(expected), rel=1e-6)


def test_derivatives_come_by_the_variables_that_are_asked_for(trench, run):
    asked(run, STANDARD)
    both = re.findall(r"\[ (\S+) (\S+) \]", Path("results.out").read_text())
    text = STANDARD.replace("2 derivative_variables", "1 derivative_variables")
    text = "".join(line for line in text.splitlines(True) if "DVV_1" not in line)
    asked(run, text, "--force")
    one = re.findall(r"\[ (\S+) \]", Path("results.out").read_text())
    assert one == [second for _, second in both]


def test_the_number_of_an_experiment_after_a_name_is_no_part_of_it(trench, run):
    asked(run, STANDARD)
    expected = Path("results.out").read_text()
    assert asked(run, STANDARD.replace("_first", "_first_1"), "--force").exit_code == 0
    found = Path("results.out").read_text()
    assert found.replace("_first_1", "_first") == expected


def test_a_parameter_that_dakota_does_not_vary_keeps_its_start(trench, run):
    text = STANDARD.replace("2 variables", "1 variables")
    text = "".join(line for line in text.splitlines(True) if not re.search("e.00 K0|DVV_2", line))
    text = text.replace("2 derivative", "1 derivative")
    assert asked(run, text).exit_code == 0
    value = float(Path("results.out").read_text().split()[0])
    assert value == pytest.approx(readings(5.0, 1.0)["cv_first"])


def test_a_model_without_solution_is_a_failure_that_dakota_captures(trench, run):
    text = CASE.replace("E: $E, nu: 0.25}", "E: $E, nu: $nu}")
    text = text.replace("parameters:\n", "parameters:\n  nu: {start: 0.25, bounds: [0.1, 0.9]}\n")
    (trench / "case.yaml").write_text(text)
    request = STANDARD.replace("2 variables", "3 variables\n 0.7 nu")
    done = asked(run, request)
    assert done.exit_code == 5, done.output
    first, reason = Path("results.out").read_text().splitlines()
    assert first == "FAIL"
    assert reason in " ".join(done.stderr.split())


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("e+00 E\n", "e+00 F\n", "params.in:2:45: there is no parameter 'F'"),
        ("5.000000000000000e+00", "500", "params.in:2:23: E = 500 is outside its bounds"),
        ("5.000000000000000e+00", "'soft'", "'soft' is not a number"),
        ("cv_first", "cv_frist", "params.in:5:45: the response 'cv_frist' is not a reading"),
        ("3 ASV_1", "7 ASV_1", "params.in:5:43: second derivatives (a Hessian) of 'cv_first'"),
        ("3 ASV_1", "9 ASV_1", "params.in:5:43: '9' is not an entry of the active set vector"),
        ("DVV_2:K0", "DVV_2:K1", "params.in:10:45: there is no parameter 'K1'"),
        ("0 metadata", "1 metadata", "params.in:13:43: 1 values of metadata are requested"),
        ("2 variables", "two things", "expected the number of variables"),
        ("2 variables", "20 variables", "the file ends after 12 of 20 variables"),
        (STANDARD, " 2 variables\n 5 E\n", "the file ends after 1 of 2 variables"),
        (STANDARD, " 1 variables\n 5 E\n", "ends where the number of functions is expected"),
        (STANDARD, "E=5\n", "params.in:1:1: 'E=5' is not a line of a parameter file of Dakota"),
        ("2 variables", f"{2**63} variables", "expected the number of variables"),
        ("2 variables", "\u00b2 variables", "expected the number of variables"),
        ("3 ASV_1", "\u00b2 ASV_1", "'\u00b2' is not an entry of the active set vector"),
        (STANDARD, "", "ends where the number of variables is expected"),
    ],
)
def test_faults_of_a_request_have_their_place_and_leave_no_results(trench, run, old, new, said):
    done = asked(run, STANDARD.replace(old, new))
    assert done.exit_code == 3, done.output
    assert said in done.stderr
    assert not Path("results.out").exists()


def test_nothing_that_is_there_is_replaced_unasked(trench, run):
    Path("results.out").write_text("mine")
    assert asked(run, STANDARD).exit_code == 6
    assert Path("results.out").read_text() == "mine"
    for own in ("params.in", "case.yaml", "trench.inp"):
        assert asked(run, STANDARD, "--force", results=own).exit_code == 6
    assert Path("params.in").read_text() == STANDARD


@pytest.mark.parametrize("word", ["--noise", "--draw", "--json", "-o=x.csv", "--values=x.csv"])
def test_other_options_do_not_go_with_it(trench, run, word):
    words = (word,) if word.startswith("--") else ("-o", "x.csv")
    assert asked(run, STANDARD, *words).exit_code == 2


def test_the_input_file_has_the_case(trench, run):
    done = run("export", "case.yaml", "--format", "dakota")
    assert done.exit_code == 0
    assert done.stdout.splitlines() == ["case.dakota/case.in", "case.dakota/case.dat"]
    text = Path("case.dakota/case.in").read_text()
    assert "descriptors 'E' 'K0'\n    initial_point 2.0 1.0\n    lower_bounds 0.1 0.2" in text
    assert "analysis_drivers = 'geoident simulate ../case.yaml -q --dakota'" in text
    assert "'cv_first' 's_first' 'x.a_first'" in text
    numbers = [float(word) for word in Path("case.dakota/case.dat").read_text().split()]
    assert numbers == pytest.approx([-0.598, -0.1226, 0.0627, 1e-4, 1e-4, 1e-4])


def test_what_dakota_is_not_told_is_said(trench, run):
    prior = "scale: log, prior: {mean: 4 GPa, sd: 1 GPa}}"
    (trench / "case.yaml").write_text(CASE.replace("scale: log}", prior))
    said = run("export", "case.yaml", "--format", "dakota").stderr
    assert "the priors of E are left out" in said
    assert "readings share errors" not in said
    shared = CASE.replace("accuracy: 0.01 mm}", "accuracy: {reading: 0.01 mm, zero: 0.02 mm}}", 1)
    (trench / "case.yaml").write_text(shared.replace("stages: [first], ", ""))
    said = run("export", "case.yaml", "--format", "dakota", "--force").stderr
    assert "readings share errors, of which Dakota knows only their size" in said


@pytest.mark.parametrize(("form", "program"), [("dakota", "Dakota"), ("pest", "PEST")])
def test_a_case_from_stdin_is_none_that_can_be_run_again(trench, run, form, program):
    refused = run("export", "-", "--format", form, stdin=CASE)
    assert refused.exit_code == 2
    said = " ".join(refused.stderr.split())
    assert f"{program} runs the case again and again: save it as a file and name that" in said


FUNCTION = """\
format: geoident-case/1
model: {kind: python, function: "mine:readings"}
parameters:
  E: {start: 6 GPa, bounds: [1 GPa, 50 GPa], scale: log}
  K0: {start: 1.0, bounds: [0.3, 3.0]}
stages: [{name: first}, {name: second}]
gauges:
  CV: {kind: reading, accuracy: 0.05 mm}
  S: {kind: reading, accuracy: 0.05 mm}
  X.a: {kind: reading, accuracy: 0.05 mm}
readings: []
"""

MINE = """\
def readings(p):
    u = 1e7 * p["K0"] / p["E"]
    return {"CV": [u, 2 * u], "S": [u * p["K0"], u], "X.a": [-u, 3 * u]}
"""


def test_another_program_gives_differences(trench, run, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(trench / "state"))
    Path("case.yaml").write_text(FUNCTION)
    Path("mine.py").write_text(MINE)
    assert asked(run, STANDARD).exit_code == 3  # nothing is run unasked
    assert asked(run, STANDARD, "--trust").exit_code == 0
    numbers = [float(x) for x in re.findall(r"\S+e[-+]\d+", Path("results.out").read_text())]
    # u = 10 K0 / E in mm and GPa: 3 at E = 5, K0 = 1.5
    expected = [3.0, 9.0, -3.0 / 5, 2.0, -4.5 / 5, 6.0]
    assert numbers == pytest.approx(expected, rel=1e-5)

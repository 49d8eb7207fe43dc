"""A function of Python as the model, with derivatives of its own or without, and what it may do."""

import json
import re

import numpy as np
import pytest
from support.commands import run_command
from support.external import PYTHON, SCRIPT, trusted, write_case

import geoident
from geoident.errors import InputError, ModelError
from geoident.workflow.fit import fit
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Request, build_model, load_inputs, plan_fit

JACOBIAN = (
    SCRIPT
    + """

def slopes(values):
    at, h = readings(values), 1e-6
    rows = []
    moved = {name: readings({**values, name: values[name] * (1 + h)}) for name in values}
    return [[[FACTOR * (moved[p][g][s] - at[g][s]) / (h * values[p]) for p in values]
             for s in STAGES] for g in GAUGES]


FACTOR = 1.0
"""
)
P = np.array([6e9, 1.1])


@pytest.fixture(autouse=True)
def own_state(tmp_path, monkeypatch):
    """Decisions of these tests are not those of who runs them."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def python_case(tmp_path, script=SCRIPT, model=PYTHON):
    return write_case(tmp_path, model, script=script)


def computed(case, p=P):
    model = build_model(load_inputs(str(case)))
    with trusted():
        return model.computed(p)


def test_a_function_is_fitted_from_python(tmp_path):
    case = geoident.load_case(python_case(tmp_path))
    with pytest.raises(InputError, match=r"`geoident.trust\(case\)` runs it"):
        geoident.fit(case)
    geoident.trust(case)
    found = geoident.fit(case)
    assert found.status == "converged"
    assert found.parameters["E"].value == pytest.approx(8.331e9, rel=1e-3)
    assert found.data.counts.evaluations > 10


def test_it_imports_from_beside_it_what_it_says_and_nothing_else_does(tmp_path):
    """Its own file comes before Python's of that name, and none that others would import."""
    said = "import profile\nimport statistics\n\nassert profile.MINE\n"
    case = python_case(tmp_path, said + SCRIPT)
    (tmp_path / "profile.py").write_text("MINE = True\n")
    for name in ("random", "decimal", "numbers"):  # which `statistics` and `pickle` import
        (tmp_path / f"{name}.py").write_text("raise SystemExit('not trusted')\n")
    assert np.isfinite(computed(case)).all()


def test_its_derivatives_are_used(tmp_path):
    plain = python_case(tmp_path / "plain")
    given = python_case(
        tmp_path / "given", JACOBIAN, PYTHON.replace("}", ', jacobian: "opening:slopes"}')
    )
    with trusted():
        one, two = (fit(plan_fit(Request(str(case))), Control()).result for case in (plain, given))
    np.testing.assert_allclose(two.parameters.values, one.parameters.values, rtol=1e-5)
    np.testing.assert_allclose(two.sensitivity, one.sensitivity, rtol=1e-3, atol=1e-22)
    assert two.counts.evaluations < one.counts.evaluations


def test_wrong_derivatives_are_found_out(tmp_path):
    script = JACOBIAN.replace("FACTOR = 1.0", "FACTOR = 1.1")
    case = python_case(tmp_path, script, PYTHON.replace("}", ', jacobian: "opening:slopes"}'))
    model = build_model(load_inputs(str(case)))
    with trusted(), pytest.raises(ModelError, match="differ from differences") as caught:
        model.linear(P)
    assert caught.value.fault.path == "model.jacobian"
    remedy = "Correct them, or remove 'jacobian' to have differences taken."
    assert caught.value.hint == remedy


@pytest.mark.parametrize(
    ("body", "extra", "said"),
    [
        ("raise ValueError('no way')", "", "ValueError: no way"),
        ("import os; os._exit(7)", "", "the process of .readings. ended with exit code 7"),
        ("while True: pass", ", time_limit: 0.5 s", "took longer than 0.5 s"),
        ("return {'H': 1.0}", "", "gauge"),
        ("return {'H': [1, 2], 'V': [1, 2]}", "", "no reading of 'D'"),
        ("return {'H': {'half': 1}, 'V': [1, 2], 'D': [1, 2]}", "", "of 'H' at 'open'"),
        ("return [[1, 2], [3, 4], [5, float('inf')]]", "", "gave inf for 'D' at 'open'"),
        ("return [1.0, 2.0]", "", "the function gave 2; gauges x stages, 3 x 2"),
        ("return 'soft'", "", "no numbers"),
    ],
)
def test_whatever_goes_wrong_in_a_call_is_said(tmp_path, body, extra, said):
    said = "no reading of 'V'" if said == "gauge" else said
    script = f"def readings(values):\n    {body}\n"
    case = python_case(tmp_path, script, PYTHON.replace("}", extra + "}"))
    with pytest.raises(ModelError, match=said):
        computed(case)


def test_calls_are_logged_and_what_is_printed_does_not_mix_with_results(tmp_path, capfd):
    script = SCRIPT.replace("    E, K = values", "    print('at work')\n    E, K = values")
    case = python_case(tmp_path, script)
    first, second = computed(case), computed(case)
    np.testing.assert_array_equal(first, second)
    assert len((tmp_path / "case.runs" / "runs.jsonl").read_text().splitlines()) == 1
    assert (tmp_path / "case.runs" / "printed.txt").read_text() == "at work\n"
    assert capfd.readouterr().out == ""


def test_an_array_of_one_number_a_gauge_serves_one_stage(tmp_path):
    case = python_case(tmp_path, "def readings(values):\n    return [1.0, 2.0, values['E']]\n")
    text = case.read_text().replace("stages: [{name: half}, {name: open}]\n", "")
    case.write_text(text)
    (tmp_path / "readings.csv").write_text("gauge,stage,value,unit\nH,end,1,mm\n")
    assert computed(case).tolist() == [[1.0], [2.0], [6e9]]
    entry = json.loads((tmp_path / "case.runs" / "runs.jsonl").read_text())
    assert entry["parameters"] == {"E": 6e9, "K0": 1.1}


def test_a_result_beside_another_model_of_that_name_says_so(tmp_path):
    """There is no mesh to speak of."""
    case = python_case(tmp_path)
    fitted = run_command("fit", case, "--trust")
    assert fitted.exit_code == 0, fitted.output
    (tmp_path / "opening.py").write_text(SCRIPT.replace("a=2.0", "a=2.5"))
    done = run_command("predict", tmp_path / "case.fit.h5", "--trust")
    said = " ".join(done.output.split())
    assert done.exit_code == 3
    assert "The model is not the one that the fit was made with: the function 'readings' of" in said
    assert "mesh" not in said


def test_how_long_a_sample_takes_is_said_before(tmp_path):
    """400 draws of a model that takes a twentieth of a second take 20 s at least."""
    slow = "import time\n" + SCRIPT.replace("    E, K =", "    time.sleep(0.05)\n    E, K =")
    case = python_case(tmp_path, slow)
    assert run_command("fit", case, "--trust").exit_code == 0
    flags = ("--effective", "400", "--max-time", "3s", "-j", "1")
    done = run_command("sample", tmp_path / "case.fit.h5", *flags, "--trust")
    said = " ".join(done.output.split())
    assert "An evaluation takes 0.0" in said
    least, most = map(int, re.findall(r"400 independent draws takes (\d+) s to (\d+) s", said)[0])
    assert least >= 20
    assert most == pytest.approx(5 * least, rel=0.05)
    assert "(400 to 2000 evaluations)" in said


def test_the_next_command_after_a_check_has_the_flag_that_it_needs(tmp_path):
    """Until it is remembered that the function may run."""
    case = python_case(tmp_path)
    checked = run_command("check", case)
    assert checked.exit_code == 0, checked.output
    assert f"geoident fit {case} --trust" in checked.output
    assert run_command("fit", case, "--trust").exit_code == 0
    assert f"geoident fit {case}\n" in f"{run_command('check', case).output}\n"

"""geoident from Python: typed, lazy, and the same numbers as the commands."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import geoident
from geoident import fit, load_case, predict, sample
from geoident.cli.app import geoident as program
from geoident.errors import InputError, OutputError
from tests.support.trench import write_case

CASES = Path(__file__).parents[2] / "cases"


@pytest.fixture
def case(tmp_path):
    return load_case(write_case(tmp_path))


def test_a_fit_has_the_numbers_of_the_command(case, run_cli):
    found = fit(case)
    assert found.converged
    assert not found.up_to_date
    assert Path(found.path).name == "case.fit.h5"
    told = run_cli("show", found.path, "--json")["parameters"]
    assert set(found.parameters) == set(told)
    for name, parameter in found.parameters.items():
        for key in ("value", "sd", "lower95", "upper95", "unit", "at_bound", "determined"):
            assert getattr(parameter, key) == told[name][key]


@pytest.fixture
def run_cli():
    return lambda *words: json.loads(CliRunner().invoke(program, list(words)).stdout)


def test_the_same_input_is_up_to_date_and_other_input_is_not_overwritten(case):
    fit(case)
    assert fit(case).up_to_date
    other = load_case(case.path, {"parameters.E.start": "9 GPa"})
    assert other.case.parameters[0].start == 9e9
    with pytest.raises(OutputError):
        fit(other)
    assert fit(other, force=True).parameters["E"].value == pytest.approx(5e9, rel=0.05)


def test_progress_is_told(case):
    steps = []
    fit(case, progress=steps.append)
    assert [step.number for step in steps] == list(range(len(steps)))
    assert steps[-1].objective < steps[0].objective


def test_readings_of_a_channel(case):
    found = fit(case.path)
    readings = found.readings("CV")
    assert set(readings) == {"first", "second"}
    assert readings["first"][0] == pytest.approx(-0.598e-3)
    assert readings["first"][1] == pytest.approx(-0.598e-3, abs=3e-5)
    with pytest.raises(KeyError, match="there are CV, S"):
        found.readings("X")


def test_predictions_come_from_a_fit_or_its_file(case, tmp_path):
    found = fit(case)
    one = predict(found, stages=["second"])
    other = predict(found.path, stages=["second"], case=case, output=tmp_path / "other.h5")
    assert one.result.prediction is not None
    assert other.result.prediction is not None
    column = one.result.gauges.stages.index("second")
    mean = one.result.prediction.mean[:, column]
    assert mean == pytest.approx(other.result.prediction.mean[:, column], rel=1e-9)
    assert mean[0] == pytest.approx(-1.077e-3, abs=5e-5)


def test_faults_are_raised_with_their_places(case):
    Path(case.path).write_text(Path(case.path).read_text().replace("E: $E", "E: $F"))
    with pytest.raises(InputError) as caught:
        load_case(case.path)
    assert caught.value.faults[0].location.line > 1


def test_the_package_loads_its_parts_when_asked(capsys):
    code = "import sys, geoident; print(sorted({'numpy', 'pydantic', 'h5py'} & set(sys.modules)))"
    command = [sys.executable, "-c", code]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "[]\n"
    assert {"fit", "load_case", "predict"} <= set(dir(geoident))
    with pytest.raises(AttributeError, match="no attribute 'fitt'"):
        geoident.fitt  # noqa: B018


def test_the_notebook_runs():
    command = [sys.executable, "-W", "error", str(CASES / "notebook.py")]
    told = subprocess.run(command, capture_output=True, text=True, check=False)
    assert told.returncode == 0, told.stderr
    assert "EX-P.w1 after bench 1" in told.stdout
    assert "from 60 GPa the modulus changes by" in told.stdout


def test_a_posterior_is_sampled_from_a_fit_or_its_file(case, tmp_path):
    found = fit(case)
    one = sample(found, draws=500, effective=300)
    again = sample(found.path, draws=500, effective=300)
    assert one.converged
    assert again.up_to_date
    drawn = one.result.posterior.flat
    assert drawn.shape == (500, 2)
    assert one.parameters["E"].lower95 == pytest.approx(np.quantile(drawn[:, 0], 0.025))

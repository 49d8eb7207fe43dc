"""The case with a table of runs: its fit is that of the model behind the table, and its truth."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from geoident.cli.app import geoident
from geoident.units import read_quantity
from geoident.workflow.running.jobs import build_model, load_inputs

CASES = Path(__file__).parents[2] / "cases"
TABLE, DAM = CASES / "runs-table", CASES / "gravity-dam"


def fit(case, output, *words):
    command = ["fit", str(case), "-o", str(output), "--json", "-q", *words]
    found = CliRunner().invoke(geoident, command)
    assert found.exit_code == 0, found.output
    return json.loads(found.stdout)


@pytest.fixture(scope="module", params=["polynomial", pytest.param("auto", marks=pytest.mark.slow)])
def found(request, tmp_path_factory):
    """Its fit, by surfaces that are soon fitted, and as it comes."""
    return fit(
        TABLE / "case.yaml",
        tmp_path_factory.mktemp("table") / "o.h5",
        *("--set=fit.backtest=false", "--set=fit.model_error=none"),
        f"--set=model.surface={request.param}",
    )


def test_it_finds_the_truth_and_predicts_the_later_stages(found):
    assert found["status"] == "converged"
    truth = yaml.safe_load((TABLE / "truth.yaml").read_text())
    assert truth == yaml.safe_load((DAM / "truth.yaml").read_text())
    for name, value in truth.items():
        known = found["parameters"][name]
        assert known["lower95"] <= read_quantity(str(value)).value <= known["upper95"]
    scored = [p for p in found["predictions"] if p["measured"] is not None]
    inside = [p["lower95"] <= p["measured"] <= p["upper95"] for p in scored]
    assert len(scored) == 22
    assert np.mean(inside) >= 0.9


def test_its_fit_is_that_of_the_model_behind_it(found, tmp_path):
    plain = ["fit.model_error=none", "fit.mesh_error=false", "fit.backtest=false"]
    words = [word for change in plain for word in ("--set", change)]
    own = fit(DAM / "case.yaml", tmp_path / "o.h5", *words)
    for name, known in own["parameters"].items():
        sd = known["sd"]
        assert found["parameters"][name]["value"] == pytest.approx(known["value"], abs=0.05 * sd)
        assert found["parameters"][name]["sd"] == pytest.approx(sd, rel=0.02)
    assert found["objective"] == pytest.approx(own["objective"], rel=0.01)


def test_its_rows_are_runs_of_that_model():
    model = build_model(load_inputs(str(DAM / "case.yaml")))
    with (TABLE / "runs.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 120
    assert (TABLE / "runs.csv").stat().st_size < 100_000
    for row in (rows[0], rows[77]):
        names = ("E_dam [GPa]", "E_rock [GPa]", "alpha [1/K]")
        p = np.array([float(row[name]) for name in names]) * [1e9, 1e9, 1.0]
        computed = model.computed(p)
        channels = [channel.name for channel in model.case.channels]
        stages = [stage.name for stage in model.case.stages]
        for name, cell in row.items():
            gauge, at, stage = name.removesuffix(" [mm]").partition(" @ ")
            if at:
                value = computed[channels.index(gauge), stages.index(stage)]
                assert float(cell) == pytest.approx(1e3 * value, abs=6e-4 + 1e-5 * abs(1e3 * value))

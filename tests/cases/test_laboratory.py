"""The case of laboratory tests: rows of hypoplastic sand, constants of hardening soil."""

import json
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner

from geoident.cli.app import geoident
from geoident.io.case.file import read_case
from geoident.units import read_quantity

FOLDER = Path(__file__).parents[2] / "cases" / "laboratory"


def test_it_has_its_files_and_the_rows_of_each_test():
    case = read_case(str(FOLDER / "case.yaml")).case
    assert {"make_readings.py", "truth.yaml"} <= {file.name for file in FOLDER.iterdir()}
    read = [reading.channel for reading in case.readings]
    assert {channel.name for channel in case.channels} == set(read)
    assert read.count("OED axial strain") == 6
    assert set(truth()) <= {parameter.name for parameter in case.parameters}


@pytest.mark.slow
def test_its_fit_comes_near_what_the_curves_say(tmp_path):
    """Strength and dilation closely; moduli as far as the law follows such sand."""
    output, case = str(tmp_path / "a.h5"), str(FOLDER / "case.yaml")
    done = CliRunner().invoke(geoident, ["fit", case, "-o", output, "--json"])
    result = json.loads(done.stdout)
    allowed = {"phi": 0.02, "psi": 0.15, "m": 0.1, "Eoed": 0.2, "E50": 0.35}
    for name, text in truth().items():
        found = result["parameters"][name]["value"]
        assert found == pytest.approx(read_quantity(text).value, rel=allowed[name]), name


def truth():
    """What the curves without noise say, as texts."""
    return yaml.load((FOLDER / "truth.yaml").read_text(), Loader=yaml.BaseLoader)

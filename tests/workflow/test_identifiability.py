"""What planned gauges could determine, asked before anything is read."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner
from support.trench import CASE, write_case

from geoident.cli.app import geoident
from geoident.errors import InputError
from geoident.workflow.identifiability import identifiability
from tests.support.commands import said_findings


def _invoke(*words):
    return CliRunner().invoke(geoident, [str(word) for word in words])


def test_it_foretells_the_intervals_of_the_fit(tmp_path):
    """At the estimate, planned and found standard deviations are the same numbers."""
    case = write_case(tmp_path)
    fit = json.loads(_invoke("fit", case, "--json", "-q").stdout)["parameters"]
    at = [
        f"parameters.E.start={fit['E']['value']:.12g} Pa",
        f"parameters.K0.start={fit['K0']['value']:.12g}",
    ]
    plan = identifiability(str(case), overrides=at)
    assert plan.readings == 3
    found = [fit["E"]["sd"], fit["K0"]["sd"]]
    np.testing.assert_allclose(plan.parameters.sd, found, rtol=1e-6)


def test_the_readings_need_not_exist(tmp_path):
    case = write_case(tmp_path)
    (tmp_path / "readings.csv").unlink()
    result = _invoke("check", case, "--identifiability")
    assert result.exit_code == 0
    assert "3 planned readings" in result.stdout


def test_what_gauges_cannot_tell_apart_is_named(tmp_path):
    case = write_case(tmp_path)
    text = CASE.replace("vertical: 1 MPa", "vertical: $sv").replace(
        "parameters:", "parameters:\n  sv: {start: 1 MPa, bounds: [0.1 MPa, 9 MPa], scale: log}"
    )
    case.write_text(text)
    result = json.loads(_invoke("check", case, "--identifiability", "--json").stdout)
    assert result["parameters"]["E"]["determined"] is False
    assert result["parameters"]["E"]["value"] is None
    assert result["parameters"]["K0"]["determined"] is True
    assert any("E" in finding and "sv" in finding for finding in said_findings(result))


def test_a_fit_without_stages_to_read_is_refused_with_its_place(tmp_path):
    case = write_case(tmp_path)
    text = CASE.replace("accuracy: 0.01 mm}", "accuracy: 0.01 mm, zero: first}")
    case.write_text(text.replace("readings: readings.csv\n", ""))
    with pytest.raises(InputError, match="no gauge can be read in the stages of the fit"):
        identifiability(str(case))

"""Input that is allowed and seldom meant: it is said, not refused."""

from __future__ import annotations

import json

from click.testing import CliRunner
from support.trench import CASE, READINGS, write_case

from geoident.cli.app import geoident


def _json(command, case):
    result = CliRunner().invoke(geoident, [command, str(case), "--json", "-q"])
    return json.loads(result.stdout)


def _fit(folder, readings, text=CASE):
    case = write_case(folder)
    case.write_text(text)
    (folder / "readings.csv").write_text(readings)
    return _json("fit", case)


def test_virgin_ground_in_tension_is_noted(tmp_path):
    case = write_case(tmp_path)
    assert not any("tension" in note for note in _json("check", case)["notes"])
    case.write_text(CASE.replace("vertical: 1 MPa", "vertical: -1 MPa"))
    assert any("virgin ground is in tension" in note for note in _json("check", case)["notes"])


def test_gravity_without_any_density_is_noted(tmp_path):
    case = write_case(tmp_path)
    case.write_text(CASE.replace("in_situ:", "gravity: 9.81 m/s2\nin_situ:"))
    assert any("nothing weighs" in note for note in _json("check", case)["notes"])
    case.write_text(case.read_text().replace("nu: 0.25", "nu: 0.25, density: 2600 kg/m3"))
    assert not any("nothing weighs" in note for note in _json("check", case)["notes"])


def test_readings_that_go_the_other_way_are_told_from_bad_ones(tmp_path):
    rows = READINGS.splitlines()
    turned = [
        ",".join([*row.split(",")[:2], str(-float(row.split(",")[2])), row.split(",")[3]])
        for row in rows[1:]
    ]
    every_stage = CASE.replace(", stages: [first]", "").replace(
        "bounds: [0.2, 4]", "bounds: [0.9, 4]"
    )
    found = _fit(tmp_path, "\n".join([rows[0], *turned]) + "\n", every_stage)
    assert any("go the other way than the model" in finding for finding in found["findings"])


def test_a_model_that_does_not_meet_the_readings_says_so_at_once(tmp_path):
    good = _fit(tmp_path, READINGS)
    assert "does not meet" not in good["reason"]
    other = tmp_path / "other"
    other.mkdir()
    bent = READINGS.replace("CV,first,-0.598", "CV,first,-0.2").replace(
        "S,first,-0.1226", "S,first,0.9"
    )
    assert "does not meet the readings" in _fit(other, bent)["reason"]

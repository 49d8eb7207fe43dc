"""The certificate of identified yield limits in files, tables, JSON and pages."""

import json
from dataclasses import replace

import numpy as np
import pytest

from geoident.io.result.file import read_result, write_result
from geoident.model.yielding import Activity, Certificate
from geoident.report.page.page import report_page
from geoident.report.text.json import dumps, result_object
from geoident.report.text.result import result_text


def proof(names, **changes):
    """Two planes, one of them never reached, in two stages."""
    activity = Activity(
        planes=("rock: plane 1", "rock: plane 2"),
        stages=("heading", "bench"),
        points=np.array([[3, 17], [0, 0]]),
        biactive=np.array([[0, 2], [0, 0]]),
        distances=np.array([5.2e6, 9.0e6]),
        reached=np.array([5.2e6, 4.1e6]),
        slopes=np.eye(2, len(names)),
    )
    given = {
        "kind": "stationary on the active pieces",
        "gradient": 2e-7,
        "activity": activity,
        "lower_bounds": {names[1]: 4.1e6},
        "remarks": ("The answer lies at a kink.",),
    }
    return Certificate(**{**given, **changes})


@pytest.fixture
def result(result_maker):
    made = result_maker()
    return replace(made, certificate=proof(made.parameters.names))


def test_a_file_without_certificate_has_none(result_maker, tmp_path):
    path = tmp_path / "case.fit.h5"
    write_result(result_maker(), path, overwrite=False)
    assert read_result(path).certificate is None


def test_people_read_planes_stage_by_stage_and_what_is_known_from_below(result):
    text = " ".join(result_text(result).split())
    assert "Stationary on the active pieces: the answer lies at a kink" in text
    assert "The answer lies at a kink." in text
    assert "rock: plane 1 5.2 3 17 2" in text
    assert "rock: plane 2 - 0 0 0 never reached: k >= 4.1 MPa" in text
    assert "9" not in text.split("rock: plane 2")[1].split("MPa")[0]


def test_a_bound_that_was_proven_is_said_with_its_gap(result):
    found = replace(result.certificate, kind="global", bound=3.5, gap=0.02)
    text = " ".join(result_text(replace(result, certificate=found)).split())
    assert "Proven: no misfit is below 3.5 (gap 2 %)." in text


def test_programs_get_no_number_for_a_plane_that_is_never_reached(result):
    found = json.loads(dumps(result_object(result, case="c", output="o")))["certificate"]
    first, second = found["planes"]
    assert first["distance"] == 5.2e6
    assert first["points"] == {"heading": 3, "bench": 17}
    assert second["distance"] is None
    assert second["reached"] == 4.1e6
    assert found["bound"] is None
    assert list(found["at_least"].values()) == [4.1e6]


@pytest.mark.usefixtures("plain_pictures")
def test_the_page_shows_the_planes(result):
    page = report_page([("case", result)])
    assert "Yield planes" in page
    assert "never reached: k &gt;= 4.1 MPa" in page

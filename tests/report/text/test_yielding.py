"""The certificate in words, against its numbers in SI; see also the files it is kept in."""

from dataclasses import replace

import numpy as np
import pytest

from geoident.model.yielding import Activity, Certificate
from geoident.report.text.parameters import parameters_text
from geoident.report.text.yielding import certificate_sentences, certificate_text, plane_table
from tests.support.results import parameters

ACTIVITY = Activity(
    planes=("rock: shear", "rock: tension", "fault: shear", "lining: shear"),
    stages=("heading", "bench"),
    points=np.array([[3, 17], [0, 0], [0, 0], [0, 0]]),
    biactive=np.array([[1, 2], [0, 0], [0, 1], [0, 0]]),
    distances=np.array([5.2e6, 9e6, 1.25e6, 4e6]),
    reached=np.array([5.2e6, 4.1e6, 1.25e6, -np.inf]),
    slopes=np.zeros((4, 3)),
)
PROOF = Certificate("strongly stationary", 2.34e-7, ACTIVITY)


def test_planes_have_their_points_stage_by_stage_and_k_in_megapascals():
    header = ("plane", "k (MPa)", "heading", "bench", "at a kink", "")
    assert plane_table(PROOF).header == header
    shear, tension, fault, lining = (list(row) for row in plane_table(PROOF).rows)
    assert shear == ["rock: shear", "5.2", "3", "17", "3", ""]
    assert fault == ["fault: shear", "1.25", "0", "0", "1", ""]  # reached at a kink only
    assert tension == ["rock: tension", "-", "0", "0", "0", "never reached: k >= 4.1 MPa"]
    assert lining[-1] == "no strain point has this material"
    below = replace(ACTIVITY, reached=np.array([5.2e6, -1e5, 1.25e6, 0.0]))
    rows = plane_table(replace(PROOF, activity=below)).rows
    assert [row[-1] for row in rows] == ["", "never reached", "", "never reached"]


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("strongly stationary", "Strongly stationary: the derivatives of the misfit are zero"),
        ("stationary on the active pieces", "pieces: the answer lies at a kink of the response"),
        ("not stationary", "Not stationary: a small change may improve the answer"),
        ("global", "Global: proven: no answer within the bounds is better"),
    ],
)
def test_the_kind_of_answer_is_said_with_its_gradient(kind, words):
    (said,) = certificate_sentences(replace(PROOF, kind=kind))
    assert words in said
    assert said.endswith("(gradient 2.3e-07).")


def test_a_proven_bound_has_its_gap_in_percent():
    said = certificate_sentences(replace(PROOF, bound=3.5, gap=0.0234, remarks=("So far.",)))
    assert said[1:] == ["Proven: no misfit is below 3.5 (gap 2.3 %).", "So far."]
    assert len(certificate_sentences(replace(PROOF, bound=3.5))) == 1
    assert certificate_text(None) == ""


def test_a_strength_that_nothing_reaches_has_a_bound_from_below_in_its_unit():
    known = replace(PROOF, lower_bounds={"sigma_v": 4.1e6, "K0": 0.7})
    lines = {line.split()[0]: line for line in parameters_text(parameters(), known).splitlines()}
    assert "at least 4.1 MPa, prior 8 +- 0.8" in lines["sigma_v"]
    assert "at least 0.7, at upper bound" in lines["K0"]
    assert "at least" not in lines["E_rock"]

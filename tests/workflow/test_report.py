"""What is not known is said in words, or is null; never a number."""

import json

import numpy as np
import pytest

from geoident.model.parameter import Prior
from geoident.model.results.bands import Prediction
from geoident.model.results.costs import Counts
from geoident.model.results.findings import Finding
from geoident.model.results.result import ParameterTable, Provenance, Result
from geoident.report.text.json import dumps, result_object
from geoident.report.text.result import result_text
from tests.support.results import wide_gauges


@pytest.fixture
def result():
    nan, one = np.array([np.nan]), np.array([[1e-3]])
    parameters = ParameterTable(
        names=("E",),
        values=np.array([3e9]),
        sd=nan,
        lower95=nan,
        upper95=nan,
        lower=np.array([1e9]),
        upper=np.array([3e9]),
        start=np.array([2e9]),
        at_bound=np.array([True]),
        determined=np.array([False]),
        priors=(Prior(2e9, 1e9),),
        units=("GPa",),
        dimensions=("pressure",),
        covariance=nan[:, None],
        correlation=nan[:, None],
    )
    gauges = wide_gauges(
        channels=("CV",),
        stages=("bench",),
        measured=np.array([[np.nan]]),
        computed=one,
        sd=np.array([[np.nan]]),
        used=np.array([[False]]),
        bad=np.array([[False]]),
        first=np.zeros((1, 2)),
        second=np.ones((1, 2)),
    )
    infinite = np.array([[np.inf]])
    return Result(
        kind="fit",
        status="not-determined",
        exit_code=4,
        method="gauss-newton",
        reason="No step helps.",
        objective=1.0,
        findings=(Finding("not-determined", "E", "E is not determined."),),
        case_text="",
        case_resolved="",
        provenance=Provenance("fit", {}, 0, "case.yaml", "", "", "", "", ""),
        parameters=parameters,
        gauges=gauges,
        counts=Counts(),
        prediction=Prediction(one, infinite, -infinite, infinite),
    )


def test_text_says_that_a_parameter_and_a_prediction_are_not_determined(result):
    lines = result_text(result).splitlines()
    (parameter,) = [line for line in lines if line.startswith("E  ")]
    assert parameter.split()[1:4] == ["not", "determined", "GPa"]
    assert "at upper bound, prior 2 +- 1" in parameter
    (prediction,) = [line for line in lines if line.startswith("CV")]
    assert prediction.endswith("not determined")
    assert "1.00" not in prediction


def test_json_has_null(result):
    found = json.loads(dumps(result_object(result, case="case.yaml", output="x.h5")))
    assert found["parameters"]["E"]["value"] is None
    assert found["parameters"]["E"]["at_bound"] is True
    assert found["predictions"][0]["mean"] is None
    assert found["predictions"][0]["sd"] is None
    assert found["gauges"] == []  # nothing was read, and what is predicted is not determined

"""What a certificate changes in the table of parameters and says of them."""

from __future__ import annotations

import numpy as np

from geoident.model.parameter import Parameter
from geoident.model.yielding import Activity, Certificate
from geoident.workflow.estimating.diagnosis import bare_parameter_table, bound_findings, opened

PARAMETERS = (
    Parameter("c", 1e6, 0.05e6, 5e6, dimension="pressure", unit="MPa"),
    Parameter("k", 1e6, 0.05e6, 5e6, dimension="pressure", unit="MPa"),
)
NOTHING = Activity(
    (), (), np.zeros((0, 0), int), np.zeros((0, 0), int), np.empty(0), np.empty(0), np.empty((0, 2))
)


def _certificate(**changes):
    return Certificate("strongly stationary", 0.0, NOTHING, **changes)


def test_an_interval_that_nothing_closes_ends_on_the_bound():
    table = bare_parameter_table(PARAMETERS, np.array([1e6, 2e6]))
    changed = opened(table, _certificate(open_above=("k",)))
    assert changed.upper95[1] == 5e6
    assert np.isnan(changed.upper95[0]) == np.isnan(table.upper95[0])
    assert opened(table, _certificate()) is table


def test_a_bound_from_below_is_told_only_where_it_tells_something():
    said = " ".join(
        one.sentence
        for one in bound_findings(_certificate(lower_bounds={"c": 2.5e6, "k": -0.8e6}), PARAMETERS)
    )
    assert "c is at least 2.5 MPa, the other parameters being as found" in said
    assert "k is at least" not in said
    assert "yield planes of k, wherever it is within its bounds" in said
    assert "as long as c, k keeps" in said

"""Parameters as people read them, against their SI values and the units of the case."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import lognorm, norm

from geoident.model.parameter import Parameter, Prior
from geoident.model.results.costs import Counts
from geoident.model.results.result import Grid, Iteration
from geoident.report.text.parameters import (
    compared_parameters,
    grid_text,
    iteration_text,
    parameter_table,
    parameters_text,
    prior_interval,
)
from geoident.report.text.posterior import cost_sentence
from tests.support.results import example_result, parameters, small_result

TABLE = parameters()


def cells(text, name):
    """The words of the line of a parameter."""
    (line,) = [line for line in text.splitlines() if line.startswith(name)]
    return line.split()


def test_value_and_interval_stand_in_the_unit_of_the_case():
    assert parameters_text(TABLE).split()[:5] == ["name", "value", "95", "%", "interval"]
    row = cells(parameters_text(TABLE), "E_rock")
    shown = [float(row[k]) * 1e9 for k in (1, 2, 4)]
    step = 0.5 * 10**8  # half of the second digit of the width, 1.5 GPa
    assert shown == pytest.approx([TABLE.values[0], TABLE.lower95[0], TABLE.upper95[0]], abs=step)
    assert row[3:6] == ["..", "13.1", "GPa"]


def test_an_unknown_unit_is_shown_in_si():
    odd = replace(TABLE, units=("furlong", "MPa", ""))
    row = cells(parameters_text(odd), "E_rock")
    assert float(row[1]) == pytest.approx(1.23e10)
    assert row[5] == "Pa"


def test_what_is_not_determined_has_words_for_a_number():
    alone = replace(TABLE, priors=(None, None, None))
    assert "sigma_v  as its prior" in parameters_text(TABLE)
    assert "prior 8 +- 0.8, computed with 6.54" in parameters_text(TABLE)
    assert "sigma_v  not determined" in parameters_text(alone)
    assert "6.54" not in parameters_text(alone)


@pytest.mark.parametrize(("value", "side"), [(0.3, "lower"), (3.0, "upper")])
def test_the_bound_on_which_a_parameter_lies_is_named(value, side):
    values = TABLE.values.copy()
    values[2] = value
    table = replace(TABLE, values=values)
    assert cells(parameters_text(table), "K0")[-3:] == ["at", side, "bound"]
    assert parameter_table(table).rows[2][-1] == f"at its {side} bound"
    assert "bound" not in parameters_text(replace(table, at_bound=np.zeros(3, dtype=bool)))


def test_the_table_of_the_page_has_start_bounds_and_prior_in_the_unit():
    header = ["parameter", "unit", "value", "95 % interval", "prior", "start", "bounds", "remark"]
    shown = parameter_table(TABLE).filled  # nothing describes a parameter
    assert shown.header == header
    rock, stress, ratio = shown.rows
    assert rock[:2] == ["E_rock", "GPa"]
    assert [float(rock[2]), float(rock[5])] == pytest.approx([12.3, 20.0])
    assert [float(end) for end in rock[3].split(" to ")] == pytest.approx([11.6, 13.1])
    assert [float(end) for end in rock[6].split(" to ")] == pytest.approx([2.0, 80.0])
    assert rock[4] == "14 ± 2.5 (lognormal)"
    assert stress[2:5] == ["as its prior", "-", "8 ± 0.8"]
    assert ratio[1] == "-"
    assert ratio[4] == "-"


def test_intervals_of_priors_hold_95_percent():
    low, high = prior_interval(Prior(8e6, 1e6))
    assert norm(8e6, 1e6).cdf([low, high]) == pytest.approx([0.025, 0.975], rel=1e-9)
    low, high = prior_interval(Prior(8e6, 1e6, "lognormal"))
    median = lognorm(s=1e6 / 8e6, scale=8e6)  # sd of the logarithm: sd over median
    assert median.cdf([low, high]) == pytest.approx([0.025, 0.975], rel=1e-9)
    assert prior_interval(None) is None


def test_several_results_share_the_unit_of_the_first():
    other = replace(TABLE, names=("E_rock", "sigma_v", "nu"), values=2 * TABLE.values)
    results = [("a", example_result()), ("b", replace(example_result(), parameters=other))]
    rows = {row[0]: row[1:] for row in compared_parameters(results).rows}
    assert list(rows) == ["E_rock", "sigma_v", "K0", "nu"]
    assert compared_parameters(results).header == ("parameter", "unit", "a", "b")
    assert rows["E_rock"] == ["GPa", "12.3 (11.6 to 13.1)", "24.7 (11.6 to 13.1)"]
    assert rows["K0"][2] == rows["nu"][1] == "-"


def test_a_step_of_a_search_is_one_line():
    step = Iteration("simplex", 7, 12.3456789, np.array([2.5e9, 0.75]), 0.1, Counts(), "accepted")
    given = [
        Parameter("E", 1e9, 1e8, 1e10, dimension="pressure", unit="GPa"),
        Parameter("K0", 1.0, 0.1, 3.0),
    ]
    assert iteration_text(step, given) == "simplex 7: accepted, misfit 12.3457 (E 2.5 GPa, K0 0.75)"


def test_a_scan_over_one_parameter_is_a_table():
    grid = Grid(("E_rock",), (np.array([1e10, 2.5e10]),), np.array([7.25, np.inf]))
    lines = [line.split() for line in grid_text(small_result(grid=grid)).splitlines()]
    assert lines == [["E_rock", "(GPa)", "misfit"], ["10", "7.25"], ["25", "no", "solution"]]


def test_a_scan_over_two_says_its_extent():
    lines = grid_text(small_result()).splitlines()
    assert lines[1].split() == ["E_rock", "10", "20", "GPa", "2"]
    assert lines[2].split() == ["K0", "0.5", "2", "3"]
    assert lines[3] == "Misfit from 2 to 9 over 6 points; the values are in the result file."
    nowhere = replace(small_result().grid, objective=np.full((2, 3), np.inf))
    assert "no solution at any point" in grid_text(small_result(grid=nowhere))


def drawn(chains, length, **changes):
    """What is said of draws, of which only their numbers count."""
    given = {"sampler": "importance", "pareto_k": np.nan, "largest_r_hat": np.nan,
             "acceptance": 0.3149, "evaluations": 4321, "least_effective": 812.6}  # fmt: skip
    log_density = np.zeros((chains, length))
    return SimpleNamespace(
        log_density=log_density, n_draws=log_density.size, **{**given, **changes}
    )


def test_how_draws_were_made_and_what_they_have_cost():
    assert cost_sentence(drawn(1, 1000, pareto_k=0.347)) == (
        "1000 draws by importance sampling, worth 813 independent ones; Pareto k 0.35 (reliable "
        "up to 0.7); 4321 evaluations of the model, 31 % of the evaluations count."
    )
    assert cost_sentence(drawn(4, 250, sampler="ensemble", largest_r_hat=1.00649)) == (
        "1000 draws in 4 chains of 250 by ensemble sampling, worth 813 independent ones; largest "
        "R-hat 1.006 (reliable up to 1.01); 4321 evaluations of the model, 31 % of the steps "
        "were accepted."
    )

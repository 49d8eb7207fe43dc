"""Programs that iterate, mesh anew or print few digits: the search does not chase their noise."""

import numpy as np
import pytest
from support.external import SCRIPT, ArrayRuns, write_case

from geoident.forward.external.program import ProgramModel
from geoident.identify.least_squares.gauss_newton import gauss_newton
from geoident.identify.problem.problem import Problem
from geoident.io.case.file import read_case
from geoident.model.methods import GaussNewtonOptions

FORMULA: dict = {}
exec(SCRIPT, FORMULA)
RUNS = 10 + 5 * 2
"""What the manual promises for two parameters."""
ACCURACY = 2e-5


class Noisy(ArrayRuns):
    """Kirsch's formula with noise that is the same wherever it is asked again.

    Args:
        size: standard deviation of the noise, in accuracies of the gauges.
        seed: of the noise.
    """

    def __init__(self, size, seed):
        super().__init__(None, 2, 6)
        self.provided = np.ones((2, 3), bool)
        self._size, self._rng, self._known = size, np.random.default_rng(seed), {}

    def each(self, points, check):
        return (self._run(p) for p in points)

    def _run(self, p):
        key = p.tobytes()
        if key not in self._known:
            self.n_runs += 1
            found = FORMULA["readings"]({"E": p[0], "K0": p[1]})
            v = np.array([list(found[gauge].values()) for gauge in "HVD"]).T
            self._known[key] = v + self._size * ACCURACY * self._rng.standard_normal(v.shape)
        return self._known[key]


def problem_of(case, size, seed):
    model = ProgramModel(case, Noisy(size, seed))
    pairs = [(r.channel, r.stage) for r in case.readings]
    measured = np.array([r.value for r in case.readings])
    sd = np.full(len(pairs), ACCURACY)
    return model, Problem(model.response(pairs), measured, sd, case.parameters)


def found(case, size, seed=0):
    """Where the search ends, what it took, and how it says it ended."""
    model, problem = problem_of(case, size, seed)
    outcome = gauss_newton(problem, GaussNewtonOptions(), lambda iteration: None)
    return outcome, model.runs.n_runs, problem.response.evaluate(outcome.values)[1] / ACCURACY


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return read_case(str(write_case(tmp_path_factory.mktemp("noisy")))).case


@pytest.mark.parametrize("size", [1e-3, 0.05, 0.3])
def test_noisy_runs_cost_no_more_than_smooth_ones_and_end_where_those_do(case, size):
    smooth, runs, J = found(case, 0.0)
    assert runs <= RUNS
    off, took = [], []
    for seed in range(8):
        outcome, runs, _ = found(case, size, seed)
        assert outcome.status == "converged", outcome.reason
        took.append(runs)
        off.append(float(np.linalg.norm(J @ (outcome.values - smooth.values))))
    assert np.median(took) <= RUNS
    assert max(took) <= 2 * RUNS, took
    # a fit to six readings with this noise more is off by sqrt(2) of it, in standard deviations
    assert np.sqrt(np.mean(np.square(off))) <= 2.5 * size + 0.01


def test_noise_of_a_change_is_that_of_both_runs(case, tmp_path):
    text = (
        write_case(tmp_path)
        .read_text()
        .replace("V: {kind: reading,", "V: {kind: reading, zero: half,")
    )
    (tmp_path / "case.yaml").write_text(text)
    zeroed = read_case(str(tmp_path / "case.yaml")).case
    model, problem = problem_of(zeroed, 0.1, 1)
    response = model.response([("H", "open"), ("V", "open")])
    assert response.noise.tolist() == [0.0, 0.0]  # before anything was run
    response.evaluate(problem.start)
    half, open_ = model.differences.noise.reshape(2, 3)
    np.testing.assert_allclose(response.noise, [open_[0], np.hypot(half[1], open_[1])])


def test_derivatives_are_not_brought_up_to_date_by_noise(case):
    model, problem = problem_of(case, 0.1, 2)
    start = problem.start
    first = model.differences.linear(start)
    near = model.differences.linear(start * np.array([1.0 + 1e-5, 1.0]))
    np.testing.assert_array_equal(near.dv_dp, first.dv_dp)


def test_derivatives_are_sharpened_once_at_a_point(case):
    """By central differences; a search that was told again that they are new would not end.

    All motions are inversely proportional to E.
    """
    model, problem = problem_of(case, 0.0, 0)
    response, start = problem.response, problem.start
    rough, runs = response.evaluate(start)[1], model.runs.n_runs
    assert response.sharpen(start)
    assert model.runs.n_runs == runs + 2 * 2
    assert not response.sharpen(start)
    sharp = response.evaluate(start)[1]
    by_E = -problem.response.readings(start) / start[0]
    np.testing.assert_allclose(sharp[:, 0], by_E, rtol=1e-8)
    assert np.abs(rough[:, 0] - by_E).max() > 10.0 * np.abs(sharp[:, 0] - by_E).max()
    assert model.runs.n_runs == runs + 2 * 2
    assert response.sharpen(start * np.array([1.1, 1.0]))

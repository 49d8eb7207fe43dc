"""The samplers by themselves: proposals, budgets, diagnostics, and what they begin with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal, multivariate_t, truncnorm
from support.posteriors import problem_of_ridge

from geoident.errors import CollapseError, ModelError, UsageError
from geoident.identify.posterior.chains import crank_nicolson, ensemble
from geoident.identify.posterior.density import PosteriorDensity
from geoident.identify.posterior.draws import (
    OUT_OF_EVALUATIONS,
    Draws,
    SamplingRequest,
    Stopped,
    diagnose_chains,
    library,
)
from geoident.identify.posterior.importance import Proposal, WeightedDraws
from geoident.identify.posterior.sampling import sample_posterior
from geoident.identify.problem.problem import Problem
from geoident.model.parameter import Parameter

BOX = np.array([-40.0, -40.0]), np.array([40.0, 40.0])
ROOTS = np.array([[[1.0, 0.0], [0.5, 2.0]], [[0.3, 0.0], [-0.2, 0.4]]])


def proposal(degrees=np.inf, uniform=0.0, box=BOX):
    weights = (1.0 - uniform) * np.array([0.7, 0.3])
    return Proposal(weights, np.array([[1.0, 2.0], [-3.0, 0.5]]), ROOTS, degrees, *box, uniform)


def quiet(progress):
    """A watch that never stops."""


# Proposals


@pytest.mark.parametrize("degrees", [np.inf, 5.0])
@pytest.mark.parametrize("uniform", [0.0, 0.1])
def test_the_density_of_a_proposal_is_that_of_scipy(degrees, uniform):
    one = proposal(degrees, uniform)
    x = np.random.default_rng(0).uniform(-5.0, 5.0, (30, 2))
    laws = [
        multivariate_normal(c, root @ root.T)
        if np.isinf(degrees)
        else multivariate_t(c, root @ root.T, df=degrees)
        for c, root in zip(one.centres, one.roots, strict=True)
    ]
    expected = one.weights @ np.array([law.pdf(x) for law in laws]) + uniform / 80.0**2
    np.testing.assert_allclose(np.exp(one.logarithms(x)), expected, rtol=1e-10)
    assert one.logarithms(x[:1]).shape == (1,)


@pytest.mark.parametrize("degrees", [np.inf, 5.0])
def test_draws_of_a_proposal_are_as_its_density_says(degrees):
    """Of a box that cuts it, the share of draws in each of 9 cells; by the density on a grid."""
    low, high = np.array([-4.0, -2.0]), np.array([2.0, 4.0])
    one = proposal(degrees, 0.1, (low, high))
    x = one.draw(np.random.default_rng(1), 40_000)
    assert x.shape == (40_000, 2)
    steps = (np.arange(120) + 0.5) / 120
    fine = np.array([low + (high - low) * (i, j) for i in steps for j in steps])
    weights = np.exp(one.logarithms(fine))

    def cells(points, weight):
        at = np.minimum(((points - low) / (high - low) * 3).astype(int), 2)
        return np.bincount(at[:, 0] * 3 + at[:, 1], weight, 9)

    expected = cells(fine, weights / weights.sum())
    np.testing.assert_allclose(cells(x, np.full(len(x), 1 / len(x))), expected, atol=0.01)


def test_a_proposal_outside_its_bounds_cannot_be_drawn():
    far = replace(proposal(), lower=np.array([100.0, 100.0]), upper=np.array([101.0, 101.0]))
    with pytest.raises(ModelError) as caught:
        far.draw(np.random.default_rng(0), 3)
    assert caught.value.message == (
        "The posterior cannot be sampled: its approximation lies outside the bounds."
    )
    assert caught.value.hint == "Look at the fit: is it converged, and are its bounds meant?"


def test_a_minimum_without_a_solution_is_left_out_and_the_fit_is_not():
    class Half:
        def admissible(self, p):
            return None

        def evaluate(self, p):
            if p[0] > 2.0:
                raise CollapseError("the ground collapses", stage="s", fraction=0.5)
            return p, np.eye(1)

    q = (Parameter("a", 1.0, -50.0, 50.0),)
    density = PosteriorDensity(Problem(Half(), np.zeros(1), np.ones(1), q))
    found = Proposal.laplace(density, [np.zeros(1), np.array([3.0])])
    assert len(found.weights) == 1
    with pytest.raises(ModelError, match="collapses"):
        Proposal.laplace(density, [np.array([3.0]), np.zeros(1)])


def test_resampling_takes_every_draw_as_often_as_its_weight_says():
    """Systematic: within one of N w, without an order."""
    one = proposal()
    x = one.draw(np.random.default_rng(8), 50)
    found = WeightedDraws(one, x, -np.sum(x**2, axis=1) / 20.0, np.zeros(50))
    draws = found.resampled(1000, np.random.default_rng(9), name="importance", stopped="")
    assert draws.x.shape == (1, 1000, 2)
    taken = np.array([np.flatnonzero((x == row).all(axis=1))[0] for row in draws.x[0]])
    counts = np.bincount(taken, minlength=50)
    assert np.all(np.abs(counts - 1000 * found.weights) < 1.0)
    np.testing.assert_array_equal(draws.logarithms[0], found.logarithms[taken])
    assert np.abs(np.corrcoef(taken, np.arange(1000))[0, 1]) < 0.1
    assert draws.effective.tolist() == [found.effective] * 2
    assert draws.acceptance == pytest.approx(found.effective / 50)
    few = found.resampled(5, np.random.default_rng(9), name="importance", stopped="")
    assert few.effective.tolist() == [5.0] * 2


# Budgets and stops


class Normal:
    """A density of two independent normal coordinates, and how often it was asked."""

    def __init__(self, most=10**9):
        self.evaluations, self._most = 0, most

    def __len__(self):
        return 2

    def reference(self):
        return np.zeros(2), np.ones(2)

    def logarithms(self, x):
        self.evaluations += len(x)
        if self.evaluations > self._most:
            raise Stopped("enough of it")
        return -0.5 * np.sum(x**2, axis=1)


def wide(size, degrees=5.0):
    return Proposal(np.ones(1), np.zeros((1, 2)), size * np.eye(2)[None], degrees, *BOX)


@pytest.mark.parametrize("run", [ensemble, crank_nicolson])
def test_chains_keep_their_budget_and_pass_on_why_they_stopped(run):
    begin = WeightedDraws.none_of(wide(1.0)).more(Normal(), np.random.default_rng(0), 100)

    def drawn(density, watch, evaluations=10**6):
        request = SamplingRequest(100, 50.0, evaluations)
        return run(density, begin, request, np.random.default_rng(1), watch)

    for most, evaluations in ((50, 10**6), (10**9, 100)):
        with pytest.raises(Stopped):
            drawn(Normal(most), quiet, evaluations)
    assert drawn(Normal(3000), quiet).stopped in {"", "enough of it"}
    reasons = iter([None, None, None, "no time left"])
    density = Normal()
    stopped = drawn(density, lambda progress: next(reasons))
    assert stopped.stopped == "no time left"
    chains, length, _ = stopped.x.shape
    assert length == 20  # the second half of 40 steps
    assert stopped.logarithms.shape == (chains, length)
    np.testing.assert_allclose(stopped.logarithms, -0.5 * np.sum(stopped.x**2, axis=2))
    assert 0.0 < stopped.acceptance <= 1.0
    limited = drawn(density := Normal(), quiet, 2000)
    assert density.evaluations <= 2000 + 10 * chains
    assert limited.stopped in {"", OUT_OF_EVALUATIONS}


@pytest.mark.parametrize("edge", [0.5, -0.5])
def test_chains_outside_come_in_and_stay(edge):
    """A density that ends inside what the proposal covers, in a metric that is not its own."""

    class Cut(Normal):
        def reference(self):
            return np.array([0.3, -0.2]), np.array([1.5, 1.3])

        def logarithms(self, u):
            inside = u[:, 0] <= edge
            return np.where(inside, super().logarithms(u), -np.inf)

    begin = WeightedDraws.none_of(wide(1.0)).more(Normal(), np.random.default_rng(0), 100)
    request = SamplingRequest(2000, 1000.0, 60_000)
    found = crank_nicolson(Cut(), begin, request, np.random.default_rng(2), quiet)
    x = found.x.reshape(-1, 2)
    assert x[:, 0].max() <= edge
    law = truncnorm(-np.inf, edge)
    np.testing.assert_allclose(x.mean(axis=0), [law.mean(), 0.0], atol=0.12)
    np.testing.assert_allclose(x.std(axis=0), [law.std(), 1.0], atol=0.12)


def test_chains_that_had_no_budget_leave_the_weighted_draws():
    """A bent valley in many directions, which no importance sampling serves, and 1500 draws."""

    class Valley:
        def admissible(self, p):
            return None

        def readings(self, p):
            return np.array(
                [*p[:4], 50.0 * np.sin(p[0] * p[1] + p[2] * p[3]), *(40.0 * p[4:] ** 3)]
            )

        def evaluate(self, p):
            steps = [1e-6 * np.eye(8)[i] for i in range(8)]
            slopes = [(self.readings(p + h) - self.readings(p - h)) / 2e-6 for h in steps]
            return self.readings(p), np.stack(slopes, axis=1)

    q = tuple(Parameter(f"p{i}", 0.5, -3.0, 3.0, "linear") for i in range(8))
    problem = Problem(Valley(), np.zeros(9), np.ones(9), q)
    found = sample_posterior(
        PosteriorDensity(problem), [np.full(8, 0.1)], SamplingRequest(60, 900.0, 900),
        rng=np.random.default_rng(0), watch=quiet,
    )  # fmt: skip
    assert found.stopped == OUT_OF_EVALUATIONS
    assert found.sampler in {"importance", "adapted importance"}
    assert found.x.shape == (1, 60, 8)


def test_without_any_solution_there_is_nothing_to_hand_over():
    problem = problem_of_ridge(None)
    density = PosteriorDensity(problem, lambda points: [None] * len(points))
    with pytest.raises(Stopped, match="used up"):
        sample_posterior(
            density, [np.array([10.0, 8.0])], SamplingRequest(60, 900.0, 900),
            rng=np.random.default_rng(0), watch=quiet,
        )  # fmt: skip


# Diagnostics


def draws(effective, *, k=np.nan, r_hat=np.nan, count=10_000):
    size = np.array([np.nan, 9e9, effective])
    x = np.zeros((1, count, 3))
    return Draws("any", x, x[..., 0], size, np.array([np.nan, 0.5, r_hat]), k, 0.5)


@pytest.mark.parametrize(
    ("found", "evaluations", "wanted", "reliable"),
    [
        (draws(400.0, k=0.7), 10_000, 900.0, True),
        (draws(399.0, k=0.7), 10_000, 900.0, False),
        (draws(399.0, k=0.7), 10_000, 399.0, True),
        (draws(398.0, k=0.7), 10_000, 399.0, False),
        (draws(50.0, k=0.7, count=50), 10_000, 900.0, True),
        (draws(49.0, k=0.7, count=50), 10_000, 900.0, False),
        (draws(400.0, k=0.71), 10_000, 900.0, False),
        (draws(400.0, k=0.5), 100, 900.0, True),
        (draws(400.0, k=0.51), 100, 900.0, False),
        (draws(400.0, r_hat=1.01), 100, 900.0, True),
        (draws(400.0, r_hat=1.011), 100, 900.0, False),
    ],
)
def test_draws_are_reliable_by_their_size_and_their_diagnostics(
    found, evaluations, wanted, reliable
):
    """Enough is what is usual, or what was wanted, or as many as there are."""
    assert found.reliable(evaluations, wanted=wanted) is reliable
    assert found.least_effective == found.effective[2]


def test_chains_of_a_group_count_as_one_for_r_hat():
    """Two groups of two, of which one agrees with the other and one does not."""
    rng = np.random.default_rng(0)
    x = rng.normal(size=(4, 300, 2))
    x[1::2, :, 0] += 3.0  # in each group one that stays elsewhere: the groups agree nonetheless
    x[2:, :, 1] += 3.0  # groups that do not agree
    size, r_hat = diagnose_chains(x, groups=2)
    assert r_hat[0] < 1.02
    assert r_hat[1] > 1.5
    assert diagnose_chains(x, groups=4)[1][0] > 1.5
    arviz = library("arviz")
    for i in range(2):
        kinds = [float(arviz.ess(x[:, :, i], method=kind)) for kind in ("bulk", "tail")]
        assert size[i] == pytest.approx(min(kinds))
    # one after the other in time: halves of a group are both halves of its chains
    drift = np.linspace(0.0, 4.0, 300)[None, :, None] + rng.normal(size=(4, 300, 1))
    assert diagnose_chains(drift, groups=2)[1][0] > 1.1
    assert np.isnan(diagnose_chains(np.zeros((4, 10, 1)), groups=2)).all()


def test_a_missing_library_is_told_and_another_error_is_not_hidden(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(UsageError, match=r'sampling needs midsampler: pip install "geoident'):
        library("midsampler")
    (tmp_path / "needs_missing.py").write_text("import zz_missing\n")
    with pytest.raises(ModuleNotFoundError, match="zz_missing"):
        library("needs_missing")

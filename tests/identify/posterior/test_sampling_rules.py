"""Which sampler is taken when, and when draws are trusted: with samplers that are given."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from geoident.identify.posterior import sampling
from geoident.identify.posterior.draws import OUT_OF_EVALUATIONS, Draws, Stopped, Wish
from geoident.identify.posterior.sampling import sample_posterior, trustworthy
from geoident.model.parameter import Parameter

WISH = Wish(6, 400.0, 999)


class Given:
    """Draws of a mixture whose weights are believed down to an efficiency."""

    def __init__(self, mixture, efficiency, weights=(0.5, 0.25, 0.25)):
        self.mixture, self.efficiency = mixture, efficiency
        self.weights = np.array(weights)
        self.x, self.logarithms = np.arange(6.0).reshape(3, 2), np.array([-1.0, -2.0, -3.0])
        self.effective, self.pareto_k = 2.5, 0.3

    def believable(self, least=0.05):
        return self.efficiency >= least


def sampled(monkeypatch, efficiencies, *, n=2, field="", stopped="", weights=(0.5, 0.25, 0.25),
            chains="draws"):  # fmt: skip
    """The draws, and what was asked of the samplers in turn.

    Args:
        monkeypatch: of pytest.
        efficiencies: of the mixtures in turn: Laplace's, then adapted ones.
        n: number of parameters.
        field: of the last of them.
        stopped: by the watch, after the last of the mixtures.
        weights: of their draws.
        chains: ``draws``, or ``none`` of the budget is spent.
    """
    asked = []

    class Sampler:
        def __init__(self, *given):
            asked.append(("sampler", given[2]))
            self.stopped, self.left = "", list(efficiencies)

        def of(self, mixture, name, *, least=0.05):
            asked.append((mixture, name, least))
            found = Given(mixture, self.left.pop(0), weights)
            if not self.left:
                self.stopped = stopped
            return found

        def adapt(self):
            return f"adapted {len(self.left)}"

    def chain(kind):
        def run(density, begin, rng, wish, watch):
            asked.append((kind, begin.mixture))
            x = np.arange(40.0).reshape(2, 10, 2)
            many = Draws(kind, x, x[..., 0], np.ones(2), np.ones(2), np.nan, 0.3)
            return many if chains == "draws" else None

        return run

    monkeypatch.setattr(sampling, "ImportanceSampler", Sampler)
    monkeypatch.setattr(sampling, "laplace", lambda density, minima: f"laplace of {minima}")
    monkeypatch.setattr(sampling, "ensemble", chain("ensemble"))
    monkeypatch.setattr(sampling, "crank_nicolson", chain("crank_nicolson"))
    parameters = [Parameter(f"p{i}", 1.0, 0.0, 2.0) for i in range(n)]
    parameters[-1] = replace(parameters[-1], field=field)

    class Density:
        problem = SimpleNamespace(parameters=tuple(parameters))

        def __len__(self):
            return n

    found = sample_posterior(
        Density(), "minima", WISH, rng=np.random.default_rng(0), watch=lambda told: None
    )
    assert asked[0] == ("sampler", WISH)
    return found, asked[1:]


FIRST = ("laplace of minima", "importance", 0.2)


def test_laplaces_approximation_is_enough_from_an_efficiency_of_a_fifth_on(monkeypatch):
    found, asked = sampled(monkeypatch, [0.2])
    assert asked == [FIRST]
    assert (found.sampler, found.stopped, found.x.shape) == ("importance", "", (1, 6, 2))


@pytest.mark.parametrize("efficiencies", [[0.19, 0.05], [0.1, 0.04, 0.05], [0.0, 0.0, 0.0, 0.3]])
def test_else_a_mixture_is_adapted_up_to_three_times(monkeypatch, efficiencies):
    found, asked = sampled(monkeypatch, efficiencies)
    left = len(efficiencies) - 1
    more = [(f"adapted {left - k}", "adapted importance", 0.05) for k in range(left)]
    assert asked == [FIRST, *more]
    assert found.sampler == "adapted importance"


def test_where_no_mixture_is_believed_there_is_an_ensemble(monkeypatch):
    found, asked = sampled(monkeypatch, [0.0, 0.0, 0.0, 0.049])
    assert len(asked) == 5
    assert asked[-1] == ("ensemble", "adapted 1")
    assert found.x[:, :, 0].tolist() == [[0.0, 8.0, 18.0], [20.0, 28.0, 38.0]]  # six, thinned


@pytest.mark.parametrize(("n", "field"), [(13, ""), (2, "E")])
def test_of_many_parameters_or_fields_nothing_is_adapted(monkeypatch, n, field):
    laplace = ("laplace of minima", "importance", 0.05)
    found, asked = sampled(monkeypatch, [0.05], n=n, field=field)
    assert (found.sampler, asked) == ("importance", [laplace])
    found, asked = sampled(monkeypatch, [0.04], n=n, field=field)
    assert asked == [laplace, ("crank_nicolson", "laplace of minima")]
    assert found.sampler == "crank_nicolson"


def test_twelve_parameters_are_not_many(monkeypatch):
    _, asked = sampled(monkeypatch, [0.04, 0.3], n=12)
    assert asked[1][1] == "adapted importance"


def test_what_was_stopped_gives_what_there_is(monkeypatch):
    found, asked = sampled(monkeypatch, [0.01], stopped="no time left")
    assert asked == [FIRST]
    assert (found.sampler, found.stopped) == ("importance", "no time left")
    found, asked = sampled(monkeypatch, [0.01, 0.01], stopped="no time left")
    assert len(asked) == 2
    assert (found.sampler, found.stopped) == ("adapted importance", "no time left")
    with pytest.raises(Stopped, match="no time left") as caught:
        sampled(monkeypatch, [0.01], stopped="no time left", weights=(0.0, 0.0, 0.0))
    assert caught.value.reason == "no time left"


def test_chains_that_had_no_budget_leave_the_weighted_draws(monkeypatch):
    found, _ = sampled(monkeypatch, [0.0] * 4, chains="none")
    assert (found.sampler, found.stopped) == ("importance", OUT_OF_EVALUATIONS)
    assert found.x.shape == (1, 6, 2)


def draws(effective, *, k=np.nan, r_hat=np.nan, count=10_000):
    size = np.array([np.nan, 9e9, effective])
    x = np.zeros((1, count, 3))
    return Draws("any", x, x[..., 0], size, np.array([np.nan, 0.5, r_hat]), k, 0.5)


@pytest.mark.parametrize(
    ("found", "evaluations", "wanted", "trusted"),
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
def test_draws_are_trusted_by_their_size_and_their_diagnostics(found, evaluations, wanted, trusted):
    """Enough is what is usual, or what was wanted, or as many as there are."""
    assert trustworthy(found, evaluations, wanted=wanted) is trusted
    assert found.least_effective == found.effective[2]


def test_draws_without_any_number_have_none():
    empty = replace(draws(1.0), effective=np.full(3, np.nan), r_hat=np.full(3, np.nan))
    assert empty.least_effective == 0.0
    assert np.isnan(empty.largest_r_hat)
    assert draws(1.0, r_hat=1.7).largest_r_hat == 1.7

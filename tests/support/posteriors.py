"""Cheap models with posteriors that quadrature on a grid can integrate."""

from __future__ import annotations

import numpy as np
from scipy.stats import chisquare

from geoident.identify.posterior.draws import SamplingRequest
from geoident.identify.posterior.sampling import sample_posterior
from geoident.identify.problem.methods import identify
from geoident.identify.problem.problem import Problem
from geoident.model.methods import GaussNewtonOptions
from geoident.model.parameter import Parameter, Prior
from geoident.model.results.result import Counts


class Ridge:
    """Readings of an elastic opening: proportional to stress over modulus."""

    names = ("E", "sigma_v")
    counts = Counts()
    sizes = np.array([1.0, 0.5, 0.2, 0.9])

    def admissible(self, p):
        return None

    def readings(self, p):
        return self.sizes * p[1] / p[0]

    def evaluate(self, p):
        v = self.readings(p)
        return v, np.stack([-v / p[0], v / p[1]], axis=1)


def problem_of_ridge(prior: Prior | None) -> Problem:
    """Readings of E = 10, sigma_v = 8, each off by its standard deviation."""
    model = Ridge()
    v = model.readings(np.array([10.0, 8.0]))
    sd = np.full(4, 0.03 * v.max())
    return Problem(
        model,
        v + sd * np.array([1.0, -1.0, 1.0, -1.0]),
        sd,
        (
            Parameter("E", 10.0, 1.0, 80.0, "log"),
            Parameter("sigma_v", 8.0, 2.0, 20.0, "linear", prior),
        ),
    )


def grid_quantiles(problem: Problem, n: int = 300) -> list[tuple[np.ndarray, np.ndarray]]:
    """Values of each of the two parameters of a ridge and the probability below, by summing.

    The density is written as Bayes says it, of normal errors and of the density of the prior in its
    own variable. Cells are even in ln p; a density that is one in p is multiplied with p.
    """
    axes = [
        np.exp(np.linspace(np.log(q.lower), np.log(q.upper), 2 * n + 1)[1::2])
        for q in problem.parameters
    ]
    E, stress = np.meshgrid(*axes, indexing="ij")
    v = Ridge.sizes[:, None, None] * stress / E
    off = (v - problem.measured[:, None, None]) / problem.sd[:, None, None]
    logarithm = -0.5 * (off**2).sum(axis=0)
    for q, values in zip(problem.parameters, (E, stress), strict=True):
        if q.prior is None:
            in_p = q.scale == "linear"
        elif q.prior.kind == "normal":
            logarithm -= 0.5 * ((values - q.prior.mean) / q.prior.sd) ** 2
            in_p = True
        else:  # its logarithm is normal, about that of the mean
            far = np.log(values / q.prior.mean) / (q.prior.sd / q.prior.mean)
            logarithm -= 0.5 * far**2
            in_p = False
        if in_p:
            logarithm += np.log(values)
    density = np.exp(logarithm)
    found = []
    for of, values in enumerate(axes):
        alone = density.sum(axis=1 - of)
        found.append((values, (np.cumsum(alone) - 0.5 * alone) / alone.sum()))
    return found


class Opening:
    """Radial displacements of the wall of a circular opening in elastic rock (Kirsch), in mm.

    Under the vertical stress s and the horizontal one K s, at the angles a from the horizontal,
    u = (1 + nu) s r / E ((1 + K)/2 + (3 - 4 nu)(K - 1)/2 cos 2a), inwards, plane strain.
    """

    names = ("E", "sigma_v", "K")
    counts = Counts()
    radius, nu = 2.5, 0.25
    angles = np.deg2rad([0.0, 30.0, 60.0, 90.0])

    def admissible(self, p):
        return None

    def readings(self, p):
        return self.evaluate(p)[0]

    def evaluate(self, p):
        E, s, K = p
        bend = (3.0 - 4.0 * self.nu) * np.cos(2.0 * self.angles)
        form = 0.5 * ((1.0 + K) + bend * (K - 1.0))
        v = 1e3 * (1.0 + self.nu) * self.radius / E * s * form
        by_K = 1e3 * (1.0 + self.nu) * self.radius / E * s * 0.5 * (1.0 + bend)
        return v, np.stack([-v / E, v / s, by_K], axis=1)


OPENING = (
    Parameter("E", 5e3, 1e3, 30e3, "log", Prior(6e3, 5e3)),
    Parameter("sigma_v", 8.0, 2.0, 20.0, "linear", Prior(8.0, 4.0, "lognormal")),
    Parameter("K", 1.0, 0.4, 2.5, "linear"),
)
"""A modulus in MPa with a normal prior although its scale is log, a stress with a lognormal one."""


def truth_of(parameters, rng: np.random.Generator) -> np.ndarray:
    """Parameters from their prior, cut at the bounds; flat in p where there is none (linear)."""
    return np.array([_one(q, rng) for q in parameters])


def _one(q: Parameter, rng: np.random.Generator) -> float:
    while True:
        if q.prior is None:
            ends = np.log([q.lower, q.upper]) if q.scale == "log" else np.array([q.lower, q.upper])
            drawn = rng.uniform(*ends)
            p = np.exp(drawn) if q.scale == "log" else drawn
        elif q.prior.kind == "normal":
            p = rng.normal(q.prior.mean, q.prior.sd)
        else:
            p = q.prior.mean * np.exp(rng.normal(0.0, q.prior.sd / q.prior.mean))
        if q.lower < p < q.upper:
            return float(p)


def ranks_of_truth(runs: int, *, density_of, sampler=sample_posterior, seed: int = 0) -> np.ndarray:
    """Simulation-based calibration: rank of the truth among 99 draws, (runs, n), 0 to 99.

    Args:
        runs: how many.
        density_of: from a problem to the density that is sampled.
        sampler: that is judged.
        seed: of truths, errors of readings and draws.
    """
    found = []
    for run in range(runs):
        rng = np.random.default_rng([seed, run])
        model = Opening()
        truth = truth_of(OPENING, rng)
        v = model.readings(truth)
        sd = np.full(len(v), 0.5)
        problem = Problem(model, v + sd * rng.normal(size=len(v)), sd, OPENING)
        fit = identify(problem, (GaussNewtonOptions(),), lambda iteration: None)
        density = density_of(problem)
        wish = SamplingRequest(99, 400.0, 20_000)
        drawn = sampler(density, [fit.values], wish, rng=rng, watch=lambda progress: None)
        x = drawn.x.reshape(-1, drawn.x.shape[2])
        p = density.natural(x)
        if len(p) > 99:
            p = p[rng.choice(len(p), 99, replace=False)]
        found.append(np.sum(p < truth, axis=0))
    return np.array(found)


def chance_of(ranks: np.ndarray, bins: int) -> np.ndarray:
    """p-values (n,) of ranks (runs, n) under uniformity, by chi-square over equal bins."""
    edges = np.linspace(-0.5, 99.5, bins + 1)
    counts = [np.histogram(column, edges)[0] for column in ranks.T]
    return np.array([chisquare(count).pvalue for count in counts])

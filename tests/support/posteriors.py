"""Cheap models with posteriors that quadrature on a grid can integrate."""

from __future__ import annotations

import numpy as np

from geoident.identify.objective.discrepancy import Discrepancy
from geoident.identify.problem.problem import Problem
from geoident.model.parameter import Parameter, Prior
from geoident.model.result import Counts


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


def grid_quantiles(problem: Problem, of: int, n: int = 300) -> tuple[np.ndarray, np.ndarray]:
    """Values of one of two parameters and the probability below, by summing exp(-phi/2).

    Cells are even in ln p; a density that is one in p is multiplied with p.
    """
    axes = [
        np.exp(np.linspace(np.log(q.lower), np.log(q.upper), 2 * n + 1)[1::2])
        for q in problem.parameters
    ]
    phi = Discrepancy(problem)
    density = np.array(
        [
            [np.exp(-0.5 * phi.objective_of(p, problem.response.readings(p))) for p in row]
            for row in np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        ]
    )
    for axis, (q, values) in enumerate(zip(problem.parameters, axes, strict=True)):
        in_p = q.scale == "linear" if q.prior is None else q.prior.kind == "normal"
        if in_p:
            density = density * (values if axis else values[:, None])
    alone = density.sum(axis=1 - of)
    cumulated = np.cumsum(alone) - 0.5 * alone
    return axes[of], cumulated / alone.sum()

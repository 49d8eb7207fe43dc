"""Ensemble smoother with multiple data assimilation (theory 10.5; Emerick and Reynolds 2013).

An ensemble of parameter vectors, drawn from the priors, is moved towards the readings in a few
steps; in each the readings count with an inflated variance, so that all steps together count them
once. A step moves along the correlations of the ensemble between parameters and computed readings:
no derivatives are asked for, so it serves models that yield and fields that are not Gaussian. Where
readings are linear in the parameters and priors normal its ensemble is the posterior, up to the
error of a sample (about 1 / sqrt(size)); Gauss-Newton is then faster and exact.

The work is done in z, in which every prior is N(0, 1): for a normal or lognormal prior its standard
score, for a parameter without one the normal score of its place between the bounds, in x.

The estimate is the mean of the ensemble in z. Intervals are those of all methods, from the model
linearized there; what the ensemble itself says of the parameters that the case names stands beside
them, in the remarks.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from iterative_ensemble_smoother import ESMDA
from scipy.special import ndtr

from geoident.errors import ModelError
from geoident.identify.problem.ahead import prefetched_readings
from geoident.identify.problem.outcome import History, OnIteration, Outcome
from geoident.identify.problem.problem import Discrepancy, Problem
from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Bools, Floats
from geoident.model.methods import EnsembleSmootherOptions
from geoident.model.parameter import Parameter
from geoident.units import in_unit, shown_unit

NAME = "ensemble-smoother"

LEAST_SOLVED = 0.5
"""Part of the ensemble that must have a solution: of less a sample says little."""

KEPT = 0.999
"""Part of the singular values of the ensemble's readings that an update keeps: the usual choice."""


def values_at(z: Floats, scaling: Scaling) -> Floats:
    """Parameter values (n,), SI, within the bounds, of normal scores z (n,)."""
    x = scaling.lower + (scaling.upper - scaling.lower) * ndtr(z)
    p = scaling.to_natural(x)
    for i, prior in scaling.priors:
        p[i] = prior.at_score(z[i])
    return np.asarray(np.clip(p, *scaling.bounds), dtype=np.float64)


def ensemble_smoother(
    problem: Problem, options: EnsembleSmootherOptions, on_iteration: OnIteration
) -> Outcome:
    """Move an ensemble of the priors to the readings.

    Args:
        problem: readings, model and parameters, the squared loss.
        options: size of the ensemble, steps and seed.
        on_iteration: is called with every step.
    """
    phi, scaling = Discrepancy(problem).objective, Scaling(problem.parameters)
    history = History(NAME, problem.response, on_iteration)
    generator = np.random.default_rng(options.seed)
    Z = generator.standard_normal((len(problem.parameters), options.ensemble))
    target = problem.whiten(problem.measured)
    smoother: Any = ESMDA(np.ones(len(target)), target, alpha=options.assimilations, seed=generator)
    step = 0.0
    for _ in range(options.assimilations):
        Y, solved = _white_readings(problem, scaling, Z)
        Z, Y = Z[:, solved], Y[:, solved]
        if solved.mean() < LEAST_SOLVED:
            middle = values_at(Z.mean(axis=1), scaling) if Z.size else problem.start
            reason = (
                f"Of {options.ensemble} members of the ensemble {options.ensemble - Z.shape[1]} "
                "have no solution. Narrow the priors and bounds, so that the model stands within "
                "them."
            )
            return history.outcome(middle, phi(middle), "not-converged", reason)
        before = Z.mean(axis=1)
        middle = values_at(before, scaling)
        history.record(middle, phi(middle), step=step, note="assimilated")
        if history.stop is not None:
            return history.outcome(middle, phi(middle), "", "")
        smoother.prepare_assimilation(Y=Y, truncation=KEPT)
        Z = smoother.assimilate_batch(X=Z)
        step = float(np.linalg.norm(Z.mean(axis=1) - before))
    middle = values_at(Z.mean(axis=1), scaling)
    objective = phi(middle)
    history.record(middle, objective, step=step, note="mean of the ensemble")
    reason = (
        f"An ensemble of {Z.shape[1]} was moved to the readings in {options.assimilations} "
        "steps; the values are its mean."
    )
    status = "converged" if np.isfinite(objective) else "not-converged"
    outcome = history.outcome(middle, objective, status, reason)
    members = np.stack([values_at(z, scaling) for z in Z.T], axis=1)
    remarks = [_intervals(problem.parameters, members)]
    lost = options.ensemble - Z.shape[1]
    if lost:
        remarks.append(f"{lost} members of the ensemble had no solution and were left out")
    return replace(outcome, remarks=tuple(remark for remark in remarks if remark))


def _white_readings(problem: Problem, scaling: Scaling, Z: Floats) -> tuple[Floats, Bools]:
    """White readings (g, m) of the members (n, m) of an ensemble, and which have a solution."""
    Y = np.zeros((len(problem.measured), Z.shape[1]))
    solved = np.zeros(Z.shape[1], dtype=np.bool_)
    points = np.array([values_at(z, scaling) for z in Z.T])
    with prefetched_readings(problem, points) as turn:
        for k, p in enumerate(points):
            turn(k)
            if problem.response.admissible(p) is not None:
                continue
            try:
                Y[:, k] = problem.whiten(problem.response.readings(p))
            except ModelError:
                continue
            solved[k] = bool(np.isfinite(Y[:, k]).all())
    return Y, solved


def _intervals(parameters: tuple[Parameter, ...], members: Floats) -> str:
    """The 95 % intervals of the members (n, m) for the parameters that the case names."""
    texts = []
    for q, values in zip(parameters, members, strict=True):
        if not q.field:
            low, high = (
                in_unit(float(x), q.unit, q.dimension) for x in np.quantile(values, [0.025, 0.975])
            )
            unit = shown_unit(q.unit, q.dimension)
            texts.append(f"{q.name} {low:.4g} .. {high:.4g} {unit}".rstrip())
    return f"95 % of the ensemble: {', '.join(texts)}" if texts else ""

"""The search for all unknowns of several sections and for their scatter (theory 15)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.identify.hierarchical.joint_problem import (
    JointUnknowns,
    SectionModels,
    SectionReadings,
)
from geoident.identify.hierarchical.restricted_likelihood import LinearSections, most_likely
from geoident.identify.least_squares.gauss_newton import gauss_newton_descent
from geoident.identify.problem.outcome import History, OnIteration, Outcome
from geoident.identify.problem.problem import Discrepancy, Problem
from geoident.model.arrays import Bools, Floats
from geoident.model.methods import GaussNewtonOptions
from geoident.model.project.project import ParameterLaw
from geoident.model.results.result import Iteration

_ROUNDS = 40
"""Five are usual; a search that needs more goes round in circles."""

_SETTLED = 1e-5
"""Relative change of a scatter that ends the rounds: a thousandth of what is known of it."""

_ROUGH, _FINE = 1e-8, 1e-12
"""Tolerance of descents as long as the scatter is not settled, and of the last one."""

_FIRST_SCATTER = 0.25
"""Of the largest scatter: where the search for it begins."""

_LEAST_SCATTER = 1e-3
"""Of the largest scatter: what stays where a law alone would meet the bounds of a section."""


@dataclass(frozen=True)
class HierarchicalFit:
    """Where the search ended.

    Args:
        joint: the unknowns, with the laws about which sections scatter.
        problem: of all sections at this scatter.
        outcome: of the last descent; its values are those of all unknowns.
        tau: (K,) scatter about the laws, on their scales.
        free: (K,) that was estimated.
        linear: the sections there.
    """

    joint: JointUnknowns
    problem: Problem
    outcome: Outcome
    tau: Floats
    free: Bools
    linear: LinearSections


@dataclass(frozen=True)
class SectionsStart:
    """Where a search begins.

    Args:
        common: (F,) shared parameters and constants of laws, SI; None for their starts.
        points: of each section its parameters (n,), SI; NaN, or nothing at all, for what follows
            from what is common, or for their starts.
        tau: (K,) scatter on the scales; None for a quarter of the largest.
    """

    common: Floats | None = None
    points: tuple[Floats, ...] = ()
    tau: Floats | None = None


def fit_sections(
    sections: Sequence[SectionReadings],
    shared: Sequence[str],
    laws: Sequence[ParameterLaw],
    models: SectionModels,
    on_iteration: OnIteration,
    begin: SectionsStart | None = None,
) -> HierarchicalFit:
    """The most likely scatter of sections about laws, and all other unknowns at it.

    Descents over all unknowns and maxima of the restricted likelihood alternate until the scatter
    is settled (Lindstrom & Bates 1990); a last descent is then made to the full tolerance.

    Args:
        sections: with their readings.
        shared: names of parameters with one value for all.
        laws: of others.
        models: of the sections.
        on_iteration: is called with every trial; its reason to stop ends the search.
        begin: where to begin; None for the starts of the parameters.

    Raises:
        ModelError: a model has no solution at the start.
    """
    begin = begin or SectionsStart()
    free = np.array([law.scatter.kind == "estimate" for law in laws], dtype=np.bool_)
    joint = JointUnknowns(sections, shared, laws, np.ones(len(laws), dtype=np.bool_))
    stated = np.array([law.scatter.size for law in laws]) / joint.law_scaling.reference
    tau = np.where(free, _FIRST_SCATTER * joint.largest if begin.tau is None else begin.tau, stated)
    common = begin.common
    if common is None:
        common = np.array([q.start for q in joint.unknowns[: joint.n_common]])
    points = [joint.expected_point(section, common) for section in joint.sections]
    if begin.points:
        pairs = zip(begin.points, points, strict=True)
        points = [np.where(np.isnan(own), expected, own) for own, expected in pairs]
    iterations: tuple[Iteration, ...] = ()
    last, least = not free.any(), np.zeros(len(laws))
    little = np.where(free, _LEAST_SCATTER * joint.largest, 0.0)
    for _ in range(_ROUNDS):
        joint = JointUnknowns(sections, shared, laws, tau > 0.0)
        problem = joint.problem(models, tau).begun_at(joint.joined(common, points))
        without = bool(np.any(free & (tau == 0.0)))  # a section has what the law gives
        if without and problem.response.admissible(problem.start) is not None:
            tau, least = np.maximum(tau, little), little
            continue
        history = History("gauss-newton", problem.response, on_iteration)
        options = GaussNewtonOptions(tolerance=_FINE if last else _ROUGH)
        descent = gauss_newton_descent(Discrepancy(problem), options, history)
        first = descent.evaluator.evaluate(descent.evaluator.scaling.start)
        descent.evaluator.record(first.x, first, 0.0, "start")
        end = descent.run(first)
        if without and end.stalled:
            tau, least = np.maximum(tau, little), little
            continue
        outcome = history.outcome(end.point.p, end.point.phi, end.status, end.reason)
        done = len(iterations)
        iterations += tuple(
            replace(step, number=done + n) for n, step in enumerate(outcome.iterations)
        )
        common = outcome.values[: joint.n_common]
        points = list(joint.points(outcome.values).values())
        linear = LinearSections.at(joint, models, outcome.values)
        if last or outcome.status != "converged":
            break
        previous, tau = tau, np.maximum(most_likely(linear, tau, free), least)
        last = bool(np.all(np.abs(tau - previous) <= _SETTLED * np.maximum(tau, previous)))
    else:
        reason = f"The scatter about the laws was not settled after {_ROUNDS} rounds."
        outcome = replace(outcome, status="not-converged", reason=reason)
    outcome = replace(outcome, iterations=iterations)
    return HierarchicalFit(joint, problem, outcome, tau, free, linear)

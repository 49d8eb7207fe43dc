"""What the steps in time do to a fit: whether their error counts beside those of the readings.

Twice as many steps are taken at the end of the first search (theory 18.2). Like that of the mesh
their error is one of what is computed, which all readings share; it has a factor of its own, since
the two have nothing to do with each other and may cancel by chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil, sqrt

import numpy as np

from geoident.errors import ModelError
from geoident.forward.analysis.stages_in_time import of_each_length, order_of_steps
from geoident.forward.model import StagedModel
from geoident.identify.problem.outcome import Outcome
from geoident.identify.problem.problem import Problem
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.gauges import Channel, ErrorParts
from geoident.model.results.computed_error import MATTERS, ComputedError
from geoident.model.results.costs import NO_COST, Counts
from geoident.model.results.findings import Finding
from geoident.workflow.estimating.fitted_mesh import SHIFT, used_and_shift

ENOUGH = 0.5 * MATTERS
"""Part of its accuracy to which the error of a reading falls with the steps that are asked for."""

DOUBT = (0.2, 0.1)
"""By how much an error is uncertain: parts of it, and of the mean of its channel in all stages.

The second is for moments at which the error changes its sign.
"""


@dataclass(frozen=True)
class FittedSteps:
    """What the steps in time do to a fit.

    Args:
        table: by channel and stage, at the parameters of the first search.
        of_each: steps of each length.
        order: the power of their number by which the error falls.
        counts: whether the errors of the readings have it.
        spent: what it has cost this fit, beside its evaluations.
    """

    table: ComputedError
    of_each: int
    order: int
    counts: bool
    spent: Counts = NO_COST

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What it does and the remedy, where it counts."""
        if not self.counts:
            return ()
        part = float(np.nanmax(self.table.share))
        times = max(2, ceil((part / ENOUGH) ** (1.0 / self.order)))
        sentence = (
            f"{steps_sentence(self.table)} Intervals and bands allow for it. Write 'time_steps: "
            f"{times * self.of_each}' in the case: {times} times as many steps leave about "
            f"1/{times**self.order} of it."
        )
        return (Finding("step-error", "", sentence, {"part": part}),)

    @property
    def notes(self) -> tuple[str, ...]:
        """How large it is, where it does not count."""
        return () if self.counts else (steps_sentence(self.table),)


def takes_steps(case: Case) -> bool:
    """Whether any stage of a case takes steps in time."""
    return case.in_steps is not None and any(stage.lasts for stage in case.stages)


def step_error(model: StagedModel, p: Floats) -> ComputedError:
    """The error of all readings by the steps in time.

    Args:
        model: of a case that takes steps.
        p: (n,) parameters, SI.

    Raises:
        ModelError: the model has no solution there.
    """
    case = model.case
    return ComputedError(
        channels=tuple(channel.name for channel in case.channels),
        stages=tuple(stage.name for stage in case.stages),
        error=model.time_step_errors(p),
        accuracy=case.accuracies,
        units=tuple(channel.unit for channel in case.channels),
        dimensions=tuple(channel.dimension for channel in case.channels),
    )


def steps_sentence(table: ComputedError) -> str:
    """How large the error by the steps is, a sentence."""
    most = table.largest(np.isfinite(table.error))
    if not most:
        return "The steps in time change none of the readings."
    return f"The error by the steps in time is at most {most}."


def fitted_steps(
    model: StagedModel,
    problem: Problem,
    pairs: Sequence[tuple[str, str]],
    outcome: Outcome,
    known: FittedSteps | None,
) -> FittedSteps | None:
    """What the steps in time do to the readings of a fit; None where that cannot be told.

    Args:
        model: of a case that takes steps.
        problem: the g used readings.
        pairs: channel and stage of each.
        outcome: of the search.
        known: what another fit of the same model has found.
    """
    before, of_response = model.counts, problem.response.counts
    try:
        table = step_error(model, outcome.values) if known is None else known.table
        judged = judged_steps(table, model.case, problem, pairs, outcome)
    except ModelError:
        return None
    spent = (model.counts - before) - (problem.response.counts - of_response)
    return replace(judged, spent=spent)


def judged_steps(
    table: ComputedError,
    case: Case,
    problem: Problem,
    pairs: Sequence[tuple[str, str]],
    outcome: Outcome,
) -> FittedSteps:
    """Whether errors by the steps count beside those of the readings; one large one is enough.

    What is predicted at other moments has larger errors than what was read.

    Args:
        table: by channel and stage, with the accuracies of the readings.
        case: that takes steps.
        problem: the g used readings, without errors of steps and model.
        pairs: channel and stage of each.
        outcome: of a search.

    Raises:
        ModelError: the model has no solution there.
    """
    _, shift = used_and_shift(table, problem, pairs, outcome)
    of_each = of_each_length(case, water=case.consolidates or case.conducts)
    counts = shift > SHIFT or counts_alone(table)
    return FittedSteps(table, of_each, order_of_steps(case), counts)


def counts_alone(table: ComputedError) -> bool:
    """Whether the error of any reading by the steps is large beside its accuracy."""
    return float(np.nan_to_num(table.share).max(initial=0.0)) > MATTERS


def with_step_error(case: Case, table: ComputedError) -> Case:
    """A case whose channels have the error by the steps among what their readings share."""
    return replace(
        case,
        channels=tuple(
            replace(channel, errors=_with_steps(channel, table.stages, np.nan_to_num(error)))
            for channel, error in zip(case.channels, table.error, strict=True)
        ),
    )


def _with_steps(channel: Channel, stages: Sequence[str], error: Floats) -> ErrorParts:
    """Errors of a channel with those by the steps (n_stages,), SI; 0 where they are not known."""
    own, mean = DOUBT
    mean_error = float(np.linalg.norm(error)) / sqrt(max(int(np.count_nonzero(error)), 1))
    size = np.hypot(own * error, mean * mean_error)
    doubt = np.asarray(np.copysign(size, error))
    each = zip(stages, error.tolist(), doubt.tolist(), strict=True)
    return replace(channel.error_parts, steps=tuple((s, e, d) for s, e, d in each if e != 0.0))

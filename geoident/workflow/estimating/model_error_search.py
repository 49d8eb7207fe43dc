"""Parameters, size of the model error and scatter of the gauges, found together (theory 9.2).

They take turns: at the parameters of least misfit the size and the scatter that the residuals
speak for, with these the parameters again, until none changes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from geoident.identify.assessment.diagnostics import effective_sd
from geoident.identify.assessment.findings import join
from geoident.identify.assessment.model_error import (
    FACTORS,
    PRIOR_SD,
    SIZES,
    ZEROS,
    SizeWeights,
    at_size,
    weigh_all,
    weigh_sizes,
)
from geoident.identify.assessment.variance_components import (
    RestrictedLikelihood,
    VarianceComponents,
    likelihood_at,
)
from geoident.identify.hierarchical.error_sizes import course_root
from geoident.identify.problem.outcome import Outcome
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.responses import HasIncrements
from geoident.identify.problem.shared_errors import ErrorStructure
from geoident.model.arrays import Floats
from geoident.model.gauges import Channel, Reads
from geoident.model.methods import ModelErrorOptions
from geoident.model.results.findings import Finding
from geoident.model.results.result import STOPPED
from geoident.workflow.estimating.accuracies import after
from geoident.workflow.estimating.model_error import NAME, FittedModelError, percent
from geoident.workflow.estimating.model_error_covariance import (
    CorrelationTime,
    ErrorModes,
    ReadingSteps,
    family,
    shared_columns,
)

ROUNDS = 20
"""At most so many times parameters and size of the model error take turns."""

EAGER = 4
"""Rounds after which the model error goes half of the way to that of the new parameters: they may
swing between two states, each the answer to the other."""

AT_REST = 0.002
"""Change of the logarithm of the size that ends it."""

SCATTER = "stated accuracies"
"""Component of all errors of the gauges together, where one factor on them is found along."""

ZERO = "zeros"
"""Component of the errors of zeros that the case does not declare."""

TELLS = 3.84
"""Difference of -2 l from which on one explanation is better than another: 95 %, one factor."""


@dataclass(frozen=True)
class WithModelError:
    """Parameters, accuracies and model error that go together.

    Args:
        problem: with the accuracies and the model error.
        outcome: of the search for the parameters.
        components: what is known of the accuracies that are estimated.
        model_error: the model error.
    """

    problem: Problem
    outcome: Outcome
    components: VarianceComponents
    model_error: FittedModelError


@dataclass(frozen=True)
class ModelErrorSearch:
    """Parameters and size of the model error, in turns.

    Args:
        options: what the case says.
        length: over which it is correlated, m.
        time: over which it is, or None; see `correlation_time`.
        stated: the errors of the readings without it, as the case states them.
        channels: of the readings.
        steps_at: what it is made of where each step changes what the channels see by increments
            (n_states, n_channels), SI.
        search: for the parameters, from where the problem begins.
        plain: the loss is that of squares.
        in_common: the course in time may be wrong as well, alike in all channels.
    """

    options: ModelErrorOptions
    length: float
    time: CorrelationTime | None
    stated: ErrorStructure
    channels: tuple[Channel, ...]
    steps_at: Callable[[Floats], ReadingSteps]
    search: Callable[[Problem], Outcome]
    plain: bool = True
    in_common: bool = False

    def run(self, problem: Problem, outcome: Outcome) -> WithModelError | None:
        """Both, in turns, until neither changes; None where no reading can have a model error.

        With a robust loss readings that are far off lose their weight, so the first turn takes a
        model error for granted: what it explains is not wrong.

        Args:
            problem: without model error.
            outcome: of the search without it.
        """
        t = np.zeros(len(self.structure.names))
        used = self._steps(problem, outcome.values)
        if not used.any():
            return None
        modes = ErrorModes()
        columns = shared_columns([used], self.length, modes)
        size, course, fixed = PRIOR_SD, 0.0, self.options.kind == "given"
        if fixed:
            size = self.options.size
        elif self.plain:
            weighed = self._weighed(problem, outcome, columns, t, used)
            size, course, t = weighed.size, weighed.course, weighed.components.log_factor
        for turn in range(ROUNDS):
            if course:
                columns = shared_columns([used], self.length, modes, course=course / size)
            problem, outcome = self._again(problem, outcome, columns, modes, t, size)
            now = self._steps(problem, outcome.values)
            following = now if turn < EAGER else _halfway(used, now)
            columns = shared_columns([following], self.length, modes)
            held = size if fixed else None
            weighed = self._weighed(problem, outcome, columns, t, following, held)
            known = FittedModelError(
                used, size, self.length, None if fixed else weighed, time=self.time, course=course
            )
            factor, zero = self._gauges(t)
            known = replace(known, factor=factor, zero=zero)
            # the accuracies of the problem, so that all that is said of it comes from one posterior
            components = replace(weighed.components, log_factor=t)
            state = WithModelError(problem, outcome, components, known)
            rest = fixed or (_near(weighed.size, size) and _near(weighed.course, course))
            if outcome.status == STOPPED or (
                rest and _alike(now, used) and _close(weighed.components.log_factor, t)
            ):
                return self._explained(state, modes)
            used, t = following, weighed.components.log_factor
            size, course = (size, course) if fixed else (weighed.size, weighed.course)
        sentence = (
            f"Parameters and model error did not come to rest in {ROUNDS} rounds: others, "
            "with the model error that follows from them, meet the readings as well. State the "
            "model error ('fit: {model_error: ...}')."
        )
        return self._explained(state, modes, Finding("model-error-doubt", "", sentence))

    @cached_property
    def scatters(self) -> bool:
        """Whether one factor on all stated accuracies is found along.

        Not where some are to be estimated: then the others are known. Nor with a robust loss, which
        explains by wrong readings what the factor explains by all gauges.
        """
        return self.options.kind == "estimate" and self.plain and not self.stated.names

    @cached_property
    def structure(self) -> ErrorStructure:
        """The errors of the readings without model error, with components for what is estimated."""
        if not self.scatters:
            return self.stated
        structure = self.stated.with_one_factor(SCATTER)
        return structure if self.zeros is None else structure.with_component(self.zeros, ZERO)

    def _gauges(self, t: Floats) -> tuple[float, float]:
        """Factor on the accuracies, and error of the zeros in these, of components t (c,)."""
        root = np.exp(0.5 * t) if self.scatters else np.ones(1)
        return float(root[0]), float(root[1] / root[0]) if len(root) > 1 else 0.0

    def _explained(
        self, state: WithModelError, modes: ErrorModes, *findings: Finding
    ) -> WithModelError:
        """The same with findings: what explains the residuals as well, and what is left out.

        Args:
            state: at the end of the turns.
            modes: of the model error.
            findings: what else is to be said.
        """
        wider = state.model_error.size * modes.left / state.problem.sd
        findings = (*findings, *explanations(state.model_error), *too_dense(wider))
        return replace(state, model_error=replace(state.model_error, findings=findings))

    def _steps(self, problem: Problem, values: Floats) -> ReadingSteps:
        """What the model error is made of at parameters (n,), SI."""
        assert isinstance(problem.response, HasIncrements)
        return self.steps_at(problem.response.increments(values))

    def _weighed(
        self,
        problem: Problem,
        outcome: Outcome,
        columns: sp.csr_array,
        t: Floats,
        used: ReadingSteps,
        size: float | None = None,
    ) -> SizeWeights:
        """What the residuals say of the sizes; of the accuracies alone where the size is given."""
        if size is None and not self.stated.names:
            likelihood = self._likelihood(problem, outcome, self.stated)
            course = self._course(used)
            return weigh_all(likelihood, columns, self.zeros, free=self.scatters, course=course)
        whole = self.structure.with_component(columns, NAME)
        likelihood = self._likelihood(problem, outcome, whole)
        if size is None:
            return weigh_sizes(likelihood, t)
        nothing = np.zeros((len(SIZES), 1, 1))
        return SizeWeights(nothing, nothing, np.ones((1, 1)), at_size(likelihood, size, t))

    def _course(self, used: ReadingSteps) -> Floats | None:
        """Errors of the course in time (g, r), SI; None where there are none."""
        if not self.in_common or used.moments is None:
            return None
        kinds = np.unique([family(channel) for channel in used.channels], return_inverse=True)[1]
        moved = used.steps.sum(axis=1)[:, None]
        return np.asarray(moved * course_root(used.moments, kinds, 1.0))

    def _likelihood(
        self, problem: Problem, outcome: Outcome, structure: ErrorStructure
    ) -> RestrictedLikelihood:
        readings, jacobian = problem.response.evaluate(outcome.values)
        left = effective_sd(problem, readings) / problem.sd  # of a robust loss
        weakened = replace(structure, sd=structure.sd * left)
        return likelihood_at(problem, weakened, outcome.values, readings, jacobian)

    @cached_property
    def zeros(self) -> sp.csr_array | None:
        """Errors of the zeros (g, channels) as large as the accuracies; None if they are known."""
        return zero_columns(self.channels)

    def _again(
        self,
        problem: Problem,
        outcome: Outcome,
        columns: sp.csr_array,
        modes: ErrorModes,
        t: Floats,
        size: float,
    ) -> tuple[Problem, Outcome]:
        """The problem with these accuracies (c,) and this size, and its solution."""
        factors = np.append(t, 2.0 * np.log(max(size, SIZES[0])))
        sd, shared = self.structure.with_component(columns, NAME).at(factors)
        sd = np.hypot(sd, size * modes.left)
        problem = replace(problem, sd=sd, shared=shared).begun_at(outcome.values)
        return problem, after(outcome, self.search(problem))


def zero_columns(channels: Sequence[Channel]) -> sp.csr_array | None:
    """Errors of the zeros (g, channels) as large as the accuracies; None if they are known.

    They are where the case declares some; where no channel has several readings, nothing tells of
    them.

    Args:
        channels: of the g readings.
    """
    if any(c.errors is not None and c.errors.zero > 0.0 for c in channels):
        return None
    zeroed = np.flatnonzero([c.reads is Reads.CHANGE for c in channels])
    names = [channels[k].name for k in zeroed.tolist()]
    number = {name: k for k, name in enumerate(dict.fromkeys(names))}
    if len(number) == len(names):
        return None
    at = np.array([number[name] for name in names])
    size = np.array([channels[k].own_accuracy for k in zeroed.tolist()])
    return sp.csr_array((size, (zeroed, at)), shape=(len(channels), len(number)))


_LEAST = 0.01
"""Size of the model error below which nothing changes any more: one per cent of the motion."""


def _near(size: float, other: float) -> bool:
    return bool(abs(np.log(max(size, _LEAST) / max(other, _LEAST))) <= AT_REST)


def _halfway(used: ReadingSteps, now: ReadingSteps) -> ReadingSteps:
    """Between two of the same readings."""
    steps, floors = 0.5 * (used.steps + now.steps), 0.5 * (used.floors + now.floors)
    return replace(now, steps=steps, floors=floors)


def _alike(now: ReadingSteps, before: ReadingSteps) -> bool:
    size = np.abs(before.steps).max(axis=0, initial=0.0)
    return bool(np.all(np.abs(now.steps - before.steps) <= AT_REST * size))


def _close(t: Floats, before: Floats) -> bool:
    return float(np.abs(t - before).max(initial=0.0)) <= AT_REST


# What cannot be told from it ---------------------------------------------------------------------


def explanations(model_error: FittedModelError) -> Iterator[Finding]:
    """What explains the residuals by itself as well as the model error, or better.

    Args:
        model_error: the model error, and what was weighed beside it.
    """
    weighed = model_error.weighed
    if weighed is None or weighed.minus_two_l.shape[1] == 1:
        return
    values = weighed.minus_two_l
    nothing, of_model = float(values[0, 0, 0]), float(values[:, 0, 0].min())
    others = []
    f, z = int(values[0, :, 0].argmin()), int(values[0, 0].argmin())
    if f > 0:
        words = f"gauges {FACTORS[f]:.2g} times less accurate than stated"
        others.append((words, float(values[0, f, 0])))
    if z > 0:
        words = f"errors of the zeros {ZEROS[z]:.2g} times as large as the accuracies"
        others.append((words, float(values[0, 0, z])))
    others = [other for other in others if other[1] < nothing - TELLS]
    better = [words for words, value in others if value < of_model - TELLS]
    alike = [words for words, value in others if abs(value - of_model) <= TELLS]
    size = f" of {percent(model_error.size)}" if model_error.shown else ""
    of_error = f"a model error{size}"
    if better:
        yield Finding(
            "model-error-doubt",
            "",
            f"{_capital(join(better, 'or'))} would explain the residuals better than {of_error}: "
            f"check that first. {_REMEDY}",
        )
    elif alike:
        scatters = weighed.prior.size > 1 and weighed.prior[0, 0] < 1.0
        of = (
            "all of them, each as likely as the readings leave it"
            if scatters
            else "the model error"
        )
        yield Finding(
            "model-error-doubt",
            "",
            f"The readings cannot separate {of_error} from {join(alike, 'or')}: intervals and "
            f"bands are those of {of}. {_REMEDY}",
        )


def too_dense(part: Floats) -> Iterator[Finding]:
    """A finding where so many readings were taken so densely that a model error is approximated.

    Args:
        part: (g,) of the own error of each reading that stands for what was left out.
    """
    square = float(np.mean(part**2))
    if square > _DENSE:
        yield Finding(
            "model-error-doubt",
            "",
            f"{len(part)} readings are too many for the full model error between them: what is "
            f"left out counts as {percent(np.sqrt(1.0 / (1.0 - square)) - 1.0)} less accuracy of "
            "each. A part of the points (every fifth, say), or means of neighbouring ones, carry "
            "the same information and need no such approximation.",
        )


_DENSE = 0.05
"""Part of the variance of the readings that may stand for what was left out without a word."""

_REMEDY = (
    "'accuracies: estimate' under 'fit' estimates the accuracy of the gauges from the "
    "residuals; 'zero: estimate' in the accuracy of a gauge estimates that of its zero."
)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]

"""Factors of safety at draws of a posterior, in one process or in several.

The first draws begin at the factor of the best values, all others at what a surface through the
first says: so the factors are the same to the last bit in any number of processes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

import numpy as np

from geoident.errors import ModelError
from geoident.fem.solvers.threads import one_thread
from geoident.forward.model import StagedModel
from geoident.forward.safety.search import Search, safety_factors
from geoident.identify.assessment.scalar_band import fitted_surface
from geoident.model.arrays import Floats, Ints
from geoident.workflow.executing.executor import in_order
from geoident.workflow.executing.processes import LocalProcesses
from geoident.workflow.running.control import Control
from geoident.workflow.running.workers import ModelParts, worthwhile_processes

_AT_DRAWS = 0.02
"""Relative width of the brackets of factors at draws: their errors are far below the band's."""

_FIRST = 8
"""Draws, at least, through which the surface goes that says where the others begin."""

_FACTORIZATIONS = 100
"""Of a factor, about."""


@dataclass(frozen=True)
class FactorTask:
    """A factor of safety to be found.

    Args:
        p: (n,) parameters, SI.
        state: number of the state.
        guess: about what the factor is.
    """

    p: Floats
    state: int
    guess: float


@dataclass(frozen=True)
class FactorAtDraw:
    """What was found.

    Args:
        value: the factor; NaN where the model has no answer.
        bounded: no failure was found up to the largest factor that was tried.
    """

    value: float
    bounded: bool


def factor_at(model: StagedModel, task: FactorTask) -> FactorAtDraw:
    """The factor of safety of a state at parameters.

    Args:
        model: of the case.
        task: state and parameters.
    """
    search = Search(tolerance=_AT_DRAWS, guess=task.guess, in_situ_too=True)
    try:
        (found,) = safety_factors(model, task.p, [task.state], search)
    except ModelError:
        return FactorAtDraw(np.nan, bounded=False)
    return FactorAtDraw(found.value, found.bounded)


def factors_at_draws(
    model: StagedModel,
    parts: ModelParts,
    control: Control,
    points: Sequence[Floats],
    coordinates: Floats,
    state: int,
    best: float,
) -> tuple[Floats, Ints]:
    """The factor of a state at each of some points, NaN where there is none; whether it is bounded.

    Args:
        model: of the fit.
        parts: of which it consists, to build it elsewhere.
        control: stops the run, says in how many processes.
        points: d parameter vectors (n,), SI.
        coordinates: (d, r) of the same, independent and of the size of one.
        state: its number.
        best: factor at the best values.

    Raises:
        Interrupted: a stop was asked for.
        ModelError: no process computes a factor.
    """
    count, first = len(points), max(_FIRST, coordinates.shape[1] + 3)
    jobs = control.jobs
    if jobs is None:
        jobs = worthwhile_processes(model, parts.solver, count * _FACTORIZATIONS)
    found: list[FactorAtDraw] = []
    with _computing(model, parts, min(jobs, count), control) as compute:
        for some in (slice(0, first), slice(first, count)):
            guesses = _guesses(coordinates, found, coordinates[some], best)
            tasks = [
                FactorTask(p, state, guess) for p, guess in zip(points[some], guesses, strict=True)
            ]
            for one in compute(tasks):
                found.append(one)
                control.stop.check()
                said = f"factor at draw {len(found)} of {count}"
                control.monitor.part(said, len(found) / count)
    return np.array([one.value for one in found]), np.array([one.bounded for one in found], int)


def _guesses(z: Floats, found: Sequence[FactorAtDraw], wanted: Floats, best: float) -> Floats:
    """About what the factors are at coordinates (k, r), from those at the first of others."""
    y = np.log([one.value for one in found])
    known = np.isfinite(y)
    if np.count_nonzero(known) < _FIRST:
        return np.full(len(wanted), best)
    return np.exp(fitted_surface(z[: len(y)][known], y[known]).at(wanted))


Compute = Callable[[Sequence[FactorTask]], Iterator[FactorAtDraw]]
"""Finds factors, in the order of tasks."""


@contextmanager
def _computing(
    model: StagedModel, parts: ModelParts, jobs: int, control: Control
) -> Iterator[Compute]:
    """What finds factors, in this process or in others."""
    if jobs == 1:
        yield lambda tasks: (factor_at(model, task) for task in tasks)
        return
    with LocalProcesses(jobs, partial(_finding, parts)) as processes:

        def compute(tasks: Sequence[FactorTask]) -> Iterator[FactorAtDraw]:
            with control.stop.heard_by(processes.ask_to_stop):
                for answer in in_order(processes.run(tasks)):
                    control.stop.check()
                    if answer.value is None:
                        message = f"at a draw of the posterior {answer.why_set_aside}"
                        raise ModelError(message, "With fewer processes each has more memory.")
                    yield answer.value

        yield compute


def _finding(parts: ModelParts) -> Callable[[FactorTask], FactorAtDraw]:
    model = parts.build()
    assert isinstance(model, StagedModel)

    def find(task: FactorTask) -> FactorAtDraw:
        with one_thread():
            return factor_at(model, task)

    return find

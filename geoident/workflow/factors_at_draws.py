"""Factors of safety at draws of a posterior, in one process or in several, and their band.

The first draws begin at the factor of the best values, all others at what a surface through the
first says: so the factors are the same to the last bit in any number of processes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from geoident.errors import ModelError
from geoident.fem.solvers.threads import one_thread
from geoident.forward.model import StagedModel
from geoident.forward.safety.search import Search, safety_factors
from geoident.identify.assessment.scalar_band import fitted_surface, scalar_band
from geoident.identify.assessment.uncertainty import Assessment
from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Floats, Ints
from geoident.model.results.safety import StageSafety, depends_on
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

_MANY = 20_000
"""Draws at which the surface through the factors is asked."""


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
        bounded: whether the ground fails with some factor that was tried.
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
        ((found, _),) = safety_factors(model, task.p, [task.state], search)
    except ModelError:
        return FactorAtDraw(np.nan, bounded=False)
    return FactorAtDraw(found.value, found.fails)


@dataclass(frozen=True)
class SafetyDraws:
    """Draws of the posterior of a fit, at which factors are computed.

    Args:
        model: of the fit.
        parts: of which it consists, to build it elsewhere.
        control: stops the run, says in how many processes.
        assessment: how well the fit knows its n parameters.
        count: how many draws.
        seed: of these.
    """

    model: StagedModel
    parts: ModelParts
    control: Control
    assessment: Assessment
    count: int
    seed: int

    def band(self, p: Floats, state: int, best: StageSafety) -> StageSafety:
        """What the posterior makes of the factor of a state.

        Args:
            p: (n,) the best values, SI.
            state: its number.
            best: its factor there, without a band.

        Raises:
            Interrupted: a stop was asked for.
            ModelError: it cannot be computed at most draws.
        """
        rng = np.random.default_rng([self.seed, state])
        scaling = Scaling(self.model.case.parameters)
        assessment, count, names = self.assessment, self.count, self.model.names
        steps, many = (_drawn(assessment, size, rng) for size in (count, _MANY))
        axes = _axes(many)
        points = [scaling.away(p, step) for step in steps]
        z = steps @ axes
        y, bounded = self._factors(points, z, state, best.value)
        y = np.log(y)
        known = np.isfinite(y)
        if np.count_nonzero(known) < max(3, count // 2):
            raise ModelError(
                f"at {count - np.count_nonzero(known)} of {count} draws of the posterior the model "
                f"has no answer at stage '{best.stage}'",
                "The fit leaves parameters so open that a band means nothing: see `geoident show`.",
            )
        band = scalar_band(z[known], y[known], many @ axes, 0.0, rng)
        lower, median, upper = np.exp(band.quantiles)
        influence = np.asarray(axes @ band.surface.coefficients[1 : 1 + axes.shape[1]])
        influence *= many.std(axis=0)
        unknown = ~(np.array(assessment.determined) | np.array(assessment.from_prior))
        felt = depends_on(names, influence)
        return replace(
            best,
            lower95=float(lower),
            median=float(median),
            upper95=float(upper),
            below_one=band.below,
            below_one_sd=band.below_sd,
            counted=int(np.count_nonzero(y[known] < 0.0)),
            surface="quadratic" if band.surface.quadratic else "linear",
            left=band.surface.left,
            undetermined=", ".join(
                n for n, open_ in zip(names, unknown, strict=True) if open_ and n in felt
            ),
            influence=influence,
            factors=np.exp(y),
            bounded=bounded,
            draws=np.array(points),
        )

    def _factors(
        self, points: Sequence[Floats], z: Floats, state: int, best: float
    ) -> tuple[Floats, Ints]:
        """Factors at some points, NaN where there is none; whether they are bounded.

        Args:
            points: d parameter vectors (n,), SI.
            z: (d, r) of the same, independent and of the size of one.
            state: its number.
            best: factor at the best values.

        Raises:
            Interrupted: a stop was asked for.
            ModelError: no process computes a factor.
        """
        control, count, first = self.control, len(points), max(_FIRST, z.shape[1] + 3)
        jobs = control.jobs
        if jobs is None:
            jobs = worthwhile_processes(self.model, self.parts.solver, count * _FACTORIZATIONS)
        found: list[FactorAtDraw] = []
        with _computing(self.model, self.parts, min(jobs, count), control) as compute:
            for some in (slice(0, first), slice(first, count)):
                guesses = _guesses(z, found, z[some], best)
                tasks = [
                    FactorTask(p, state, guess)
                    for p, guess in zip(points[some], guesses, strict=True)
                ]
                for one in compute(tasks):
                    found.append(one)
                    control.stop.check()
                    said = f"factor at draw {len(found)} of {count}"
                    control.monitor.part(said, len(found) / count)
        values = np.array([one.value for one in found])
        return values, np.array([one.bounded for one in found], int)


def _drawn(assessment: Assessment, count: int, rng: np.random.Generator) -> Floats:
    """Steps (d, n) of the scaled parameters from the estimate, from the posterior."""
    posterior = assessment.posterior
    shift = posterior.shift[:, rng.choice(len(posterior.weight), count, p=posterior.weight)]
    normal = rng.standard_normal((posterior.factor.shape[1], count))
    return np.asarray((shift + posterior.factor @ normal).T)


def _axes(steps: Floats) -> Floats:
    """(n, r) what makes independent coordinates of the size of one of steps (m, n).

    Directions in which nothing varies are left out.
    """
    sd = steps.std(axis=0)
    varies = sd > 0.0
    size = np.where(varies, sd, 1.0)
    values, vectors = np.linalg.eigh(np.atleast_2d(np.cov((steps[:, varies] / size[varies]).T)))
    kept = values > 1e-8 * values.max(initial=0.0)
    axes = np.zeros((steps.shape[1], int(np.count_nonzero(kept))))
    axes[varies] = vectors[:, kept] / np.sqrt(values[kept]) / size[varies, None]
    return axes


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

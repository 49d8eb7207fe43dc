"""What every identifier is given, and what it gives back.

The model behind a problem can be anything that answers as the protocols here ask (`Response` in
`model.response` is the least of them). Parameter vectors p are in natural units (SI), in the order
of ``names``; readings v(p) are ordered as the measured values that the identifier was given.

Identifiers work on scaled parameters x that are all of the order of one, so that one step length,
one trust radius and one tolerance serve a Young's modulus in Pa and a stress ratio alike:

    scale ``log``       x = ln p           a step of 0.1 is ten per cent of p
    scale ``linear``    x = p / r,         r = min(width, max(|start|, width / 10))

with width = upper - lower. The reference r is the size of the parameter; a tenth of the width
where the start is near zero (an angle, a tectonic stress), and the width itself where the bounds
are tighter than the parameter is large. Without finite bounds r is |start|, or 1.

The prior (theory 6) adds rows to the residuals, so that phi is the negative logarithm of the
posterior density (times two, up to a constant):

    normal      (p - mean) / sd
    lognormal   (ln p - ln mean) / (sd / mean)

Computed once: references, bounds and start in x. Per trial: elementwise maps only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np

from geoident.identify.problem.errors import Covariance, SharedErrors
from geoident.model.arrays import Bools, Floats
from geoident.model.methods import LossOptions, SquaredOptions
from geoident.model.parameter import Parameter, Prior
from geoident.model.response import BilinearSystem, Condensed, Response
from geoident.model.results.result import STOPPED, Grid, Iteration
from geoident.model.yielding import Activity, Certificate


class Scaling:
    """The map between natural parameters p (SI) and scaled parameters x (dimensionless).

    Args:
        parameters: the n unknowns.

    Attributes:
        log: (n,) the parameter is scaled by its logarithm.
        reference: (n,) reference r of linear parameters, SI; 1 for logarithmic ones.
        lower: (n,) lower bounds in x.
        upper: (n,) upper bounds in x.
        start: (n,) start in x, inside the bounds.
        priors: index and prior of the k parameters that have one.

    >>> from geoident.model.parameter import Parameter
    >>> scaling = Scaling([Parameter("K0", start=1.0, lower=0.5, upper=3.0)])
    >>> scaling.to_natural(scaling.start)
    array([1.])
    """

    def __init__(self, parameters: Sequence[Parameter]) -> None:
        self.log: Bools = np.array([q.scale == "log" for q in parameters], dtype=np.bool_)
        self.reference: Floats = np.array([_reference(q) for q in parameters], dtype=np.float64)
        self._natural_lower: Floats = np.array([q.lower for q in parameters], dtype=np.float64)
        self._natural_upper: Floats = np.array([q.upper for q in parameters], dtype=np.float64)
        self.lower: Floats = self._scale(self._natural_lower)
        self.upper: Floats = self._scale(self._natural_upper)
        self.start: Floats = self.to_scaled(np.array([q.start for q in parameters], dtype=float))
        self.priors: tuple[tuple[int, Prior], ...] = tuple(
            (i, q.prior) for i, q in enumerate(parameters) if q.prior is not None
        )

    def __len__(self) -> int:
        return int(self.reference.shape[0])

    def clip(self, x: Floats) -> Floats:
        """The nearest x (n,) inside the bounds."""
        return np.clip(x, self.lower, self.upper)

    def to_scaled(self, p: Floats) -> Floats:
        """Scaled x (n,) of natural p (n,), SI; p outside the bounds is clipped."""
        return self._scale(np.clip(p, self._natural_lower, self._natural_upper))

    def to_natural(self, x: Floats) -> Floats:
        """Natural p (n,), SI, of scaled x (n,); exact on the bounds, never outside."""
        p = x * self.reference
        p[self.log] = np.exp(x[self.log])
        p[x <= self.lower] = self._natural_lower[x <= self.lower]
        p[x >= self.upper] = self._natural_upper[x >= self.upper]
        return np.clip(p, self._natural_lower, self._natural_upper)

    def away(self, p: Floats, step: Floats) -> Floats:
        """Natural p (n,) at steps (n,) in x from p (n,), never outside the bounds."""
        with np.errstate(over="ignore"):
            moved = np.where(self.log, p * np.exp(step), p + step * self.reference)
        return np.clip(moved, self._natural_lower, self._natural_upper)

    def slope(self, p: Floats) -> Floats:
        """dp/dx (n,), the diagonal, SI: a Jacobian in p times it is the Jacobian in x."""
        return np.where(self.log, p, self.reference)

    def prior_residuals(self, p: Floats) -> Floats:
        """Rows (k,) that the priors add to the weighted residuals, dimensionless.

        Infinite where a lognormal prior excludes p.
        """
        return np.array([_prior_residual(prior, p[i]) for i, prior in self.priors], dtype=float)

    def prior_jacobian(self, p: Floats) -> Floats:
        """Derivative of `prior_residuals` in x, (k, n)."""
        rows = np.zeros((len(self.priors), len(self)))
        slope = self.slope(p)
        for row, (i, prior) in zip(rows, self.priors, strict=True):
            row[i] = _prior_slope(prior, p[i]) * slope[i]
        return rows

    def _scale(self, p: Floats) -> Floats:
        x = p / self.reference
        with np.errstate(divide="ignore"):
            x[self.log] = np.log(p[self.log])
        return x


def _reference(parameter: Parameter) -> float:
    """The size of a linear parameter, SI; 1 for a logarithmic one."""
    if parameter.scale == "log":
        return 1.0
    size = abs(parameter.start)
    width = parameter.upper - parameter.lower
    if not np.isfinite(width) or width <= 0.0:
        return size or 1.0
    return min(width, max(size, 0.1 * width))


def _prior_residual(prior: Prior, p: float) -> float:
    if prior.kind == "normal":
        return (p - prior.mean) / prior.sd
    return float(np.log(p / prior.mean)) * prior.mean / prior.sd if p > 0.0 else -np.inf


def _prior_slope(prior: Prior, p: float) -> float:
    """Derivative of the prior's residual in p, 1/SI."""
    return 1.0 / prior.sd if prior.kind == "normal" else prior.mean / (prior.sd * p)


@runtime_checkable
class AffineElastic(Response, Protocol):
    """A model whose equations are affine in its parameters: condensation needs this."""

    def obstacle(self) -> str | None:
        """Why the equations are not affine in the parameters, a sentence, or None if they are."""

    def condense(self, p: Floats, measured: Floats, sd: Floats) -> Condensed:
        """Condensed equations at p (theory 4.1).

        Args:
            p: (n,) parameters.
            measured: (g,) readings, SI.
            sd: (g,) their standard deviations, SI; where readings share errors, the matrix (g, g)
                that makes their errors independent and of size one.
        """


@runtime_checkable
class HasIncrements(Response, Protocol):
    """A model that says what each stage adds to its readings: a model error needs this."""

    def increments(self, p: Floats) -> Floats:
        """(n_states, n_channels) what the step of each state changes in what all channels see.

        Args:
            p: (n,) parameters.
        """


@runtime_checkable
class HasEvaluated(Response, Protocol):
    """A model that remembers what it was asked: to ask the same again costs nothing."""

    def evaluated(self) -> Sequence[Floats]:
        """Parameter vectors (n,) that this run has evaluated with derivatives, in their order."""


@runtime_checkable
class HasDifferences(Response, Protocol):
    """A model whose derivatives are differences, good enough to search by until they decide."""

    def sharpen(self, p: Floats) -> bool:
        """Make the Jacobian at p (n,) as good as it can be; whether it was not before."""


@runtime_checkable
class HasNoise(Response, Protocol):
    """A model whose readings are not quite smooth in the parameters: few digits, iterations."""

    @property
    def noise(self) -> Floats:
        """(g,) standard deviation of what is not smooth, as far as it is known; 0 if it is not."""


class OpeningForm(Response, Protocol):
    """The closed form of an opening: readings by formulas."""

    @property
    def covered(self) -> Bools:
        """(g,) which readings of the model it answers; ``readings`` are these, in their order."""

    def remarks(self, p: Floats) -> tuple[str, ...]:
        """What is to be known of it at p (n,), sentences without a full stop."""


@runtime_checkable
class HasOpening(Response, Protocol):
    """A model that may be a circular opening in uniform ground: closed-form needs this."""

    def opening(
        self, centre: tuple[float, float] | None, radius: float | None
    ) -> OpeningForm | str:
        """Its closed form, or why it has none, a clause.

        Args:
            centre: of the opening, m; None to find it.
            radius: of the opening, m; None to find it.
        """


@runtime_checkable
class YieldSystem(Response, Protocol):
    """A model with yield limits, stage by stage: complementarity needs this (theory 5).

    ``readings`` and ``evaluate`` raise `geoident.errors.CollapseError` where the loads cannot be
    carried. The Jacobian is that of the active pieces; at a kink, that of the planes that the
    projection counts as active.
    """

    def yields(self) -> bool:
        """Whether any material of the model has yield limits."""

    def activity(self, p: Floats) -> Activity:
        """The yield planes at p (n,). Costs nothing where p was the last to be evaluated."""


@runtime_checkable
class ComplementaritySystem(YieldSystem, Protocol):
    """A yield system that shows its equations: full-space and global need this (theory 5)."""

    def system_obstacle(self) -> str | None:
        """Why the equations are not those of a `BilinearSystem`, a clause, or None if they are."""

    def system(self) -> BilinearSystem:
        """The equations, with readings in the order of the response."""


Observer = Callable[[Iteration], str | None]
"""Is told of every iteration; answers with a reason to stop now, or None to go on."""


@dataclass(frozen=True)
class Problem:
    """Readings to be met by a model.

    Args:
        response: the model.
        measured: (g,) readings v*, SI.
        sd: (g,) their standard deviations s, SI; the weights are 1/s^2. Of readings that share
            errors: of what each has by itself.
        parameters: the n unknowns with bounds, scale and prior; ``start`` is where to begin.
        loss: how much a large residual counts.
        shared: what readings share of their errors, or None if all are independent.
    """

    response: Response
    measured: Floats
    sd: Floats
    parameters: tuple[Parameter, ...]
    loss: LossOptions = field(default_factory=SquaredOptions)
    shared: SharedErrors | None = None

    @cached_property
    def covariance(self) -> Covariance | None:
        """Of the errors of the readings; None where they are independent."""
        return None if self.shared is None else Covariance(self.sd, self.shared)

    def whiten(self, values: Floats) -> Floats:
        """Values (g,) or (g, k) of the readings, SI, in independent standard deviations."""
        if self.covariance is not None:
            return self.covariance.whiten(values)
        return values / (self.sd if values.ndim == 1 else self.sd[:, None])

    @property
    def start(self) -> Floats:
        """(n,) where to begin, SI."""
        return np.array([q.start for q in self.parameters], dtype=np.float64)

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper bounds (n,), (n,) of the parameters, SI."""
        ends = np.array([(q.lower, q.upper) for q in self.parameters], dtype=np.float64)
        return ends.reshape(-1, 2)[:, 0], ends.reshape(-1, 2)[:, 1]

    def begun_at(self, values: Floats) -> Problem:
        """The problem with another start (n,), SI, clipped into the bounds."""
        inside = np.clip(values, *self.bounds)
        parameters = (
            replace(q, start=float(value)) for q, value in zip(self.parameters, inside, strict=True)
        )
        return replace(self, parameters=tuple(parameters))


@dataclass(frozen=True)
class LocalMinimum:
    """A minimum of the discrepancy that a search came to beside its best point.

    Args:
        values: (n,) parameters, SI.
        objective: the discrepancy there, with the prior's part.
    """

    values: Floats
    objective: float


@dataclass(frozen=True)
class Outcome:
    """Where an identifier ended.

    Args:
        values: (n,) the best parameters found, SI.
        objective: the discrepancy there, with the prior's part.
        status: ``converged``, ``not-converged`` or ``out-of-budget``.
        reason: why it stopped, a sentence; with its remedy where it did not converge.
        iterations: the history.
        grid: of a scan, else None.
        remarks: what else is to be known of how it was found, sentences without a full stop.
        certificate: what an identification of yield limits proved, else None.
        minima: the others that the search came to, lowest first.
    """

    values: Floats
    objective: float
    status: str
    reason: str
    iterations: tuple[Iteration, ...]
    grid: Grid | None = None
    remarks: tuple[str, ...] = ()
    certificate: Certificate | None = None
    minima: tuple[LocalMinimum, ...] = ()


class History:
    """Collects the iterations of one method and listens for a reason to stop.

    Args:
        method: name of the method, as users write it.
        response: the model, whose costs are noted.
        observe: is told of every iteration.

    Attributes:
        stop: the reason that the observer gave for stopping now, or None.
    """

    def __init__(self, method: str, response: Response, observe: Observer) -> None:
        self.stop: str | None = None
        self._method = method
        self._response = response
        self._observe = observe
        self._iterations: list[Iteration] = []

    @property
    def iterations(self) -> tuple[Iteration, ...]:
        """All iterations so far."""
        return tuple(self._iterations)

    def record(self, values: Floats, objective: float, *, step: float, note: str) -> None:
        """Adds an iteration.

        Args:
            values: (n,) parameters, SI.
            objective: the discrepancy there.
            step: size of the step in scaled parameters.
            note: such as ``accepted``.
        """
        number = len(self._iterations)
        counts = self._response.counts
        entry = Iteration(self._method, number, objective, values.copy(), step, counts, note)
        self._iterations.append(entry)
        self.stop = self._observe(entry) or self.stop

    def outcome(self, values: Floats, objective: float, status: str, reason: str) -> Outcome:
        """The outcome of the method, whose status and reason give way to those of a stop.

        Args:
            values: (n,) the best parameters found, SI.
            objective: the discrepancy there.
            status: of a method that was not stopped.
            reason: why it ended, a sentence.
        """
        if self.stop is not None:
            status, reason = STOPPED, self.stop
        return Outcome(values, objective, status, reason, self.iterations)

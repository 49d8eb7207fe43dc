"""Rival answers: other minima of one model, and what the readings say for a model as a whole."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

from geoident.model.arrays import Floats
from geoident.model.results.columns import Record, column


class Rivals(Record):
    """The minima that a fit came to and that are not far above the lowest: k of them, that first.

    Taken as normal distributions with these means, covariances and odds they are the posterior, as
    far as it is known without sampling it.

    Args:
        values: (k, n) parameters, SI.
        objectives: (k,) the misfit with the prior's part.
        odds: (k,) part of the posterior that each holds, by Laplace's approximation; their sum is
            one.
        covariance: (k, n, n) of the parameters around each, SI; wide where nothing determines them.
    """

    values: Floats = column(
        "minimum", "parameter", name="value", dimension="parameter", unit="SI unit of the parameter"
    )
    objectives: Floats = column("minimum", name="objective")
    odds: Floats = column("minimum")
    covariance: Floats = column("minimum", "parameter", "other")

    def __len__(self) -> int:
        return len(self.objectives)

    @property
    def settled(self) -> bool:
        """Whether the first holds so much that a 95 % interval may speak of it alone."""
        return bool(self.odds[0] >= SETTLED)


SETTLED = 0.95
"""Part of the posterior that the lowest minimum holds (odds of 19 to 1) where it is the answer."""


@dataclass(frozen=True)
class Evidence:
    """How well a model with its priors explains the readings it was fitted to (theory 12.2).

    Args:
        log_evidence: logarithm of the probability density of the readings (SI).
        log_likelihood: the same at the best parameters, which a richer model always raises.
        readings: how many took part.
    """

    log_evidence: float
    log_likelihood: float
    readings: int

    @property
    def log_occam(self) -> float:
        """Logarithm of what the readings left of the prior volume: the price of freedom."""
        return self.log_evidence - self.log_likelihood


class ModelScore(Record):
    """What speaks for and against one of several models.

    Args:
        name: of the model; of a file where it has no other.
        path: of its result.
        parameters: how many the case names.
        status: of its fit.
        objective: least misfit, with the priors.
        log_evidence: logarithm of the probability density of the readings.
        log_likelihood: the same at the best parameters.
        backtest: mean log score of the last fitted stage, predicted from those before it; NaN for
            none.
        backtested: readings of that.
        modes: coefficients of fields, which are unknowns beside the parameters.
    """

    name: str = column(name="model", title="name")
    path: str
    parameters: int
    status: str
    objective: float
    log_evidence: float
    log_likelihood: float
    backtest: float = float("nan")
    backtested: int = 0
    modes: int = 0


class ModelComparison(Record):
    """Several models of the same readings, from the simplest on.

    Args:
        models: k of them.
        chosen: number of the one that the readings ask for: the simplest that none beats clearly.
        decided: all others are clearly worse.
        readings: how many were used.
        sentences: what the readings support, in words.
    """

    models: tuple[ModelScore, ...] = column("model")
    chosen: int
    decided: bool
    readings: int
    sentences: tuple[str, ...] = column("sentence", name="sentence")

    @property
    def probabilities(self) -> tuple[float, ...]:
        """Of each model, all being as likely before the readings and one of them right."""
        top = max(model.log_evidence for model in self.models)
        parts = [exp(model.log_evidence - top) for model in self.models]
        return tuple(part / sum(parts) for part in parts)


CLEAR = 3.0
"""Difference of the logarithms of two evidences (20 to 1) from which on one model beats another."""

"""What draws of a posterior say: the result of a sample, its parameters, predictions and words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.errors import ExitCode
from geoident.identify.assessment.diagnostics import effective_sd
from geoident.identify.assessment.findings import only_prior
from geoident.identify.assessment.later_readings import simulated_readings
from geoident.identify.posterior.density import PosteriorDensity
from geoident.identify.posterior.draws import Draws
from geoident.identify.problem.problem import Problem
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.parameter import Parameter
from geoident.model.results.bands import Prediction
from geoident.model.results.costs import Counts
from geoident.model.results.findings import Finding
from geoident.model.results.posterior import LEVELS, PosteriorDraws
from geoident.model.results.result import ParameterTable, Result
from geoident.workflow.estimating.estimate import known_errors
from geoident.workflow.estimating.fields import drawn_fields
from geoident.workflow.estimating.predictions import KnownErrors
from geoident.workflow.estimating.setup import Setup
from geoident.workflow.running.answers import KeptAnswers
from geoident.workflow.running.computed import accuracies
from geoident.workflow.running.reduced_answers import ReducedAnswers

SHRUNK = 0.95
"""Standard deviation of draws by that of the prior from which on the readings tell nothing."""

POOR = "poor-fit"
POOR_FIT = (
    "The model does not fit the readings (see the findings): neither draws nor predictions are to "
    "be relied on."
)

_MOST_NUMBERS = 4_000_000  # of predicted readings in the file


@dataclass(frozen=True)
class DrawnPosterior:
    """Draws of the posterior of a fit, and all that makes a result of them.

    Args:
        fit: whose posterior it is.
        setup: its model and readings.
        problem: that it ended with.
        density: from which they are drawn.
        draws: in the parameters that the sampler sees.
        answers: of the model at all draws.
        places: (m, 2) channel and stage of the readings that they predict.
        seed: of random numbers.
        wanted: effective size at which the draws are enough.
        led: what gave some of the answers in place of the model; None for nothing.
    """

    fit: Result
    setup: Setup
    problem: Problem
    density: PosteriorDensity
    draws: Draws
    answers: KeptAnswers
    places: Ints
    seed: int
    wanted: float
    led: ReducedAnswers | None = None

    def result(self) -> Result:
        """The fit with draws in place of what a search ends with; of whom and when, as it was."""
        fit, case = self.fit, self.setup.case
        posterior = self._posterior()
        by_reduced = [] if self.led is None else [self.led.note]
        status, reason = _ending(self.draws, posterior, self.wanted)
        if status == "converged" and fit.status == POOR:
            status, reason = POOR, f"{reason} {POOR_FIT}"
        table = _parameters(fit.parameters, posterior, self.density)
        return replace(
            fit,
            kind="sample",
            status=status,
            exit_code=ExitCode.DONE if status == "converged" else ExitCode.NOT_CONVERGED,
            method=f"{posterior.sampler} sampling",
            reason=reason,
            findings=_findings(table, fit.findings),
            notes=(*granted(fit, case.parameters), *by_reduced, *case.notes),
            parameters=table,
            counts=self._counts(),
            prediction=self._prediction(posterior),
            posterior=posterior,
            varied=drawn_fields(self.setup.model, posterior.flat),
            history=(),
            fields=None,
            members=None,
            shells=None,
            interfaces=None,
            reactions=None,
            yielded=None,
            mechanism=None,
            diagnostics=None,
            evidence=None,
            rivals=None,
            certificate=None,
            convergence=(),
            settlement=(),
            reduced=None,
            sensitivity=None,
            grid=None,
        )

    def _posterior(self) -> PosteriorDraws:
        draws, problem = self.draws, self.problem
        chains, length, m = draws.x.shape
        values = self.density.natural(draws.x.reshape(-1, m)).reshape(chains, length, -1)
        every = max(1, int(np.ceil(chains * length * len(self.places) / _MOST_NUMBERS)))
        taken = np.arange(0, length, every)
        predicted = self._predicted(values[:, taken].reshape(-1, values.shape[2]))
        effective, r_hat = (np.full(len(self.density.free), np.nan) for _ in range(2))
        effective[self.density.free], r_hat[self.density.free] = draws.effective, draws.r_hat
        channels, stages = self.setup.case.channels, self.setup.case.stages
        return PosteriorDraws(
            names=tuple(q.name for q in problem.parameters),
            fields=tuple(q.field for q in problem.parameters),
            values=values,
            log_density=draws.logarithms,
            sampler=draws.sampler,
            pareto_k=draws.pareto_k,
            effective=effective,
            r_hat=r_hat,
            acceptance=draws.acceptance,
            evaluations=self.density.evaluations,
            channels=tuple(channels[i].name for i, _ in self.places.tolist()),
            stages=tuple(stages[j].name for _, j in self.places.tolist()),
            predicted=predicted.reshape(chains, len(taken), -1),
            taken=taken,
        )

    def _predicted(self, points: Floats) -> Floats:
        """Readings (k, m) that draws p (k, n) predict, with their errors."""
        unique, place = np.unique(points, axis=0, return_inverse=True)
        answers = self.answers.at(unique)
        later = np.array([answers[k].later for k in place.ravel().tolist()])
        rng = np.random.default_rng([self.seed, 1])
        known = self._errors()
        if known is None:
            sd = accuracies(self.setup.case)[tuple(self.places.T)]
            return np.asarray(later + sd * rng.standard_normal(later.shape))
        none = np.full(len(self.problem.measured), np.nan)
        used = np.array(
            [none if answers[k].used is None else answers[k].used for k in place.ravel().tolist()]
        )
        if known.possible is None:
            problem, errors = known.with_later(self.places)
            return simulated_readings(problem, used, later, errors, rng)
        # the accuracies that each draw makes likely
        weights = np.array([self.density.of_accuracies(v) for v in used])
        chosen = np.argmax(weights + rng.gumbel(size=weights.shape), axis=1)
        predicted = np.empty(later.shape)
        for number in np.unique(chosen).tolist():
            rows = chosen == number
            problem, errors = known.at_possible(number, self.places)
            predicted[rows] = simulated_readings(problem, used[rows], later[rows], errors, rng)
        return predicted

    def _errors(self) -> KnownErrors | None:
        """What used readings tell of the errors of later ones, as the loss leaves them at the fit.

        The model error grows with the steps of the model at the fit. None where nothing is shared.
        """
        fit, setup = self.fit, self.setup
        readings = fit.gauges.readings
        computed = readings.computed[readings.used]
        left = replace(self.problem, sd=effective_sd(self.problem, computed))
        survey = setup.model.survey(fit.parameters.values, fields=False, partial=True)
        nothing = np.empty((len(computed), 0))
        return known_errors(setup, left, survey, computed, nothing)

    def _prediction(self, posterior: PosteriorDraws) -> Prediction:
        shape = self.fit.gauges.computed.shape
        place = tuple(self.places.T)
        values = posterior.predicted.reshape(-1, len(self.places))
        stands = np.isfinite(values).all(axis=0)
        columns = {name: np.full(shape, np.nan) for name in ("mean", "sd", "lower95", "upper95")}
        of_all = np.full((4, len(self.places)), np.nan)
        some = values[:, stands]
        if some.shape[1]:
            of_all[:, stands] = [some.mean(axis=0), some.std(axis=0),
                                 *np.quantile(some, (LEVELS[0], LEVELS[-1]), axis=0)]  # fmt: skip
        for column, row in zip(columns.values(), of_all, strict=True):
            column[place] = row
        return Prediction(**columns)

    def _counts(self) -> Counts:
        counts = self.setup.model.counts
        return replace(counts, evaluations=self.density.evaluations)


def _parameters(
    table: ParameterTable, posterior: PosteriorDraws, density: PosteriorDensity
) -> ParameterTable:
    """The parameters as their draws have them: median, standard deviation, quantiles."""
    covariance = np.atleast_2d(np.cov(posterior.flat.T, bias=True))
    sd = posterior.sd
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = covariance / np.outer(sd, sd)
    return replace(
        table,
        values=posterior.quantiles[:, LEVELS.index(0.5)],
        sd=sd,
        lower95=posterior.quantiles[:, 0],
        upper95=posterior.quantiles[:, -1],
        at_bound=np.zeros(len(sd), dtype=np.bool_),
        determined=_shrunk(posterior, density.problem.parameters),
        covariance=covariance,
        correlation=correlation,
    )


def _shrunk(posterior: PosteriorDraws, parameters: tuple[Parameter, ...]) -> Bools:
    """(n,) the draws are clearly closer together than what was known before."""
    return np.array(
        [
            _spread(parameter, values) < SHRUNK
            for parameter, values in zip(parameters, posterior.flat.T, strict=True)
        ]
    )


def _spread(parameter: Parameter, values: Floats) -> float:
    """Standard deviation of draws by that of the prior, or of the flat density in the bounds."""
    if parameter.prior is not None:
        prior = parameter.prior
        if prior.kind == "normal":
            return float(np.std(values)) / prior.sd
        return float(np.std(np.log(values))) * prior.mean / prior.sd
    by_log = parameter.scale == "log"
    ends = np.array([parameter.lower, parameter.upper])
    values, ends = (np.log(values), np.log(ends)) if by_log else (values, ends)
    return float(np.std(values) / (np.ptp(ends) / np.sqrt(12.0))) if np.ptp(ends) > 0.0 else 0.0


def _ending(draws: Draws, posterior: PosteriorDraws, wanted: float) -> tuple[str, str]:
    """Status and reason."""
    size = posterior.least_effective
    worth = f"{posterior.n_draws} draws are worth {size:.0f} independent ones"
    if np.isfinite(posterior.pareto_k):
        sentence = f"{worth} (Pareto k {posterior.pareto_k:.2f})"
    else:
        sentence = f"{worth} (R-hat {posterior.largest_r_hat:.3f})"
    good = draws.reliable(posterior.evaluations, wanted=wanted)
    sentence += "." if good else ": do not rely on the ends of intervals."
    if draws.stopped:
        return "out-of-budget", f"{draws.stopped} {sentence}"
    return ("converged" if good else "not-converged"), sentence


_OF_DRAWS = ("not-determined", "not-separated", "only-prior", "nonlinear")
"""Findings of a fit of which the draws have their own."""


def _findings(table: ParameterTable, of_fit: Sequence[Finding]) -> tuple[Finding, ...]:
    """Those of the draws, and those of the fit that they do not replace.

    Args:
        table: the parameters as their draws have them.
        of_fit: findings of the fit.
    """
    loose = [i for i in table.named.tolist() if not table.determined[i]]
    priors = [(table.names[i], table.priors[i], table.lower[i], table.upper[i]) for i in loose]
    held = [name for name, q, lower, upper in priors if q is not None and q.narrows(lower, upper)]
    unknown = [table.names[i] for i in loose if table.names[i] not in held]
    findings = [only_prior(name) for name in held]
    if unknown:
        sentence = (
            f"{', '.join(unknown)}: the draws are as far apart as the bounds allow; the readings "
            "do not determine it alone."
        )
        findings.append(Finding("not-determined", ", ".join(unknown), sentence))
    still = {table.names[i] for i in loose}

    def stands(finding: Finding) -> bool:
        about = finding.subject.split(", ")
        return finding.kind not in _OF_DRAWS or (len(about) > 1 and bool(still & set(about)))

    return (*findings, *filter(stands, of_fit))


def granted(fit: Result, parameters: tuple[Parameter, ...]) -> list[str]:
    """What the density that is drawn from assumes.

    Args:
        fit: whose posterior it is.
        parameters: the n unknowns.
    """
    error = fit.model_error
    if error is None or error.kind != "estimated":
        return [_flat_note(parameters)]
    return [
        _flat_note(parameters),
        f"The size of the model error is that of the fit in all draws ({_percent(error.size)} of "
        f"the computed motion; its 95 % interval is {_percent(error.lower95)} to "
        f"{_percent(error.upper95)}): draws do not contain its uncertainty.",
    ]


def _flat_note(parameters: tuple[Parameter, ...]) -> str:
    """What the density is where no prior is given."""
    flat = [q for q in parameters if q.prior is None]
    parts = []
    for scale, words in (("log", "in its logarithm"), ("linear", "in its value")):
        names = [q.name for q in flat if q.scale == scale]
        if names:
            parts.append(f"{', '.join(names)} {words}")
    if not parts:
        return "All parameters have priors."
    return f"Without a prior a density is flat within the bounds: {'; '.join(parts)}."


def _percent(part: float) -> str:
    return f"{100 * part:.2g} %"

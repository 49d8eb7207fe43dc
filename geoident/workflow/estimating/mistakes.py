"""Readings and priors with a wrong sign, unit, decimal point, zero or name, and the line to write.

A number in another unit or with another sign cannot be fitted; parameters, a model error or worse
accuracies would take it up without a word. `identify.assessment.mistakes` compares what each
reading, channel, instrument, kind and file would have to be with all that remains.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import starmap

import numpy as np
import scipy.sparse as sp

from geoident.errors import InputError, ModelError, TimeIsUp
from geoident.forward.observed import ObservedModel
from geoident.identify.assessment.mistakes import Mistake, find_mistakes
from geoident.identify.problem.methods import descend
from geoident.identify.problem.outcome import Outcome
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.shared_errors import SharedErrors
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Case
from geoident.model.gauges import Channel, ReadingTable
from geoident.model.methods import ComplementarityOptions, GaussNewtonOptions, MethodOptions
from geoident.model.results.bands import NORMAL_95
from geoident.model.results.findings import Finding
from geoident.model.results.result import STOPPED
from geoident.workflow.estimating.mistake_words import MistakeWords
from geoident.workflow.estimating.setup import Setup
from geoident.workflow.estimating.suspects import groups_of, kinds_of, suspects
from geoident.workflow.running.cached_response import substituting
from geoident.workflow.running.readings import errors_of_used

_MODEL = 0.1
"""Part of a reading by which any model is off, beside the accuracy of the gauge."""
_OF_CHANNEL = 0.2
"""The same of all readings of a channel alike."""
_SMALL = 0.05
"""Part of the usual reading of its kind by which a model is off where it says next to nothing."""
_STEPS = 15
"""Most steps of a search with readings that are changed."""
_CLOSE = 1e-4
"""Estimate of the relative error in energy up to which the reduced model answers that search."""


@dataclass(frozen=True)
class MistakenReadings:
    """What is wrong with the readings of a fit.

    Args:
        findings: one for each mistake, what explains most first.
        explained: (k,) the readings that these explain, of all.
        poor: the estimate is far from what it would be without them.
    """

    findings: tuple[Finding, ...]
    explained: Bools
    poor: bool

    def __bool__(self) -> bool:
        return bool(self.findings)


def mistaken_readings(
    case: Case,
    readings: ReadingTable,
    problem: Problem,
    places: Sequence[Floats],
    model: ObservedModel,
    methods: Sequence[MethodOptions],
) -> MistakenReadings:
    """The mistakes in the readings of a case that the others show.

    Args:
        case: with the accuracies as it states them, and the places where readings are written.
        readings: all k of them.
        problem: those that are used, and the model.
        places: (n,) the estimate, SI; then others that were evaluated.
        model: is asked what gauges read at other stages, where a zero is wrong.
        methods: of the fit.
    """
    last = methods[-1]
    steps = (
        last
        if isinstance(last, ComplementarityOptions)
        else GaussNewtonOptions(tolerance=1e-5, max_iterations=_STEPS, starts=1)
    )

    def refit(changed: Problem) -> Floats | None:
        try:
            return descend(changed, steps, lambda _: None).values
        except (ModelError, InputError):
            return None

    mistakes: tuple[Mistake, ...] = ()
    with suppress(TimeIsUp, ModelError), substituting(problem.response, _CLOSE):
        mistakes = find_mistakes(
            replace(problem, parameters=case.parameters),
            partial(_errors, case, readings),
            places,
            suspects(case, readings),
            refit,
        )
    rows = np.flatnonzero(readings.used)
    explained = np.zeros(len(readings), dtype=np.bool_)
    for mistake in mistakes:
        for one in (mistake, *mistake.rivals):
            explained[rows[one.suspects.rows]] = True
    words = MistakeWords(case, readings, rows, model)
    return MistakenReadings(
        tuple(words.finding(mistake) for mistake in mistakes),
        explained,
        any(
            len(mistake.released) or np.abs(mistake.shift).max(initial=0.0) > NORMAL_95
            for mistake in mistakes
        ),
    )


def mistakes_of_fit(
    stated: Case, setup: Setup, problem: Problem, outcome: Outcome, methods: Sequence[MethodOptions]
) -> MistakenReadings:
    """The mistakes in the readings of a case that was fitted; none if the search was cut short.

    Args:
        stated: the case as it was read: estimated accuracies have grown with a mistake, those of
            mesh and surfaces have not.
        setup: its model, and what was estimated of its errors.
        problem: that was solved.
        outcome: of that.
        methods: by which.
    """
    if outcome.status == STOPPED:
        return MistakenReadings((), np.zeros(len(setup.readings), dtype=np.bool_), poor=False)
    channels = zip(stated.channels, setup.case.channels, strict=True)
    case = replace(setup.case, channels=tuple(starmap(_with_numerical_errors, channels)))
    places = [outcome.values, *(one.values for one in outcome.iterations[:1])]
    return mistaken_readings(case, setup.readings, problem, places, setup.model, methods)


def _with_numerical_errors(stated: Channel, fitted: Channel) -> Channel:
    """A channel with the errors of mesh, steps and response surfaces that another has."""
    parts = fitted.errors
    if parts is None or not (parts.mesh or parts.steps or parts.surface):
        return stated
    errors = stated.error_parts
    errors = replace(errors, mesh=parts.mesh, steps=parts.steps, surface=parts.surface)
    return replace(stated, errors=errors)


def _errors(
    case: Case, readings: ReadingTable, measured: Floats, computed: Floats
) -> tuple[Floats, SharedErrors]:
    """The errors of the used readings as stated, with what any model is off by.

    Estimated accuracies and model errors have grown with the mistake that is looked for.
    """
    both = np.minimum(np.abs(measured), np.abs(computed))
    usual = np.zeros_like(both)
    for rows in groups_of(kinds_of(case, readings)).values():
        usual[rows] = float(np.median(both[rows]))
    sd, shared = errors_of_used(case, readings.used).stated
    sd = np.hypot(sd, np.maximum(_MODEL * both, _SMALL * usual))
    channels = groups_of([readings.channel[k] for k in np.flatnonzero(readings.used)])
    column = np.zeros(len(both), dtype=np.int64)
    for n, rows in enumerate(channels.values()):
        column[rows] = n
    size = _OF_CHANNEL * np.copysign(both, computed)
    model = sp.csr_array((size, (np.arange(len(both)), column)), (len(both), len(channels)))
    columns = model if shared is None else sp.csr_array(sp.hstack([shared.columns, model]))
    return sd, SharedErrors(columns)

"""Which of several models of the same readings these ask for (theory 12.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, isfinite

import numpy as np

from geoident.errors import Fault, InputError, Location, Term
from geoident.identify.assessment.findings import join
from geoident.model.results.result import Result
from geoident.model.results.rivals import CLEAR, ModelComparison, ModelScore

_SHOWN = 4
"""Readings that differ and are named, of each kind."""

_SAME = 1e-9
"""Relative difference up to which two values are one reading."""

Key = tuple[str, str, float]
"""Channel, stage and time of a reading."""


@dataclass(frozen=True)
class Candidate:
    """A fit to be compared.

    Args:
        name: what people call its model.
        path: of its file.
        result: what it holds.
    """

    name: str
    path: str
    result: Result


def compared(candidates: Sequence[Candidate], *, in_order: bool = False) -> ModelComparison:
    """What speaks for each model, and which one the readings ask for.

    Args:
        candidates: at least two fits.
        in_order: they come from the simplest on; else that with fewer parameters is the simpler.

    Raises:
        InputError: they are no fits, without evidence, or of different readings.
    """
    faults = [fault for one in candidates for fault in _unusable(one)]
    if not faults:
        for other in candidates[1:]:
            faults += _other_readings(candidates[0], other)
    if faults:
        raise InputError(faults)
    models = [_score(candidate) for candidate in candidates]
    if not in_order:
        models.sort(key=lambda model: model.parameters + model.modes)
    evidence = np.array([model.log_evidence for model in models])
    chosen = int(np.flatnonzero(evidence >= evidence.max() - CLEAR)[0])
    others = np.delete(evidence, chosen)
    decided = bool(np.all(evidence[chosen] - others >= CLEAR))
    first = candidates[0].result.evidence
    assert first is not None
    sentences = tuple(support_sentences(models, chosen))
    return ModelComparison(tuple(models), chosen, decided, first.readings, sentences)


def _unusable(one: Candidate) -> list[Fault]:
    result, place = one.result, Location(one.path)
    if result.kind != "fit":
        hint = f"Compare results of {Term.FIT}."
        message = f"a result of {result.kind}; a fit is expected"
        return [Fault("not-a-fit", message, hint, place)]
    if result.evidence is None:
        hint = f"Run {Term.FIT} again, until it converges."
        why = "its search did not converge" if result.status != "converged" else "an older version"
        message = f"it has no evidence of its model ({why})"
        return [Fault("no-evidence", message, hint, place)]
    return []


def _other_readings(first: Candidate, other: Candidate) -> list[Fault]:
    """A fault that names what one was fitted to and the other was not."""
    one, two = _used(first.result), _used(other.result)
    changed = [key for key in one if key in two and not _alike(one[key], two[key])]
    parts = []
    if only := [key for key in one if key not in two]:
        parts.append(f"only {first.name} was fitted to {_some(only)}")
    if only := [key for key in two if key not in one]:
        parts.append(f"only {other.name} to {_some(only)}")
    if changed:
        parts.append(f"the values of {_some(changed)} differ")
    if not parts:
        return []
    hint = "Evidence is that of the same readings: fit both to them (fit.stages, bad, readings)."
    message = f"it was fitted to other readings than {first.name}: {'; '.join(parts)}"
    return [Fault("other-readings", message, hint, Location(other.path))]


def _used(result: Result) -> dict[Key, list[float]]:
    """Channel, stage and time of the used readings to their values, sorted, SI."""
    table = result.gauges.readings
    values: dict[Key, list[float]] = {}
    for k in np.flatnonzero(table.used).tolist():
        time = float(table.time[k])
        key = (table.channel[k], table.stage[k], time if isfinite(time) else -1.0)
        values.setdefault(key, []).append(float(table.value[k]))
    return {key: sorted(of_key) for key, of_key in values.items()}


def _alike(one: list[float], two: list[float]) -> bool:
    size = max(map(abs, (*one, *two)), default=0.0)
    return len(one) == len(two) and bool(np.allclose(one, two, rtol=_SAME, atol=_SAME * size))


def _some(keys: Sequence[Key]) -> str:
    names = list(dict.fromkeys(f"{channel} at {stage}" for channel, stage, _ in keys))
    more = len(names) - _SHOWN
    return join(names) if more <= 0 else f"{', '.join(names[:_SHOWN])} and {more} more"


def _score(one: Candidate) -> ModelScore:
    result = one.result
    assert result.evidence is not None
    named = len(result.parameters.named)
    last = result.backtest  # of a series models may have been tested from different stages on
    scores = last.next if last is not None and last.reach is None else None
    return ModelScore(
        name=one.name,
        path=one.path,
        parameters=named,
        status=result.status,
        objective=result.objective,
        log_evidence=result.evidence.log_evidence,
        log_likelihood=result.evidence.log_likelihood,
        backtest=float("nan") if scores is None else scores.log_score,
        backtested=0 if scores is None else scores.readings,
        modes=len(result.parameters.names) - named,
    )


def support_sentences(models: Sequence[ModelScore], chosen: int) -> list[str]:
    """What the readings support, from the evidence; and whether the backtest agrees.

    Args:
        models: in the order of their simplicity.
        chosen: number of the simplest one of those that the readings cannot tell apart.
    """
    best = models[chosen]
    others = [model for model in models if model is not best]
    beaten = [m for m in others if best.log_evidence - m.log_evidence >= CLEAR]
    equal = [m for m in others if m not in beaten]
    sentences = []
    if not equal:
        nearest = max(beaten, key=lambda model: model.log_evidence)
        sentences.append(
            f"The readings support {best.name}: {_odds(best, nearest)} against {nearest.name}"
            + (", the next best." if len(beaten) > 1 else ".")
        )
    else:
        names = join([best.name, *(model.name for model in equal)])
        rival = max(equal, key=lambda model: model.log_evidence)
        gap = rival.log_evidence - best.log_evidence
        sentences.append(
            f"The readings do not decide between {names} (log Bayes factor {gap:+.1f} for "
            f"{rival.name}; it takes {CLEAR:g}, odds of 20 to 1): {best.name} is the simpler and "
            "is preferred."
        )
        sentences += [
            f"They speak against {model.name}: {_odds(best, model)} for {best.name}."
            for model in beaten
        ]
    if best.status == "poor-fit":
        all_poor = all(model.status == "poor-fit" for model in models)
        sentences.append(
            "None of them meets the readings within their errors: the best of them is still wrong."
            if all_poor
            else f"{best.name} does not meet the readings within their errors."
        )
    return sentences + _backtested(models, best)


def _odds(one: ModelScore, other: ModelScore) -> str:
    gap = one.log_evidence - other.log_evidence
    odds = f"{exp(gap):.2g} to 1" if gap < np.log(1e4) else "over 10 000 to 1"
    return f"odds of {odds} (log Bayes factor {gap:.1f})"


def _backtested(models: Sequence[ModelScore], chosen: ModelScore) -> list[str]:
    """What the backtest adds, where the readings of the last stage were predicted by all."""
    scored = [model for model in models if isfinite(model.backtest)]
    if chosen not in scored or len(scored) < 2:
        return []
    best = max(scored, key=lambda model: model.backtest)
    gain = best.backtest - chosen.backtest
    if best is chosen:
        return [f"The backtest agrees: {chosen.name} predicts the last fitted stage best."]
    if gain * min(best.backtested, chosen.backtested) < CLEAR:
        return [f"The backtest does not contradict: {best.name} predicts hardly better."]
    return [
        f"The backtest favours {best.name}: its predictions of the last fitted stage have a log "
        f"score higher by {gain:.2g} a reading ({best.backtested} readings)."
    ]

"""Residuals that go together along a series, an instrument or a profile: a finding with its remedy.

Accuracies that are estimated, or a factor on them, would take them for scatter, and bands of what
comes next would be too narrow.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.identify.assessment.neighbours import Neighbours, neighbours
from geoident.identify.problem.problem import Problem
from geoident.model.arrays import Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import DAY, Channel, ReadingTable, named_channels
from geoident.model.results.findings import Finding
from geoident.workflow.estimating.diagnosis import at_used
from geoident.workflow.estimating.model_error import ENOUGH
from geoident.workflow.estimating.model_error_covariance import has_dates, stage_clock

SURE = 0.01
"""Chance below which residuals go together."""

CLEAR = 0.3
"""Correlation of neighbours from which on it is said."""

LONG = 6
"""Readings from which on neighbours of a channel, or of an instrument, are looked at."""

_OF_ERRORS = 0.5
"""Root mean square of the residuals, in accuracies, below which they are of no importance."""


@dataclass(frozen=True)
class _Line:
    """Places that follow each other.

    Args:
        places: (m,) their numbers, in their order.
        along: (m,) where they are: s, or stages; m, or numbers of channels.
    """

    places: Ints
    along: Floats


def correlated_findings(
    case: Case, problem: Problem, values: Floats, readings: ReadingTable
) -> tuple[Finding, ...]:
    """A finding for residuals that go together in time, and one for those along instruments.

    Args:
        case: of the readings.
        problem: the used readings, with all errors that the fit assumes.
        values: (n,) the estimate, SI.
        readings: all, with what the model says of each there.
    """
    pairs = readings.used_pairs
    known = list(dict.fromkeys(pairs))
    number = {pair: n for n, pair in enumerate(known)}
    places = np.array([number[pair] for pair in pairs], dtype=np.int64)
    computed, jacobian = at_used(readings)
    found = []
    for lines, words in ((_in_time, _time_words), (_along, _length_words)):
        chosen = list(lines(case, known))
        if not chosen:
            continue
        steps = [np.stack([one.places[:-1], one.places[1:]], axis=1) for one in chosen]
        together = neighbours(problem, values, computed, jacobian, places, np.concatenate(steps))
        size = np.sqrt(np.mean(together.residuals**2))
        if together.chance < SURE and together.correlation > CLEAR and size > _OF_ERRORS:
            found.append(_finding(case, known, chosen, together, words))
    return tuple(found)


def _in_time(case: Case, known: Sequence[tuple[str, str]]) -> Iterator[_Line]:
    """The readings of each channel from stage to stage."""
    at = dict(zip(case.stage_names, stage_clock(case).tolist(), strict=True))
    of_channel: dict[str, list[int]] = {}
    for n, (name, _) in enumerate(known):
        of_channel.setdefault(name, []).append(n)
    for rows in of_channel.values():
        yield from _line(rows, [at[known[n][1]] for n in rows])


def _along(case: Case, known: Sequence[tuple[str, str]]) -> Iterator[_Line]:
    """The channels of each instrument, or of a profile, at each stage."""
    channels = {channel.name: channel for channel in case.channels}
    order = {name: n for n, name in enumerate(channels)}
    lines: dict[tuple[str, str, str], list[int]] = {}
    for n, (name, stage) in enumerate(known):
        channel = channels[name]
        lines.setdefault((channel.gauge, channel.run or channel.quantity, stage), []).append(n)
    for rows in lines.values():
        rows.sort(key=lambda n: order[known[n][0]])
        yield from _line(rows, _distances([channels[known[n][0]] for n in rows]).tolist())


def _distances(channels: Sequence[Channel]) -> Floats:
    """(m,) m along the points of channels; their numbers where they have no place."""
    if not all(channel.second for channel in channels):
        return np.arange(len(channels), dtype=np.float64)
    points = np.array([channel.second for channel in channels])
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _line(rows: Sequence[int], along: Sequence[float]) -> Iterator[_Line]:
    """One line, where it is long enough, in the order of where its places are."""
    if len(rows) >= LONG:
        order = np.argsort(along, kind="stable")
        yield _Line(np.array(rows)[order], np.array(along)[order])


def _finding(
    case: Case,
    known: Sequence[tuple[str, str]],
    lines: Sequence[_Line],
    together: Neighbours,
    words: Callable[[Case, float, str], tuple[str, str]],
) -> Finding:
    """What is said of residuals that go together.

    Args:
        case: of the readings.
        known: channel and stage of each place.
        lines: of places.
        together: what is known of them.
        words: the direction and the remedy, from the mean length of runs of one sign.
    """
    signs = [np.sign(together.residuals[line.places]) for line in lines]
    alike = sum(int(np.sum(sign[1:] == sign[:-1])) for sign in signs)
    count = sum(len(sign) - 1 for sign in signs)
    runs = sum(1 + int(np.sum(sign[1:] != sign[:-1])) for sign in signs)
    length = sum(float(line.along[-1] - line.along[0]) for line in lines) / runs
    names = list(dict.fromkeys(known[n][0] for line in lines for n in line.places.tolist()))
    size = "" if _estimable(case, known) else "size: 15 %, "
    way, remedy = words(case, length, size)
    sentence = (
        f"Residuals of {named_channels(names)} come in runs of one sign {way}: {alike} of {count} "
        f"neighbours have the same sign (correlation {together.correlation:.2f}, by chance "
        f"{_by_chance(together.chance)}). Less accurate gauges would scatter instead: here the "
        f"model differs from the ground, and bands are too narrow as long as this counts as "
        f"scatter. {remedy}"
    )
    numbers = {"correlation": together.correlation, "chance": together.chance}
    return Finding("correlated-residuals", ", ".join(names), sentence, numbers)


def _estimable(case: Case, known: Sequence[tuple[str, str]]) -> bool:
    unknown = sum(not parameter.field for parameter in case.parameters)
    return len(known) >= unknown + ENOUGH


def _by_chance(chance: float) -> str:
    return (
        "in less than one of 1000 fits" if chance < 1e-3 else f"in one of {1.0 / chance:.0f} fits"
    )


def _time_words(case: Case, length: float, size: str) -> tuple[str, str]:
    """The direction, and the key to write, for runs of some s, or stages."""
    if has_dates(case):
        key = f"model_error: {{{size}time: {max(length / DAY, 0.01):.2g} days}}"
        return "in time", f"Write '{key}' under 'fit'."
    if case.elsewhere is not None:
        key = "model_error: 15 %" if size else "model_error: estimate"
        return "from stage to stage", f"Write '{key}' under 'fit'."
    remedy = (
        f"Give the stages 'dates' and write 'model_error: {{{size}time: 30 days}}' under 'fit'."
    )
    return "from stage to stage", remedy


def _length_words(case: Case, length: float, size: str) -> tuple[str, str]:
    """The direction, and the key to write, for runs of some m."""
    placed = any(channel.second for channel in case.channels)
    key = f"model_error: {{{size}length: {max(length, 0.01):.2g} m}}"
    if not placed:
        key = "model_error: 15 %" if size else "model_error: estimate"
    return "along the instrument", f"Write '{key}' under 'fit'."

"""Moments of the stages that last: each is a state of its own, which can be read.

A stage that lasts becomes as many stages as it has moments: the first does all that the stage does,
the others go on in time. The last one is its end and keeps its name, so that stages build on it.

A moment is called by its stage and the time since this began, ``fill 1 + 12 d``, in results and in
a case.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from geoident.model.case import VIRGIN, Case, Stage

_UNITS = (("d", 86400.0), ("h", 3600.0), ("min", 60.0), ("s", 1.0))
_STEPS = {"s": (1, 2, 5, 10, 20), "min": (1, 2, 5, 10, 20), "h": (1, 2, 5, 10)}
_DAYS = tuple(step * 10**decade for decade in range(5) for step in (1, 2, 5))
_USUAL = sorted(step * size for unit, size in _UNITS for step in _STEPS.get(unit, _DAYS))
_FIRST = 1e-3
"""The first usual moment of a stage is about this part of it: water begins to flow at once."""

_FIRST_OF_CREEP = 1e-2
"""The same where ground creeps without water: earlier moments cost steps and show little."""

CLOSE = 0.01
"""Times since the beginning of a stage that differ by less than this part are one moment."""

_NEAR = 0.1
"""A usual moment that is nearer than this part to another is left out."""


def with_moments(case: Case, moments: Mapping[str, Sequence[float]]) -> Case:
    """A case whose stages that last have states at some moments, and at their ends.

    Where a case names a stage whose readings are used, it means all its moments.

    Args:
        case: of which the moments that it has are replaced.
        moments: stage to times, s since its beginning, before its end.
    """
    stages: list[Stage] = []
    ends = {stage.whole for stage in case.stages}
    dates = {name: date for name, date in case.dates.items() if name in {*ends, VIRGIN}}
    number = list[int]()
    for n, stage in enumerate(_whole_stages(case)):
        if stage.lasts is None:
            stages.append(stage)
            number.append(n)
            continue
        times = [*sorted(set(moments.get(stage.name, ()))), stage.lasts]
        names = [*(moment_name(stage.name, time) for time in times[:-1]), stage.name]
        owners = [*(stage.name for _ in times[:-1]), None]
        stages.append(replace(stage, name=names[0], at=times[0], moment_of=owners[0]))
        for before, name, time, owner in zip(names, names[1:], times[1:], owners[1:], strict=False):
            further = Stage(name, base=before, lasts=stage.lasts, at=time, goes_on=True)
            further = replace(further, over=stage.over, independent=stage.independent)
            stages.append(replace(further, moment_of=owner))
        number += [n] * len(names)
        if stage.name in dates:
            begin = dates[stage.name] - stage.lasts
            dates |= {name: begin + time for name, time in zip(names, times, strict=True)}
    fitted = case.fit.stages
    if fitted is not None:
        fitted = tuple(one.name for one in stages if {one.name, one.moment_of} & {*fitted})
    return replace(
        case,
        stages=tuple(stages),
        dates=dates,
        fit=replace(case.fit, stages=fitted),
        source=replace(case.source, stages=tuple(number)),
    )


def with_states(case: Case, states: Collection[str]) -> Case:
    """A case with the moments that some states are by their names, such as those of a result.

    Args:
        case: of which the moments that it has are replaced.
        states: names of stages and moments; those of stages that do not last count for nothing.
    """
    lasting = {stage.whole for stage in case.stages if stage.lasts is not None}
    if not lasting:
        return case
    moments: dict[str, list[float]] = {}
    for name in states:
        parts = stage_and_time(name, lasting)
        if parts is not None:
            number, unit = parts[1].split()
            moments.setdefault(parts[0], []).append(float(number) * dict(_UNITS)[unit])
    return with_moments(case, moments)


def _whole_stages(case: Case) -> list[Stage]:
    """The stages of a case without their moments."""
    return [
        replace(stage, name=stage.whole, at=None, moment_of=None)
        for stage in case.stages
        if not stage.goes_on
    ]


def moment_name(stage: str, time: float) -> str:
    """The name of a moment of a stage.

    >>> moment_name("fill", 12 * 86400.0), moment_name("fill", 5400.0), moment_name("fill", 0.0)
    ('fill + 12 d', 'fill + 1.5 h', 'fill + 0 d')

    Args:
        stage: its name.
        time: s since the beginning of the stage.
    """
    return f"{stage} + {time_text(time)}"


def time_text(time: float) -> str:
    """A time in s as people write it, with six digits in the largest unit that is below it."""
    unit, size = next(((u, s) for u, s in _UNITS if time >= s), _UNITS[0 if time == 0.0 else -1])
    return f"{time / size:.6g} {unit}"


def rounded(time: float) -> float:
    """A time, s, as its text says it."""
    number, unit = time_text(time).split()
    return float(number) * dict(_UNITS)[unit]


def stage_and_time(name: str, stages: Collection[str]) -> tuple[str, str] | None:
    """The stage and the text of the time of which the name of a moment is made; None for neither.

    >>> stage_and_time("fill 1 + 12 d", ["fill", "fill 1"])
    ('fill 1', '12 d')
    >>> stage_and_time("fill 2 + 12 d", ["fill 1"])
    """
    stage, plus, time = name.rpartition("+")
    stage = stage.strip()
    return (stage, time.strip()) if plus and stage in stages and name not in stages else None


def usual_moments(lasts: float, *, water: bool) -> tuple[float, ...]:
    """Times in a stage for predictions and pictures, s: about three in a decade.

    >>> [time_text(time) for time in usual_moments(90 * 86400.0, water=True)]
    ['5 h', '10 h', '1 d', '2 d', '5 d', '10 d', '20 d', '50 d']

    Args:
        lasts: how long it lasts, s.
        water: whether water flows in it.
    """
    first = lasts * (_FIRST if water else _FIRST_OF_CREEP)
    return tuple(time for time in _USUAL if first < time < lasts * (1.0 - _NEAR))


def chosen_moments(
    lasts: float, read: Sequence[float], stated: Sequence[float], shown: Sequence[float]
) -> tuple[float, ...]:
    """The moments of a stage, s since its beginning, ascending, before its end.

    Readings at times that differ by less than a hundredth are of one moment, in their middle.

    Args:
        lasts: how long the stage lasts, s.
        read: times at which something was read.
        stated: times that the case names.
        shown: times for predictions, as far as there are no others near them.
    """
    fixed = sorted({rounded(time) for time in stated})
    groups: list[list[float]] = []
    for time in sorted(set(read)):
        if any(is_close(time, other) for other in (*fixed, lasts)):
            continue
        if groups and is_close(time, groups[-1][0]):
            groups[-1].append(time)
        else:
            groups.append([time])
    times = {*fixed, *(rounded(sum(group) / len(group)) for group in groups)}
    times |= {t for t in shown if all(abs(t - other) > _NEAR * t for other in (*times, lasts))}
    return tuple(sorted(time for time in times if time < lasts))


def is_close(time: float, other: float) -> bool:
    """Whether two times since the beginning of a stage are one moment."""
    return abs(time - other) <= CLOSE * min(time, other)

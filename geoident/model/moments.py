"""Moments of the stages that last: each is a state of its own, which can be read.

A stage that lasts becomes as many stages as it has moments: the first does all that the stage does,
the others go on in time. The last one is its end and keeps its name, so that stages build on it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from geoident.model.case import Case, Stage

_HOUR, _DAY = 3600.0, 86400.0


def with_moments(case: Case, moments: Mapping[str, Sequence[float]]) -> Case:
    """A case whose stages that last have states at some moments, and at their ends.

    Args:
        case: whose stages have no moments yet.
        moments: stage to times, s since its beginning, before its end.
    """
    stages: list[Stage] = []
    dates = dict(case.dates)
    for stage in case.stages:
        if stage.lasts is None:
            stages.append(stage)
            continue
        times = [*sorted(set(moments.get(stage.name, ()))), stage.lasts]
        names = [*(moment_name(stage.name, time) for time in times[:-1]), stage.name]
        stages.append(replace(stage, name=names[0], at=times[0]))
        for before, name, time in zip(names, names[1:], times[1:], strict=False):
            if stage.name in dates:
                dates[before] = dates[stage.name] - stage.lasts + times[names.index(before)]
            further = Stage(
                name, base=before, lasts=stage.lasts, over=stage.over, at=time, goes_on=True
            )
            stages.append(replace(further, independent=stage.independent))
    return replace(case, stages=tuple(stages), dates=dates)


def moment_name(stage: str, time: float) -> str:
    """The name of a moment of a stage.

    >>> moment_name("fill", 12 * 86400.0), moment_name("fill", 5400.0)
    ('fill + 12 d', 'fill + 1.5 h')

    Args:
        stage: its name.
        time: s since the beginning of the stage.
    """
    return f"{stage} + {time / _DAY:g} d" if time >= _DAY else f"{stage} + {time / _HOUR:g} h"

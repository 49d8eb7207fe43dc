"""The error of the response surfaces of a table of runs, among the errors of readings (theory 4.8).

What the surfaces do not know is an error that all readings share, with its covariance at the
parameters of the fit: as the error of the mesh it enters whatever is said of the fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geoident.forward.external.table import TableModel
from geoident.forward.observed import ObservedModel
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.gauges import Channel, ErrorParts
from geoident.model.results.findings import Finding
from geoident.model.results.surface import SurfaceTable
from geoident.units import in_unit, shown_unit

MATTERS = 0.5
"""Own error of the surfaces, in accuracies, from which on the user should add runs."""

NOTICED = 0.1
"""Likewise, from which on it is worth a word what it means."""

STEADY = 0.05
"""Relative change of the own error, beside accuracies, below which it is that of the answer."""


def with_surface_error(case: Case, model: ObservedModel, p: Floats, *, after: int = 0) -> Case:
    """A case whose channels have the error of response surfaces among what their readings share.

    Args:
        case: the case.
        model: of it; the case comes back as it is where no table answers.
        p: (n,) parameters, SI.
        after: number of such errors that belong to another table.
    """
    if not isinstance(model, TableModel):
        return case
    ratios = model.instrument_errors.ratios(model.values(p))
    root = model.error_root(p) * ratios[:, None]
    stages = [stage.name for stage in case.stages]
    return replace(
        case,
        channels=tuple(
            replace(channel, errors=_with_surface(channel, stages, root[:, j], after))
            for j, channel in enumerate(case.channels)
        ),
    )


def _with_surface(channel: Channel, stages: Sequence[str], root: Floats, after: int) -> ErrorParts:
    parts = channel.error_parts
    before = (0.0,) * after
    each = zip(stages, root.tolist(), strict=True)
    return replace(parts, surface=tuple((s, (*before, *row)) for s, row in each if any(row)))


def surface_sources(case: Case) -> int:
    """Number of the errors of response surfaces that the readings of a case share."""
    sizes = (len(row) for c in case.channels if c.errors is not None for _, row in c.errors.surface)
    return max(sizes, default=0)


def is_steady(before: Case, after: Case) -> bool:
    """Whether the own error is nearly the same in two versions of a case."""
    for old, new in zip(before.channels, after.channels, strict=True):
        sizes = [_sizes(channel) for channel in (old, new)]
        for stage, size in sizes[1].items():
            change = abs(size - sizes[0].get(stage, 0.0))
            sd = new.sd(after.reading_at(new, stage))
            if change > STEADY * max(size, NOTICED * sd):
                return False
    return True


def _sizes(channel: Channel) -> dict[str, float]:
    errors = channel.errors
    rows = errors.surface if errors is not None else ()
    return {stage: float(np.linalg.norm(row)) for stage, row in rows}


def surface_sentence(surface: SurfaceTable) -> str:
    """How well the surfaces foretell runs left out, and what they do not know at the answer."""
    k = surface.worst
    unit = surface.units[k], surface.dimensions[k]
    size = f"{in_unit(float(surface.left_out[k]), *unit):.2g} {shown_unit(*unit)}".rstrip()
    part = float(surface.left_out[k] / surface.accuracy[k])
    worst = f"{size} at {surface.channels[k]} in {surface.stages[k]}, {part:.2g} accuracies"
    sentence = (
        f"The largest leave-one-out error of the runs in {surface.file} is {worst}. "
        f"At these parameters the error of the response surfaces is on average "
        f"{surface.part:.2g} times the accuracy"
    )
    if surface.part < NOTICED:
        return f"{sentence}."
    return f"{sentence}. Intervals and bands allow for it."


def surface_findings(surface: SurfaceTable | None) -> tuple[Finding, ...]:
    """The sentence, and what to do, where the surfaces know too little."""
    if surface is None or surface.part < MATTERS:
        return ()
    more = "Runs around these parameters would narrow the intervals."
    numbers = {"part": surface.part}
    return (Finding("surface-error", "", f"{surface_sentence(surface)} {more}", numbers),)


def surface_notes(surface: SurfaceTable | None) -> tuple[str, ...]:
    """The sentence where nothing has to be done."""
    if surface is None or surface.part >= MATTERS:
        return ()
    return (surface_sentence(surface),)

"""Which gauges are read by the coordinates of a file, and along which directions."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from geoident.io.case.case import CaseSection
from geoident.io.case.site_files.file import ReadingsFileSection
from geoident.io.readings.survey import SurveyGrid, SurveyTarget
from geoident.io.text.faults import Faults
from geoident.model.case import Analysis, KeyPath
from geoident.model.gauges import Channel

KINDS = ("target", "displacement", "settlement")
"""Kinds of gauges that are motions of a point."""


def surveyed(
    described: ReadingsFileSection,
    section: CaseSection,
    channels: Iterable[Channel],
    faults: Faults,
    path: KeyPath,
) -> SurveyGrid | None:
    """The survey of a file of coordinates; None for files of other layouts.

    Args:
        described: the file.
        section: the case.
        channels: of all its gauges.
        faults: is told of gauges that are none of a point.
        path: of keys that lead to the file.
    """
    if described.layout != "coordinates" or described.transformation is None:
        return None
    wanted = dict.fromkeys(described.channels or section.gauges)
    targets: dict[str, SurveyTarget] = {}
    known = [name for name, gauge in section.gauges.items() if gauge.kind in KINDS]
    for name in wanted:
        if name in known:
            own = [channel for channel in channels if channel.gauge == name]
            relative = own[0].first is not None
            if relative and described.channels:
                message = f"'{name}' is read relative to a point; coordinates are of its own point"
                hint = "Remove 'relative_to', or give differences of both points as readings."
                key = ("gauges", name, "relative_to")
                faults.add(key, "contradiction", message, hint)
            if described.channels or not relative:
                directions = {c.name: _solid(c.direction) for c in own}
                targets[name] = SurveyTarget(directions, own[0].second)
        elif described.channels:
            hint = faults.did_you_mean(name, known, what="Gauges of points")
            message = f"there is no gauge '{name}' whose point is surveyed"
            faults.add((*path, "channels", name), "unknown-gauge", message, hint, key=True)
    points: dict[str, tuple[str, ...]] = {}
    for name, origin in described.channels.items():
        point = origin if isinstance(origin, str) else origin.name or name
        points[point] = (*points.get(point, ()), name)
    survey = described.transformation.survey(plane=Analysis(section.analysis).dim == 2)
    return replace(survey, points=points, targets=targets)


def _solid(direction: tuple[float, ...]) -> tuple[float, ...]:
    return (*direction, *(0.0,) * (3 - len(direction)))

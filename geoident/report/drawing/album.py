"""All figures of a result, in the order of the page, drawn only when they are asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from geoident.model.results.result import Labelled, Result
from geoident.report.drawing.backtest import backtest_pictures
from geoident.report.drawing.fields.isochrones import isochrone_pictures
from geoident.report.drawing.fields.mechanism import mechanism_picture
from geoident.report.drawing.fields.motion import (
    displacement_pictures,
    largest_pictures,
    moved_pictures,
)
from geoident.report.drawing.fields.strength import strength_pictures
from geoident.report.drawing.fields.stress import stress_pictures
from geoident.report.drawing.fields.temperature import temperature_pictures
from geoident.report.drawing.forces import structure_pictures
from geoident.report.drawing.gauges.course import (
    compared_gauge_pictures,
    face_pictures,
    reading_pictures,
)
from geoident.report.drawing.gauges.curves import curve_pictures
from geoident.report.drawing.gauges.profiles import profile_pictures
from geoident.report.drawing.in_service import time_pictures
from geoident.report.drawing.interfaces import interface_map_pictures, interface_pictures
from geoident.report.drawing.model.figure import model_pictures
from geoident.report.drawing.opening import advance_pictures, opening_pictures
from geoident.report.drawing.overview import overview_pictures
from geoident.report.drawing.parameters.corner import pair_pictures
from geoident.report.drawing.parameters.intervals import (
    compared_parameter_pictures,
    parameter_pictures,
)
from geoident.report.drawing.parameters.scan import scan_pictures
from geoident.report.drawing.quality import quality_pictures
from geoident.report.drawing.scene import Scene, scene_of
from geoident.report.drawing.sections import section_pictures
from geoident.report.drawing.shells import shell_pictures
from geoident.report.drawing.signs import sign_pictures
from geoident.report.drawing.solid import solid_pictures
from geoident.report.drawing.style import Picture, Progress, images
from geoident.report.drawing.updates import update_pictures
from geoident.report.drawing.varied import varied_pictures
from geoident.report.text.case import of_tests


@dataclass(frozen=True)
class Album:
    """The figures of one result by the section of the page in which they stand."""

    model: tuple[Picture, ...]
    overview: tuple[Picture, ...]
    parameters: tuple[Picture, ...]
    readings: tuple[Picture, ...]
    fields: tuple[Picture, ...]
    quality: tuple[Picture, ...]
    structures: tuple[Picture, ...]
    backtest: tuple[Picture, ...]
    updates: tuple[Picture, ...]

    @property
    def all(self) -> tuple[Picture, ...]:
        """Every figure."""
        return (
            *self.model, *self.overview, *self.parameters, *self.readings, *self.fields,
            *self.quality,
            *self.structures, *self.backtest, *self.updates,
        )  # fmt: skip


def album(result: Result, *, prefix: str = "") -> Album:
    """The figures of a result.

    Args:
        result: what to draw.
        prefix: put before the names of the figures, where several results share a page.
    """
    scene = scene_of(result)
    fields = opening_pictures(result)
    if scene is not None:
        fields = (*isochrone_pictures(scene), *varied_pictures(scene), *_field_pictures(scene))
        if result.mechanism is not None:
            factor = min((one.upper for one in result.safety), default=None)
            picture = mechanism_picture(result.mechanism, scene.axis_names, factor)
            fields = (picture, *fields)
    curves, tests = curve_pictures(result), of_tests(result)
    parts = (
        model_pictures(result),
        curves if tests else overview_pictures(result, scene),
        (*parameter_pictures(result), *pair_pictures(result), *scan_pictures(result)),
        time_pictures(result)
        if result.in_service
        else (
            *(() if tests else curves),
            *profile_pictures(result),
            *reading_pictures(result),
            *face_pictures(result),
            *advance_pictures(result),
            *(() if tests else sign_pictures(result)),
        ),
        fields,
        quality_pictures(result),
        (
            *section_pictures(result),
            *structure_pictures(result),
            *shell_pictures(result),
            *interface_pictures(result),
        ),
        backtest_pictures(result),
        update_pictures(result),
    )
    return Album(*(tuple(replace(p, name=prefix + p.name) for p in part) for part in parts))


def _field_pictures(scene: Scene) -> tuple[Picture, ...]:
    """The figures of each sheet, and of the surface of a solid."""
    kinds = (
        displacement_pictures, temperature_pictures, stress_pictures, strength_pictures,
        interface_map_pictures, moved_pictures,
    )  # fmt: skip
    every = (picture for view in scene.views for kind in kinds for picture in kind(view))
    return (*largest_pictures(scene), *every, *solid_pictures(scene))


def stage_pictures(result: Result, state: int) -> tuple[Picture, ...]:
    """The figures of the fields after one stage; none where the result has no fields.

    Args:
        result: what to draw.
        state: number of the state; 1 is that after the first stage.
    """
    scene = scene_of(result, only=state)
    return () if scene is None else _field_pictures(scene)


def comparison(results: Labelled) -> tuple[Picture, ...]:
    """The figures of several results together; none for a single one."""
    if len(results) < 2:
        return ()
    return (*compared_parameter_pictures(results), *compared_gauge_pictures(results))


def figure_files(
    results: Labelled, suffixes: Sequence[str], progress: Progress | None = None
) -> dict[str, bytes]:
    """Every figure as a file.

    Args:
        results: labels and results.
        suffixes: formats, of ``svg``, ``png`` and ``pdf``.
        progress: is told before each file.

    Returns:
        Name of the file, such as ``overview.svg``, to its bytes.
    """
    several = len(results) > 1
    pictures = list(comparison(results))
    for number, (_, result) in enumerate(results, start=1):
        pictures += album(result, prefix=f"{number}-" if several else "").all
    files = [(picture, suffix) for picture in pictures for suffix in suffixes]
    names = [f"{picture.name}.{suffix}" for picture, suffix in files]
    return dict(zip(names, images(files, progress), strict=True))

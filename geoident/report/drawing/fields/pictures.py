"""All figures of the fields of a result, sheet by sheet."""

from __future__ import annotations

from geoident.report.drawing.fields.motion import motion_pictures
from geoident.report.drawing.fields.strength import strength_pictures
from geoident.report.drawing.fields.stress import stress_pictures
from geoident.report.drawing.scene import Scene
from geoident.report.drawing.style import Picture


def field_pictures(scene: Scene) -> tuple[Picture, ...]:
    """All figures of a sheet, for each of the sheets."""
    found: list[Picture] = []
    for number, sheet in enumerate(scene.sheets, start=1):
        tag = f"section-{number}-" if scene.solid else ""
        where = f", section {sheet.plane}" if sheet.plane is not None else ""
        motion = motion_pictures(scene, sheet, tag, where)
        moved, shapes = motion[:-2], motion[-2:]
        found += [
            *moved,
            *stress_pictures(scene, sheet, tag, where),
            *strength_pictures(scene, sheet, tag, where),
            *shapes,
        ]
    return tuple(found)

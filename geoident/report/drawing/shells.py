"""What shells bear: colour maps of their forces and moments on their faces, stage by stage.

Faces that go on smoothly into each other make one map, whatever shells they belong to.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from geoident.model.arrays import Floats, Ints
from geoident.model.results.result import Result
from geoident.model.results.shells import ShellForces
from geoident.report.drawing.style import Picture, evenly, short
from geoident.report.drawing.unrolled import (
    MOST_SHEET_STAGES,
    MOST_SHEETS,
    Sheet,
    sheet_figure,
    sheets,
)

_KILO = 1e3

_NOTHING = 1e-6
"""N per metre over N m per metre: a plate bears no normal force."""


def shell_pictures(result: Result) -> tuple[Picture, ...]:
    """Normal forces and moments of each sheet of shells, the largest sheets first."""
    forces = result.shells
    if forces is None:
        return ()
    every = sheets(forces.corners, forces.axes, "shell")
    left_out = len(every) - MOST_SHEETS
    note = f" {left_out} smaller pieces of shells are not drawn." if left_out > 0 else ""
    pictures = []
    for count, sheet in enumerate(every[:MOST_SHEETS], start=1):
        names = list(dict.fromkeys(forces.structures[k] for k in sheet.faces))
        title = names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"
        stages = np.flatnonzero(np.isfinite(forces.normal[sheet.faces, 0]).any(axis=0))
        if not len(stages):
            continue
        some = f" Drawn are {MOST_SHEET_STAGES} of the {len(stages)} stages with forces."
        pictures.append(
            Picture(
                f"shell-{count}",
                f"Forces in {short(title, 60)}",
                f"{sheet.words} Per metre, means over the faces; n is positive in tension, m with "
                f"tension on the inside."
                f"{some if len(stages) > MOST_SHEET_STAGES else ''}{note}",
                partial(_figure, forces, sheet, stages[evenly(len(stages), MOST_SHEET_STAGES)]),
            )
        )
    return tuple(pictures)


def _figure(forces: ShellForces, sheet: Sheet, stages: Ints) -> Figure:
    titles = [forces.stages[stage] for stage in stages]
    return sheet_figure(sheet, _rows(forces, sheet, stages), titles)


def _rows(forces: ShellForces, sheet: Sheet, stages: Ints) -> Mapping[str, Floats]:
    """The forces (n_faces, n_stages) that are drawn, kN/m and kNm/m, by their names."""
    normal, moment = (
        each[sheet.faces][:, :, stages] / _KILO for each in (forces.normal, forces.moment)
    )
    bears = np.nanmax(np.abs(normal)) > _NOTHING * np.nanmax(np.abs(moment))
    rows = {f"n_{part} (kN/m)": normal[:, k] for k, part in enumerate(("11", "22")) if bears}
    return rows | {f"m_{part} (kNm/m)": moment[:, k] for k, part in enumerate(("11", "22"))}

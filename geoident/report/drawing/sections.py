"""N and M of walls, linings and shells against what their sections bear."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from geoident.model.arrays import Floats
from geoident.model.parameter import Values
from geoident.model.results.result import Result
from geoident.model.results.sections import SectionUse, section_uses
from geoident.model.structures import Beam, Shell
from geoident.report.drawing.scene import case_of
from geoident.report.drawing.style import Picture, colour, evenly, marker, short

_MOST_STAGES = 8
_KILO = 1e3
_PARTS = np.linspace(-1.0, 1.0, 61)
"""Of the way from the largest push to the largest pull."""


def section_pictures(result: Result) -> tuple[Picture, ...]:
    """A picture for each structure whose strength the case gives."""
    uses = section_uses(result.members, result.shells)
    case = case_of(result) if uses else None
    if case is None:
        return ()
    values = dict(zip(result.parameters.names, result.parameters.values.tolist(), strict=True))
    pictures: list[Picture] = []
    for name in dict.fromkeys(use.structure for use in uses):
        structure = case.structures[name]
        own = [use for use in uses if use.structure == name]
        curve = _limit_curve(structure, values) if isinstance(structure, Beam | Shell) else None
        if curve is None:
            continue
        n = int(np.isfinite(own[0].axial).any(axis=0).sum())
        dots = f"all faces, {', '.join(use.direction for use in own)}"
        dots = dots if own[0].direction else "all pieces, at the end with the larger moment"
        some = f" Drawn are {_MOST_STAGES} of the {n} stages with forces." * (n > _MOST_STAGES)
        pictures.append(
            Picture(
                f"strength-{len(pictures) + 1}",
                f"N and M of {name} against its strength",
                f"Line: what the section bears. Dots: {dots}; beyond the line the strength is "
                f"exceeded.{some}",
                partial(_figure, own, curve),
            )
        )
    return tuple(pictures)


def _limit_curve(structure: Beam | Shell, values: Values) -> tuple[Floats, Floats] | None:
    """N and M that use up a section, tension positive, N/m and N; None where either has no limit.

    Its strengths for the report come before its yield limits.
    """
    given, part = structure.limits if isinstance(structure, Beam) else None, _PARTS
    compressive, tensile = structure.compressive_strength, structure.tensile_strength
    if compressive is None and given is not None and given.compressive_strength is not None:
        compressive = given.compressive_strength.value(values)
        tensile = given.tensile_strength.value(values)
    if compressive is not None and structure.thickness is not None:
        h = structure.thickness.value(values)
        middle, half = 0.5 * (tensile - compressive) * h, 0.5 * (tensile + compressive) * h
        return middle + half * part, 0.25 * half * h * (1.0 - part**2)
    if given is None or given.N is None or given.M is None:
        return None
    curve = {"section": 1.0 - part**2, "linear": 1.0 - np.abs(part), "none": np.ones(len(part))}
    return given.N.value(values) * part, given.M.value(values) * curve[given.interaction]


def _figure(uses: Sequence[SectionUse], curve: tuple[Floats, Floats]) -> Figure:
    """The limit of a section, and N and M of a structure, compression upwards."""
    axial, moment = curve
    figure = Figure(figsize=(5.0, 3.6))
    axes = figure.subplots()
    limit = np.r_[moment, -moment[::-1], moment[0]], np.r_[axial, axial[::-1], axial[0]]
    axes.plot(limit[0] / _KILO, limit[1] / _KILO, color="black", lw=1.3)
    n, m = (
        np.concatenate([getattr(use, name) for use in uses]) / _KILO for name in ("axial", "moment")
    )
    stages = np.flatnonzero(np.isfinite(n).any(axis=0))
    for k, stage in enumerate(stages[evenly(len(stages), _MOST_STAGES)].tolist()):
        axes.plot(m[:, stage], n[:, stage], ls="", marker=marker(k), ms=3.5, color=colour(k),
                  alpha=0.8, label=short(uses[0].stages[stage], 24))  # fmt: skip
    axes.invert_yaxis()
    axes.set_xlabel("M (kNm/m)")
    axes.set_ylabel("N (kN/m, tension positive)")
    axes.grid(visible=True)
    figure.legend(loc="outside right upper")
    return figure

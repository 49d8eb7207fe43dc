"""An advancing tunnel face: the profile by which its wall moves, stages and first readings."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from geoident.model.results.opening import FaceAdvance
from geoident.model.results.result import Result
from geoident.report.drawing.labels import place_labels
from geoident.report.drawing.style import ACCENT, COMPUTED, FAINT, MEASURED, Picture, key, short

_LOST = "#e4e4e4"


def advance_pictures(result: Result) -> tuple[Picture, ...]:
    """The profile with the stages on it; none for a case without distances to a face."""
    found = result.advance
    if found is None or not found.stages:
        return ()
    lost = ""
    if found.lost is not None:
        lost = f" Grey: the {100.0 * found.lost:.3g} % of the motion before the first gauges read "
        lost += "zero (dashed)."
    caption = (
        "Line: part of its final motion that the wall without support has made, by the distance of "
        "its section behind the face; dots: the stages. Squares: part of the stress that is "
        f"released at each of them.{lost}"
    )
    title = "Motion of the wall and released stress as the face goes on"
    return (Picture("face-profile", title, caption, lambda: advance_figure(found)),)


def advance_figure(found: FaceAdvance) -> Figure:
    """The profile over the distance, the stages, what they release, and where gauges read zero."""
    figure = Figure(figsize=(7.2, 3.6))
    axes = figure.subplots()
    axes.plot(found.distance, 100.0 * found.share, color=COMPUTED, lw=1.4)
    x, share, released = found.stage_distance, 100.0 * found.stage_share, found.stage_released
    axes.plot(x, share, "o", color=MEASURED, ms=4.5)
    axes.plot(x, 100.0 * released, "s", color=ACCENT, ms=4.0, mfc="white")
    axes.axvline(0.0, color=FAINT, lw=0.9, ls=":")
    keys = [
        key(f"profile ({found.law})", color=COMPUTED, lw=1.4),
        key("motion at the stages", color=MEASURED, marker="o", ls="", ms=4.5),
        key("stress released", color=ACCENT, marker="s", ls="", ms=4.0, mfc="white"),
    ]
    zeros = np.unique(x[found.stage_zero])
    for at in zeros:
        axes.axvline(at, color=MEASURED, lw=0.8, ls="--")
    if found.lost is not None:
        axes.axhspan(0.0, 100.0 * found.lost, color=_LOST, lw=0.0, zorder=0)
        keys.append(key("gauges read zero", color=MEASURED, lw=0.8, ls="--"))
    names = [short(name, 18) for name in found.stages]
    curve = np.column_stack([found.distance, 100.0 * found.share])
    place_labels(axes, np.column_stack([x, share]), names, avoid=[curve])
    axes.set_ylim(0.0, 105.0)
    axes.set_xlabel("section behind the face (m)")
    axes.set_ylabel("part of the whole (%)")
    axes.grid()
    figure.legend(handles=keys, loc="outside upper center", ncols=4)
    return figure

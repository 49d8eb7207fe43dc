"""Runs of a campaign as lines across parallel axes: what varied, what was found, and the misfit.

After Inselberg (1985): each number of a run is a point of an axis of its own, and a run the line
through its points. Runs with a small misfit lie over the others and are darker.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from geoident.model.arrays import Floats
from geoident.report.drawing.style import ACCENT, FAINT, LENGTHS, SMALL, key, short

MOST_LINES = 500
"""Runs that are drawn, those with the least misfit: more are a dark area."""

_DECADES = 30.0
"""Ratio of the largest to the least of some values from which on an axis is logarithmic."""


@dataclass(frozen=True)
class ParallelAxis:
    """One axis.

    Args:
        label: of it.
        values: (k,) of the runs; NaN where a run has none. Of words their places among `words`.
        words: what stands for 0, 1, ...; none where the values are numbers.
    """

    label: str
    values: Floats
    words: tuple[str, ...] = ()

    @property
    def log(self) -> bool:
        """The values lie decades apart."""
        known = self.values[np.isfinite(self.values)]
        positive = known.size and known.min() > 0.0 and not self.words
        return bool(positive and known.max() > _DECADES * known.min())

    def places(self) -> Floats:
        """(k,) where the values lie on the axis, 0 to 1; in the middle where all are one."""
        values = np.log(self.values) if self.log else self.values
        known = values[np.isfinite(values)]
        low, high = (known.min(), known.max()) if known.size else (0.0, 0.0)
        if high <= low:
            return np.where(np.isfinite(values), 0.5, np.nan)
        return np.asarray((values - low) / (high - low))

    def ticks(self) -> list[tuple[float, str]]:
        """Places with what is written there."""
        if self.words:
            places = ParallelAxis("", np.arange(len(self.words), dtype=np.float64)).places()
            return [(float(y), short(word)) for y, word in zip(places, self.words, strict=True)]
        known = self.values[np.isfinite(self.values)]
        if not known.size:
            return []
        low, high = float(known.min()), float(known.max())
        if low == high:
            return [(0.5, f"{low:.4g}")]
        middle = float(np.sqrt(low * high)) if self.log else 0.5 * (low + high)
        return [(0.0, f"{low:.3g}"), (0.5, f"{middle:.3g}"), (1.0, f"{high:.3g}")]


def word_axis(label: str, words: Sequence[str]) -> ParallelAxis:
    """An axis of what is no number.

    Args:
        label: of it.
        words: (k) of the runs; empty where a run has none.
    """
    known = tuple(dict.fromkeys(word for word in words if word))
    values = [float(known.index(word)) if word else np.nan for word in words]
    return ParallelAxis(label, np.array(values, dtype=np.float64), known)


def parallel_figure(axes: Sequence[ParallelAxis], *, misfit: Floats) -> Figure:
    """Lines of runs across axes, the misfit last.

    Args:
        axes: what varied and what was found.
        misfit: (k,) of the runs.
    """
    shown = [*axes, ParallelAxis("misfit", misfit)]
    order = np.argsort(-misfit, kind="stable")
    order = order[np.isfinite(misfit[order])][-MOST_LINES:]
    x = np.arange(len(shown), dtype=np.float64)
    lines = np.stack([axis.places() for axis in shown], axis=1)[order]
    figure = Figure(figsize=(max(5.0, 1.5 * len(shown) + 1.0), 3.6))
    panel = figure.subplots()
    rank = np.linspace(0.25, 0.95, len(order)) if len(order) > 1 else np.array([0.95])
    colours = colormaps[LENGTHS](Normalize(0.0, 1.0)(rank))
    paths = [np.column_stack([x, line]) for line in lines]
    panel.add_collection(LineCollection(paths, colors=list(colours), linewidths=0.8))
    if len(order):
        panel.plot(x, lines[-1], color=ACCENT, lw=2.0)
    for place, axis in zip(x, shown, strict=True):
        panel.axvline(place, color=FAINT, lw=0.8, zorder=0.5)
        for y, text in axis.ticks():
            panel.annotate(
                text, (place, y), xytext=(3, 0), textcoords="offset points", fontsize=SMALL,
                va="center", bbox={"fc": "white", "ec": "none", "pad": 0.6, "alpha": 0.8},
            )  # fmt: skip
    panel.set_xticks(x, [_folded(axis.label) for axis in shown], fontsize=SMALL)
    panel.set_yticks([])
    panel.set_xlim(-0.15, len(shown) - 0.5)
    panel.set_ylim(-0.05, 1.05)
    panel.spines[["left", "bottom"]].set_visible(False)
    panel.tick_params(axis="x", length=0)
    handles = [key("least misfit", color=ACCENT, lw=2.0)]
    figure.legend(handles=handles, loc="outside lower center")
    return figure


def _folded(label: str) -> str:
    """A path in lines, one a key, that stand beside those of others.

    >>> _folded("parameters.E_rock.start (GPa)").splitlines()
    ['parameters', '.E_rock', '.start (GPa)']
    """
    path, unit, rest = label.partition(" (")
    return "\n.".join(path.split(".")) + unit + rest

"""Extremes of tractions and jumps of interfaces, and how much of them slips or opens, as text."""

from __future__ import annotations

import numpy as np

from geoident.model.arrays import Floats
from geoident.model.results.interfaces import InterfaceStates, titled
from geoident.report.text.layout import TextTable, number

TITLE = "Interfaces (tractions in kPa, tension positive; opening and slip in mm)"
_ROUNDING = 1e-10
"""Part of the largest traction or jump that is rounding of those around."""


def interface_table(states: InterfaceStates | None) -> TextTable:
    """Extremes of each interface at each stage, and the parts of its area that slip and open.

    Beside a wall each of its sides has its own.
    """
    header = (
        "interface", "stage", "t_n from", "to", "|t_s| up to", "opening from", "to",
        "|slip| up to", "slips", "opens",
    )  # fmt: skip
    if states is None:
        return TextTable(header, [])
    tractions = [_clean(each, 1e-3) for each in (states.normal_traction, states.shear_traction)]
    jumps = [_clean(each, 1e3) for each in (states.opening, states.slip)]
    rows = []
    for line in states.lines:
        every = states.of(*line)
        for stage, title in enumerate(states.stages):
            here = every[np.isfinite(states.normal_traction[every, stage])]
            if not len(here):
                continue
            t_n, t_s, opening, slip = (each[here, stage] for each in (*tractions, *jumps))
            area = states.areas[here] / states.areas[here].sum()
            shares = (area @ one[here, stage] for one in (states.slips, states.parts))
            cells = t_n.min(), t_n.max(), np.abs(t_s).max(), opening.min(), opening.max()
            numbers = [number(float(x)) for x in (*cells, np.abs(slip).max())]
            rows.append(
                [titled(*line), title, *numbers, *(f"{100 * share:.0f} %" for share in shares)]
            )
    return TextTable(header, rows, right="ll" + "r" * 8)


def _clean(values: Floats, factor: float) -> Floats:
    """Values times a factor, with zero for rounding; NaN stays."""
    rounding = _ROUNDING * np.abs(np.nan_to_num(values)).max(initial=0.0)
    return np.where(np.abs(values) <= rounding, 0.0, factor * values)

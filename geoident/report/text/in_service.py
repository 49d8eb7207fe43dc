"""A structure in service: how large the effects on each gauge are, and its later readings."""

from __future__ import annotations

import numpy as np

from geoident.model.in_service import DAY
from geoident.model.results.bands import NORMAL_95
from geoident.model.results.result import Result
from geoident.report.text.layout import TextTable, decimals, section, sentence
from geoident.units import size_in

TITLE = "Effects on the gauges"
LATER = "Readings after the fit"

_EFFECTS = ("level", "season", "air", "irreversible")

_WHAT = (
    "Level, season, air: range of the readings that they cause, with its 95 % interval; "
    "irreversible: motion from the first reading to the last. Scatter: standard deviation of a "
    "reading about what is explained; of it 'lasting' fades within the time shown."
)


def parts(result: Result) -> tuple[str, ...]:
    """The sections of a terminal."""
    return (
        section(TITLE, effects_table(result).text, sentence(_WHAT)) if result.seasonal else "",
        section(LATER, judged_table(result).text),
    )


def effects_table(result: Result) -> TextTable:
    """A row for each gauge that was fitted: its effects, and what they leave."""
    fit, gauges = result.seasonal, result.gauges
    header = (
        "gauge", "readings", *_EFFECTS, "unit", "scatter", "lasting", "fades in", "explained"
    )  # fmt: skip
    rows = []
    for i in range(0 if fit is None else len(gauges.channels)):
        assert fit is not None
        if np.isnan(fit.white[i]):
            continue
        size = size_in(gauges.shown_units[i], gauges.dimensions[i]) or 1.0
        digits = max(0, 1 - int(np.floor(np.log10(fit.scatter[i] / size))))
        effects = [
            _with_interval(getattr(fit, name)[i], getattr(fit, f"{name}_sd")[i], size, digits)
            for name in _EFFECTS
        ]
        lasts = bool(fit.lasting[i])
        rows.append(
            [
                gauges.channels[i], str(fit.number[i]), *effects, gauges.shown_units[i],
                decimals(fit.scatter[i] / size, digits),
                decimals(fit.lasting[i] / size, digits) if lasts else "",
                f"{fit.fades[i] / DAY:.0f} d" if lasts else "",
                f"{100.0 * fit.explained[i]:.0f} %",
            ]
        )  # fmt: skip
    return TextTable(header, rows, right="lrrrrrlrrrr").filled


def _with_interval(value: float, sd: float, size: float, digits: int) -> str:
    """A number with half of its interval; nothing where there is none."""
    if np.isnan(value):
        return ""
    return f"{value / size:.{digits}f} ± {NORMAL_95 * sd / size:.{digits}f}"


def judged_table(result: Result) -> TextTable:
    """A row for each gauge with later readings: how they compare with what was expected."""
    header = ("gauge", "readings", "inside 95 %", "mean (sd)", "rms (sd)", "largest (sd)")
    judged, channels = result.judged, np.array(result.gauges.readings.channel)
    rows = []
    for name in result.gauges.channels if judged is not None else ():
        assert judged is not None
        e = judged.innovation[channels == name]
        e = e[np.isfinite(e)]
        if e.size:
            inside = int(np.count_nonzero(np.abs(e) <= NORMAL_95))
            numbers = (e.mean(), np.sqrt(np.mean(e**2)), e[np.argmax(np.abs(e))])
            rows.append(
                [name, str(e.size), f"{inside} ({100 * inside / e.size:.0f} %)"]
                + [f"{x:+.1f}" if k != 1 else f"{x:.1f}" for k, x in enumerate(numbers)]
            )
    return TextTable(header, rows, right="lrrrrr")

"""Readings that are wrong, or that the model does not describe, by their stated accuracies.

The other sentences of a fit judge readings by all errors, among them those of model and mesh that
the residuals themselves have shown: by these no reading and no model would ever look wrong.
"""

from __future__ import annotations

import numpy as np

from geoident.model.arrays import Ints
from geoident.model.case import Case
from geoident.model.gauges import ReadingTable
from geoident.model.results.findings import Finding
from geoident.model.results.result import GaugeTable
from geoident.units import in_unit, shown_unit

GROSS = 1000.0
"""Residual in accuracies that no gauge shows: a unit, a column or a sign is wrong."""

GROSS_BESIDE = 30.0
"""And residual or reading are as many times the median one: else it is the model that is wrong."""

UNEXPLAINED = 5.0
"""Residual in accuracies from which on it is named, whatever else explains it."""

_ROUND = 100.0
"""Accuracies from which on a residual is said without decimals."""


def gross_readings(readings: ReadingTable) -> Ints:
    """Rows (m,) of the used readings that no gauge can have shown, the worst first.

    Args:
        readings: k of them, with what the model says of each, and the accuracies as the case
            states them: estimated ones would grow with the reading.
    """
    if not readings.used.any():
        return np.zeros(0, dtype=np.int64)
    far, read = (
        np.where(readings.used, np.abs(each) / readings.sd, 0.0)
        for each in (readings.value - readings.computed, readings.value)
    )
    beside = [each > GROSS_BESIDE * float(np.median(each[readings.used])) for each in (far, read)]
    rows = np.flatnonzero((far > GROSS) & (beside[0] | beside[1]))
    return rows[np.argsort(-far[rows], kind="stable")]


def gross_findings(gross: Ints, readings: ReadingTable, case: Case) -> tuple[Finding, ...]:
    """A finding for readings that are grossly wrong, with the place where each is written.

    Args:
        gross: (m,) rows of `gross_readings`.
        readings: k of them, as the case has them.
        case: with the places where they are written.
    """
    units = {channel.name: (channel.unit, channel.dimension) for channel in case.channels}
    places = []
    for k in gross[:5].tolist():
        unit = units[readings.channel[k]]
        value = f"{in_unit(float(readings.value[k]), *unit):.4g} {shown_unit(*unit)}".rstrip()
        place = str(case.readings[k].location)
        places.append(
            f"{readings.channel[k]} at {readings.stage[k]} ({place}: {value})"
            if place
            else f"{readings.channel[k]} at {readings.stage[k]} ({value})"
        )
    if not places:
        return ()
    rest = f" and {len(gross) - 5} more" if len(gross) > 5 else ""
    what = "Grossly wrong readings" if len(gross) > 1 else "A grossly wrong reading"
    sentence = (
        f"{what}, more than {GROSS:.0f} standard deviations from the model: {', '.join(places)}"
        f"{rest}. Check unit, column and sign; correct it, or give the reason in the column 'bad'."
    )
    channels = dict.fromkeys(readings.channel[k] for k in gross.tolist())
    return (Finding("gross-reading", ", ".join(channels), sentence),)


def accuracy_residuals(gauges: GaugeTable) -> tuple[Finding, ...]:
    """A finding for the residual that is the most accuracies, where these do not explain it.

    Args:
        gauges: measured and computed, with the accuracies as stated: estimated ones would grow
            with what is looked for.
    """
    residual = np.where(gauges.used, gauges.measured - gauges.computed, 0.0)
    times = np.nan_to_num(np.abs(residual) / gauges.sd)
    if not times.max(initial=0.0) >= UNEXPLAINED:
        return ()
    i, j = np.unravel_index(int(np.argmax(times)), times.shape)
    unit = gauges.units[i], gauges.dimensions[i]
    size = f"{in_unit(float(np.abs(residual[i, j])), *unit):.3g} {shown_unit(*unit)}".rstrip()
    sentence = (
        f"{gauges.channels[i]} at {gauges.stages[j]} is {size} from what is computed, "
        f"{_shown(float(times[i, j]))} of its accuracies: if the accuracy is right, the model or "
        "the reading is wrong. `geoident compare` shows whether another model (anisotropic, "
        "yielding, different in-situ stress) describes the ground better."
    )
    subject = f"{gauges.channels[i]}, {gauges.stages[j]}"
    return (Finding("far-reading", subject, sentence, {"accuracies": float(times[i, j])}),)


def _shown(times: float) -> str:
    return f"{times:.1f}" if times < _ROUND else f"{times:.0f}"

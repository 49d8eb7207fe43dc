"""Readings of which the unit is suspected: ten or a thousand times those of the model.

Readings in centimetres that are read as millimetres have the pattern of the model and a tenth of
its size. A modulus of a tenth of its start value does the same, so it is said, not refused.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from geoident.errors import GeoidentError
from geoident.forward.observed import ObservedModel
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Case
from geoident.model.gauges import ReadingTable, named_channels
from geoident.model.results.findings import Finding

_FEWEST = 4
"""Readings of one kind that can show a pattern."""
_ALIKE = 0.8
"""Correlation of measured and computed readings, about zero, from which on the pattern is one."""
_NEAR = 0.2
"""Powers of ten by which the factor may differ from a whole one: 6.3 to 16 times are about ten."""
_ABOUT = 0.3
"""The same where no parameters within their bounds meet the readings: 5 to 20 times."""
_CLEAR = 3.0
"""Standard deviations that the larger of both must have on the average."""

_MISTAKEN = {
    ("length", -1): "centimetres read as millimetres",
    ("length", 1): "millimetres read as centimetres",
    ("length", -3): "metres read as millimetres",
    ("length", 3): "millimetres read as metres, or micrometres for millimetres",
    ("pressure", -1): "MPa read as bar",
    ("pressure", 1): "bar read as MPa",
    ("pressure", -2): "bar read as kPa",
    ("pressure", 2): "kPa read as bar",
    ("pressure", -3): "MPa read as kPa",
    ("pressure", 3): "kPa read as MPa",
    ("force", -3): "MN read as kN",
    ("force", 3): "kN read as MN, or N for kN",
    ("angle", -3): "rad read as mrad",
    ("angle", 3): "mrad read as rad",
    ("strain", -3): "per mille read as micrometres per metre",
    ("strain", 3): "micrometres per metre read as per mille",
}
"""Dimension and power of ten of the readings, by the model, to what was likely mistaken."""


def computed_at_start(case: Case, model: ObservedModel, readings: ReadingTable) -> Floats | None:
    """What the model says of the used readings (g,) at the start values, SI; None if it cannot.

    Args:
        case: the case of the model.
        model: is asked once, without derivatives.
        readings: of the case.
    """
    rows = np.flatnonzero(readings.used)
    if not rows.size:
        return None
    times = [None if np.isnan(t) else float(t) for t in readings.time[rows]]
    response = model.response([readings.pairs[k] for k in rows], times)
    p = np.array([parameter.start for parameter in case.parameters], dtype=np.float64)
    if response.admissible(p) is not None:
        return None
    try:
        return response.readings(p)
    except GeoidentError:
        return None  # what is wrong there is said by the search


def unit_doubts(
    case: Case, readings: ReadingTable, computed: Floats, *, met: bool = True
) -> tuple[str, ...]:
    """Half sentences on readings of which the unit is suspected, one for each factor.

    Args:
        case: of the readings.
        readings: k of them.
        computed: (g,) the model at the start values, for those that are used.
        met: parameters within their bounds may meet the readings, as far as is known.
    """
    sentences = []
    doubtful = dict[tuple[str, int], list[tuple[str, Bools, float]]]()
    for kind, dimension, rows_of_kind in _kinds(case, readings):
        scale = _scale(readings, computed, rows_of_kind)
        power = 0 if scale is None else round(np.log10(scale))
        near = scale is not None and abs(np.log10(scale) - power) < (_NEAR if met else _ABOUT)
        if scale is not None and near and (dimension, power) in _MISTAKEN:
            doubtful.setdefault((dimension, power), []).append((kind, rows_of_kind, scale))
    for (dimension, power), suspects in doubtful.items():
        rows_of_kind = np.logical_or.reduce([one for _, one, _ in suspects])
        rows = np.flatnonzero(readings.used)[rows_of_kind]
        scale = float(np.exp(np.mean([np.log(one) for _, _, one in suspects])))
        place = case.readings[int(rows[0])].location
        kinds = named_channels([kind for kind, _, _ in suspects])
        names = named_channels([readings.gauge[k] for k in rows])
        sentences.append(
            f"the readings of {names} ({kinds}; the first at {place}) have the pattern of the "
            f"model at the start values, and are {_times(scale, power)}: "
            f"{_MISTAKEN[dimension, power]}? Check their unit; if it is right, the start values "
            "are as far off"
        )
    return tuple(sentences)


def _times(scale: float, power: int) -> str:
    if power > 0:
        return f"{scale:.2g} times as large"
    return f"{1.0 / scale:.2g} times smaller"


def _kinds(case: Case, readings: ReadingTable) -> Iterator[tuple[str, str, Bools]]:
    """Kind of gauges, dimension, and (g,) which of the used readings are theirs.

    Kinds with few readings are taken together.
    """
    of = {channel.name: (channel.kind, channel.dimension) for channel in case.channels}
    each = [of[readings.channel[k]] for k in np.flatnonzero(readings.used)]
    few = [pair for pair, count in Counter(each).items() if count < _FEWEST]
    together = {pair: ", ".join(k for k, d in few if d == pair[1]) for pair in few}
    each = [(together.get(pair, pair[0]), pair[1]) for pair in each]
    for kind, dimension in dict.fromkeys(each):
        yield kind, dimension, np.array([one == (kind, dimension) for one in each])


def _scale(readings: ReadingTable, computed: Floats, which: Bools) -> float | None:
    """How many times the computed readings some are; None where they have another pattern."""
    measured, sd = readings.value[readings.used][which], readings.sd[readings.used][which]
    model = computed[which]
    if len(measured) < _FEWEST or not np.isfinite(model).all():
        return None
    product = float(measured @ model)
    size = float(np.linalg.norm(measured) * np.linalg.norm(model))
    larger = np.maximum(np.abs(measured), np.abs(model)) / sd
    if size == 0.0 or product < _ALIKE * size or np.sqrt(np.mean(larger**2)) < _CLEAR:
        return None
    return float(np.linalg.norm(measured) / np.linalg.norm(model))


def unit_findings(doubts: Sequence[str]) -> tuple[Finding, ...]:
    """The half sentences of `unit_doubts` as findings."""
    return tuple(Finding("unit", "", f"{one[:1].upper()}{one[1:]}.") for one in doubts)

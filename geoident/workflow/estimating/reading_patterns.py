"""Readings that move as the model does, but in another size or the other way.

This is what can be seen without a fit, and what is left to say where none of the hypotheses of
`mistakes` is certain. Readings in centimetres that are read as millimetres have the pattern of the
model at the start values and a tenth of its size. A modulus of a tenth of its start value does the
same, so it is said, not refused. A gauge that the fitted model moves the other way may have the
other sign, or the model is wrong. A model that does not move where the gauges do lacks its loads.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from geoident.errors import GeoidentError
from geoident.forward.observed import ObservedModel
from geoident.io.text.wording import listing
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import ReadingTable, named_channels
from geoident.model.results.findings import Finding
from geoident.workflow.estimating.mistake_words import loading
from geoident.workflow.estimating.suspects import channels_of, groups_of

_FEWEST = 4
"""Readings of one kind that can show a pattern."""
_ALIKE = 0.8
"""Correlation of measured and computed readings, about zero, from which on the pattern is one."""
_AGAINST = -0.5
"""The same of a gauge that is against the model."""
_NEAR = 0.2
"""Powers of ten by which the factor may differ from a whole one: 6.3 to 16 times are about ten."""
_ABOUT = 0.3
"""The same where no parameters within their bounds meet the readings: 5 to 20 times."""
_CLEAR = 3.0
"""Standard deviations that the larger of both must have on the average."""
_CLEAR_SIGN = 5.0
"""Accuracies from which on what a gauge reads has a clear sign."""
_MOVES = 0.05
"""Part of the largest computed reading of its dimension from which on a gauge has a clear sign.

Of accuracies it need not be one: the stiffer the model, the less it reads against the gauges.
"""
_MOVES_ALONE = 0.2
"""The same where only one reading is against the model."""
_STILL = 0.02
"""Part of what gauges read that a model computes which nothing moves."""

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


def size_findings(
    case: Case, readings: ReadingTable, computed: Floats, *, met: bool = True
) -> tuple[Finding, ...]:
    """Readings of which the unit is suspected, one finding for each factor.

    Args:
        case: of the readings.
        readings: k of them.
        computed: (g,) the model at the start values, for those that are used.
        met: parameters within their bounds may meet the readings, as far as is known.
    """
    findings = []
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
        size = f"{scale:.2g} times as large" if power > 0 else f"{1.0 / scale:.2g} times smaller"
        sentence = (
            f"The readings of {names} ({kinds}; the first at {place}) have the pattern of the "
            f"model at the start values, and are {size}: {_MISTAKEN[dimension, power]}? Check "
            "their unit; if it is right, the start values are as far off."
        )
        findings.append(Finding("unit", "", sentence))
    return tuple(findings)


def sign_findings(case: Case, readings: ReadingTable) -> tuple[Finding, ...]:
    """A finding for gauges that read the opposite of what is computed.

    A sign that a file counts the other way round cannot be fitted, and scatter, a model error or a
    bound would take it up without a word.

    Args:
        case: of the readings.
        readings: measured and computed, with the accuracies as stated.
    """
    rows = _judged(readings)
    computed, sd = readings.computed[rows], readings.sd[rows]
    channels = channels_of(case, [readings.channel[k] for k in rows.tolist()])
    dimension = [one.dimension for one in channels]
    largest = {
        one: float(np.abs(computed[members]).max()) for one, members in groups_of(dimension).items()
    }
    turned, count, most = [], 0, 0.0
    for name, members in groups_of([one.gauge for one in channels]).items():
        alike, _ = _pattern(readings.value[rows][members], computed[members], sd[members])
        clear = np.linalg.norm(readings.value[rows][members] / sd[members]) > _CLEAR_SIGN
        part = float(np.abs(computed[members]).max())
        part /= max(largest[dimension[members[0]]], 1e-300)
        if clear and part > _MOVES and alike < _AGAINST:
            turned.append(name)
            count += len(members)
            most = max(most, part)
    if not turned or (count < 2 and most <= _MOVES_ALONE):
        return ()
    what = "readings of {} run" if count > 1 else "reading of {} runs"
    sentence = (
        f"The {what.format(listing(turned))} against the model: measured and computed have "
        "opposite signs. Distances are positive where they grow, settlements downwards (page "
        "'Conventions'); where a file counts the other way round, its 'channels' take 'sign: -1'. "
        "If the signs are right, the model moves the wrong way."
    )
    return (Finding("opposite-sign", ", ".join(turned), sentence),)


def still_findings(case: Case, readings: ReadingTable) -> tuple[Finding, ...]:
    """A finding for a model that hardly moves where its gauges do.

    Args:
        case: of the readings.
        readings: measured and computed, with the accuracies as stated.
    """
    rows = _judged(readings)
    if case.elsewhere is not None or not len(rows):
        return ()
    read, computed = (
        each[rows] / readings.sd[rows] for each in (readings.value, readings.computed)
    )
    largest = np.linalg.norm(read)
    if largest < _CLEAR_SIGN * np.sqrt(len(rows)) or np.linalg.norm(computed) > _STILL * largest:
        return ()
    part = float(np.linalg.norm(computed) / largest)
    sentence = (
        f"The model hardly moves where the gauges do: what is computed is {100.0 * part:.2g} % of "
        f"what is read. What loads the ground is missing or in a wrong unit: check "
        f"{listing(loading(case))}; else the readings are in a wrong unit."
    )
    return (Finding("no-motion", "", sentence, {"part": part}),)


def _judged(readings: ReadingTable) -> Ints:
    """Rows of the used readings of which the model says something."""
    known = np.isfinite(readings.value) & np.isfinite(readings.computed)
    return np.flatnonzero(readings.used & known)


def _pattern(measured: Floats, computed: Floats, sd: Floats) -> tuple[float, float]:
    """Correlation (about zero) of readings (m,) with what is computed, in sd; ratio of sizes."""
    read, model = measured / sd, computed / sd
    size = float(np.linalg.norm(read) * np.linalg.norm(model))
    if size == 0.0 or not np.isfinite(size):
        return 0.0, 1.0
    return float(read @ model) / size, float(np.linalg.norm(read) / np.linalg.norm(model))


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
    alike, ratio = _pattern(measured, model, np.ones(len(sd)))
    larger = np.maximum(np.abs(measured), np.abs(model)) / sd
    return None if alike < _ALIKE or np.sqrt(np.mean(larger**2)) < _CLEAR else ratio

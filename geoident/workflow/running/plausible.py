"""Numbers of a case that no engineer meets: mostly a wrong unit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from math import dist, inf
from typing import Any, NamedTuple

import numpy as np

from geoident.io.case.gauges.accuracy import TYPICAL
from geoident.model.case import Case
from geoident.model.gauges import named_channels
from geoident.model.in_situ import ConstantStress, HeimStress
from geoident.model.parameter import Scalar, Values
from geoident.model.results.findings import Finding
from geoident.model.structures import Beam, Ring, Shell
from geoident.units import in_unit, shown_unit

_OFTEN = 100.0
"""Times an accuracy may be the usual one, or this part of it, without a word."""
_PART_OF_DISTANCE = 0.5
"""Of that of two points by which they never move apart or together: 0.1 to 0.3 is a collapse."""
_SOFTEST, _STIFFEST = 5e4, 1e12
"""Pa: below a modulus of peat, above one of diamond."""
_SMALLEST_K0, _LARGEST_K0 = 0.1, 10.0
_LIGHTEST, _HEAVIEST = 400.0, 6000.0
"""kg/m3: below a density of foamed concrete and of any peat on site, above one of massive ore."""
_THICKEST = 6.0
"""m: of linings and walls."""
_DEEPEST = 3e8
"""Pa: the weight of 12 km of rock."""


class Odd(NamedTuple):
    """What a number that nobody meets is of, and the sentence about it."""

    subject: str
    sentence: str


def implausible_findings(case: Case, fitted: Values | None = None) -> tuple[Finding, ...]:
    """Findings about numbers of a case that nobody meets.

    Args:
        case: its parameters count at their start values, and at the means of their priors.
        fitted: values in place of these starts, SI.
    """
    start = {q.name: q.start for q in case.parameters} | dict(fitted or {})
    by_prior = {q.name: q.prior.mean for q in case.parameters if q.prior is not None}
    odd = {
        sentence: subject
        for subject, sentence in (
            *_accuracies(case), *_readings(case), *_of_values(case, start), *_releases(case),
            *_priors(case),
        )
    }  # fmt: skip
    for name, mean in by_prior.items():
        for subject, sentence in _of_values(case, {**start, name: mean}):
            if sentence not in odd:
                odd[f"With the mean of the prior of {name}, {sentence}"] = subject
    return tuple(
        Finding("implausible", subject, f"{sentence[:1].upper()}{sentence[1:]}.")
        for sentence, subject in odd.items()
    )


def _of_values(case: Case, values: Values) -> Iterator[Odd]:
    """Those of numbers that may depend on parameters."""
    yield from _moduli(case, values)
    yield from _densities(case, values)
    yield from _stresses(case, values)
    yield from _linings(case, values)


def _accuracies(case: Case) -> Iterator[Odd]:
    """One sentence for all channels of a kind that have the same accuracy."""
    alike: dict[tuple[str, float], list[str]] = {}
    for channel in case.channels:
        usual = TYPICAL.get(channel.kind)
        if usual is None or channel.errors is not None or channel.branch:  # branch: of a test
            continue
        if not usual.reading / _OFTEN < channel.accuracy < usual.reading * _OFTEN:
            alike.setdefault((channel.kind, channel.accuracy), []).append(channel.name)
    for (kind, accuracy), names in alike.items():
        one = next(channel for channel in case.channels if channel.name == names[0])
        unit = TYPICAL[kind].unit
        stated, usual_said = (
            f"{in_unit(size, unit, one.dimension):.3g} {shown_unit(unit, one.dimension)}"
            for size in (accuracy, TYPICAL[kind].reading)
        )
        yield Odd(
            ", ".join(names),
            f"the accuracy of {named_channels(names)} is {stated}; gauges of the kind {kind} have "
            f"about {usual_said}: check its unit",
        )


def _readings(case: Case) -> Iterator[Odd]:
    """One sentence for each channel whose points would have met, or parted as far again."""
    apart = {
        channel.name: dist(channel.first, channel.second)
        for channel in case.channels
        if channel.first is not None and channel.dimension == "length"
    }
    far = [
        (reading.value, reading)
        for reading in case.readings
        if reading.value is not None and not reading.bad
        if abs(reading.value) > _PART_OF_DISTANCE * apart.get(reading.channel, inf)
    ]
    farthest = {
        reading.channel: (value, reading)
        for value, reading in sorted(far, key=lambda entry: abs(entry[0]))
    }
    for name, (value, reading) in farthest.items():
        yield Odd(
            name,
            f"{name} at {reading.stage or 'its date'} reads {value:.3g} m between points that are "
            f"{apart[name]:.3g} m apart ({reading.location}): check its unit",
        )


def _moduli(case: Case, values: Values) -> Iterator[Odd]:
    for name, material in case.materials.items():
        for constant, scalar in _numbers(material.elastic):
            size = scalar.value(values)
            if constant[:1] not in "EGK" or _SOFTEST <= size <= _STIFFEST:
                continue
            like = "softer than any ground" if size < _SOFTEST else "stiffer than any ground"
            yield Odd(name, f"{constant} of '{name}' is {_stress(size)}, {like}: check its unit")


def _densities(case: Case, values: Values) -> Iterator[Odd]:
    for name, material in case.materials.items():
        density = material.density.value(values)
        if density == 0.0 or _LIGHTEST <= density <= _HEAVIEST:
            continue
        like = "heavier than any ground" if density > _HEAVIEST else "lighter than any ground"
        yield Odd(
            name,
            f"the density of '{name}' is {density:.6g} kg/m3, {like}: check its unit (a unit "
            "weight of 19 kN/m3 is a density of 1940 kg/m3)",
        )


def _linings(case: Case, values: Values) -> Iterator[Odd]:
    for name, structure in case.structures.items():
        if not isinstance(structure, Beam | Ring | Shell) or structure.thickness is None:
            continue
        thickness = structure.thickness.value(values)
        if thickness > _THICKEST:
            yield Odd(name, f"the thickness of '{name}' is {thickness:.3g} m: check its unit")


def _releases(case: Case) -> Iterator[Odd]:
    """Groups of which a part of the stress is still held when all stages are through."""
    last = {group: part for stage in case.stages for group, part in stage.release.items()}
    for group, part in last.items():
        if part.parameter is None and part.factor < 1.0:
            yield Odd(
                group,
                f"{100.0 * part.factor:.3g} % of the stress of '{group}' is released in the last "
                f"stage that names it, and the rest never: if it is to go, let a later stage say "
                f"release: {{{group}: 1}}",
            )


def _stresses(case: Case, values: Values) -> Iterator[Odd]:
    models = [case.in_situ, *case.in_situ_of.values()]
    for model in models:
        if isinstance(model, ConstantStress):
            xx, yy, zz, xy, yz, zx = (part.value(values) for part in model.components)
            tensor = [[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]]
            tension = float(np.linalg.eigvalsh(tensor)[-1])
            if tension > 0.0:
                yield Odd(
                    "",
                    f"the in-situ stress has {_stress(tension)} of tension: compression is "
                    "negative here, check the signs",
                )
        K0 = getattr(model, "K0", None)
        ratios = [K0] if isinstance(K0, Scalar) else [*K0.values()] if K0 else []
        sizes = [scalar.value(values) for scalar in ratios]
        smallest, largest = min(sizes, default=1.0), max(sizes, default=1.0)
        if smallest < _SMALLEST_K0:
            yield Odd(
                "",
                f"K0 is {smallest:.3g}: ground with hardly any horizontal stress is seldom meant "
                "(at rest it has 0.3 to 1, tectonic stress more)",
            )
        if largest > _LARGEST_K0:
            yield Odd(
                "",
                f"K0 is {largest:.3g}: the horizontal stress is {largest:.3g} times the vertical "
                "one; per cent need their sign, '80 %'",
            )
        if isinstance(model, HeimStress) and model.vertical is not None:
            pressure = model.vertical.value(values)
            if pressure > _DEEPEST:
                yield Odd(
                    "",
                    f"the vertical in-situ stress is {_stress(pressure)}, more than 12 km of rock "
                    "weigh: check its unit",
                )


def _priors(case: Case) -> Iterator[Odd]:
    for parameter in case.parameters:
        prior = parameter.prior
        if prior is not None and not parameter.lower <= prior.mean <= parameter.upper:
            yield Odd(
                parameter.name,
                f"the mean of the prior of {parameter.name} is outside its bounds, which exclude "
                "what is likeliest: widen the bounds or correct the mean",
            )


def _numbers(record: Any) -> Iterator[tuple[str, Scalar]]:
    """Numbers of a record with the names of its fields."""
    if not is_dataclass(record):
        return
    for entry in fields(record):
        value = getattr(record, entry.name)
        if isinstance(value, Scalar):
            yield entry.name, value


def _stress(size: float) -> str:
    for factor, unit in ((1e9, "GPa"), (1e6, "MPa"), (1e3, "kPa")):
        if abs(size) >= factor:
            return f"{size / factor:.3g} {unit}"
    return f"{size:.3g} Pa"

"""How accurate a gauge is: one quantity, what its errors are made of, or ``estimate``.

A quantity stands for readings whose errors are independent. A mapping says what they share, and
what it leaves out has the size that is usual for the kind of gauge (`TYPICAL`). A part, or the
whole, may be ``estimate``: its size then follows from the residuals, and the usual size is where
the estimation begins. Gauges of one kind have one size.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from geoident.io.schema.estimated import ESTIMATE
from geoident.io.schema.section import Section, SectionFaults, optional
from geoident.io.schema.values import (
    CaseNumber,
    QuantityType,
    TextOrMapping,
    or_words,
    quantity_pattern,
    require_text,
)
from geoident.io.text.wording import Refusal, shorten
from geoident.model.gauges import PARTS, ErrorParts
from geoident.units import (
    DIMENSIONS,
    LEAST_SD,
    MOST_SD,
    UNITS,
    in_unit,
    read_quantity,
    shown_unit,
    size_in,
    unit_list,
    with_article,
)

_ROOT = re.compile(r"(.*?)\s*/\s*(?:sqrt\s*\(\s*([A-Za-z]+)\s*\)|([A-Za-z]+)\s*\^?\s*0\.5)")


@dataclass(frozen=True)
class UsualErrors:
    """Standard deviations that are usual for a kind of gauge, SI.

    Args:
        reading: of one reading.
        head: of the head at an epoch.
        epoch: of the set-up of a survey.
        along: per root of a metre along a casing.
        unit: in which such gauges are read.
    """

    reading: float
    head: float = 0.0
    epoch: float = 0.0
    along: float = 0.0
    unit: str = ""


TYPICAL: Mapping[str, UsualErrors] = {
    "extensometer": UsualErrors(1e-4, head=0.5e-4, unit="mm"),
    "convergence": UsualErrors(2e-4, epoch=1e-4, unit="mm"),
    "settlement": UsualErrors(3e-4, epoch=3e-4, unit="mm"),
    "levelling": UsualErrors(3e-4, epoch=3e-4, unit="mm"),
    "displacement": UsualErrors(1e-3, epoch=0.5e-3, unit="mm"),
    "target": UsualErrors(1e-3, epoch=0.5e-3, unit="mm"),
    "joint-meter": UsualErrors(5e-5, unit="mm"),
    "bar-displacement": UsualErrors(5e-5, unit="mm"),
    "distortion": UsualErrors(5e-5, unit="mrad"),
    "line-of-sight": UsualErrors(2e-3, epoch=1e-3, unit="mm"),
    "inclinometer": UsualErrors(1e-4, along=2e-4, unit="mm"),
    "tilt": UsualErrors(5e-5, unit="mrad"),
    "strain": UsualErrors(5e-6, unit="microstrain"),
    "load-cell": UsualErrors(5e3, unit="kN"),
    "pressure-cell": UsualErrors(1e4, unit="kPa"),
    "stress": UsualErrors(5e5, unit="MPa"),
    "piezometer": UsualErrors(1e3, unit="kPa"),
    "thermometer": UsualErrors(0.3, unit="degC"),
}
"""Kind of gauge to what is usual.

Extensometers: rods with dial or displacement gauges read to some hundredths of a millimetre and
are good to 0.1 mm; the head moves with its seat and its temperature by about half of that, for all
anchors at once. Tape extensometers repeat to 0.1 to 0.2 mm, and the temperature of one tape is
wrong for all lines of a day: 1 K on 10 m is 0.1 mm. Precise levelling: 0.3 mm a point, and as much
for the set-up and the benchmark, which a distortion does not feel: 0.3 mm of two points 8 m apart
is 0.05 mm/m. Total stations and GNSS: 1 mm a target over 100 m, half of it refraction and
orientation that a set-up shares. Inclinometers: 0.16 mm of a single interval adds up
like a random walk to 1.24 mm in 30 m of casing (Mikkelsen, FMGM 2003): 0.2 mm/sqrt(m). Of kinds
that are not here nobody but the user knows it.
"""

_EXAMPLES = {
    "temperature": "0.3 degC",
    "angle": "0.05 mrad",
    "pressure": "10 kPa",
    "strain": "5 microstrain",
}
"""Dimension to an accuracy that is usual; a length where it is not here."""


UNKNOWN_SIZE = (
    "nothing is known of the usual accuracy of a plain reading",
    "Give a size, and 'accuracies: estimate' under 'fit' to have it estimated from there.",
)
"""What is wrong with an accuracy to be estimated of a gauge that may read anything; the remedy."""


@dataclass(frozen=True)
class StandardDeviationOf(QuantityType):
    """Annotation of a `CaseNumber`: a standard deviation, or ``estimate``, which has no dimension.

    Args:
        per_root_length: as it adds up along a casing, as in ``0.2 mm/sqrt(m)``.
        usual: its usual size is known, from which it may be estimated.
    """

    per_root_length: bool = False
    usual: bool = True

    def parse(self, value: object) -> CaseNumber:
        """The size that a text says.

        Raises:
            UnitError: no quantity.
            Refusal: no text, or a size below zero.
        """
        if isinstance(value, CaseNumber):
            return value
        text = require_text(value, self.words())
        if text.strip() == ESTIMATE:
            if not self.usual:
                raise Refusal("no-size", *UNKNOWN_SIZE)
            return CaseNumber(ESTIMATE, math.nan, None, self.dimension or ESTIMATE)
        given = self._along(text) if self.per_root_length else super().parse(text)
        if not given.factor >= 0.0:
            message = f"'{shorten(text)}' is negative; expected a standard deviation"
            raise Refusal("out-of-range", message, "Write it positive, or 0 for none.")
        return computable(given)

    def _example(self) -> str:
        """An accuracy that is usual, as there is none of loads."""
        return _EXAMPLES.get(self.dimension or "", "0.1 mm")

    def words(self) -> str:
        """What is expected, for a message."""
        if self.per_root_length:
            return "a standard deviation per root of a length, such as 0.2 mm/sqrt(m),"
        return super().words()

    def described(self) -> dict[str, Any]:
        """The JSON schema of the number."""
        described = super().described()
        if not self.usual:
            return described
        if self.per_root_length:
            size = quantity_pattern(UNITS).removesuffix("?") + r"\s*/\s*sqrt\([A-Za-z]+\)"
            described["pattern"] = rf"^\s*({size})\s*$"
            described["examples"] = ["0.2 mm/sqrt(m)"]
            described["description"] = "a standard deviation per root of a length, or estimate"
            described["type"] = "string"
        else:
            described["description"] += ", or estimate"
        or_words(described, ESTIMATE)
        described["x-quantity"] = f"{described['x-quantity']} or `{ESTIMATE}`"
        return described

    def _along(self, text: str) -> CaseNumber:
        match = _ROOT.fullmatch(text.strip())
        unit = (match[2] or match[3]) if match else ""
        if match is None or UNITS.get(unit, ("",))[0] != "length":
            message = f"'{shorten(text)}' is not {self.words()[:-1]}"
            raise Refusal("unit", message, "It grows with the root of the length of casing.")
        size = read_quantity(match[1])
        value = size.value / math.sqrt(UNITS[unit][1])
        return CaseNumber(text, value, None, size.dimension, size.unit)


def computable(given: CaseNumber) -> CaseNumber:
    """A standard deviation that can be computed with.

    Raises:
        Refusal: it, or its square, is beyond what numbers can hold.
    """
    if given.factor == 0.0 or LEAST_SD <= given.factor <= MOST_SD:
        return given
    message = f"'{shorten(given.text)}' is an implausible accuracy for a gauge"
    hint = f"From {LEAST_SD:g} to {MOST_SD:g} of the SI unit is expected; "
    raise Refusal("out-of-range", message, f"{hint}leave out a gauge without information.")


AccuracyPart = Annotated[CaseNumber, StandardDeviationOf(None)]


class ErrorsSection(Section):
    """What the errors of readings are made of, as standard deviations; 0 for none.

    What is left out has the size that is usual for the kind of gauge. Each may be `estimate`,
    but of a plain reading, of which nothing is usual.
    """

    reading: AccuracyPart | None = optional("Of each single reading.", examples=["0.1 mm"])
    zero: AccuracyPart | None = optional(
        "Of the zero, which all later readings of a channel share; without it that of "
        "one reading, of a gauge that reads a value none.",
        examples=["0.1 mm"],
    )
    head: AccuracyPart | None = optional(
        "Of the head, which all channels of the gauge share on a day of a stage.",
        examples=["0.05 mm"],
    )
    epoch: AccuracyPart | None = optional(
        "Of the set-up, which all readings of a survey share on a day of a stage.",
        examples=["0.2 mm"],
    )
    along: Annotated[CaseNumber, StandardDeviationOf(None, per_root_length=True)] | None = optional(
        "What adds up along a casing, as a random walk from its reference end.",
        examples=["0.2 mm/sqrt(m)"],
    )


Accuracy = TextOrMapping[Annotated[CaseNumber, StandardDeviationOf(None, above=0.0)], ErrorsSection]
LengthAccuracy = TextOrMapping[
    Annotated[CaseNumber, StandardDeviationOf("length", above=0.0)], ErrorsSection
]
AnyAccuracy = CaseNumber | ErrorsSection
FORCES = ("force", "line load", "moment", "moment per length")
"""Dimensions of forces of structures; the accuracy of a load cell may have any of them."""

EstimatedKinds = TextOrMapping[Literal["estimate"], dict[str, Literal["estimate"]]]


def check_parts(
    given: AnyAccuracy, dimension: str, kind: str, faults: SectionFaults, key: str = "accuracy"
) -> None:
    """Refuse sizes of another dimension, and a reading without an error of its own.

    Args:
        given: of a gauge.
        dimension: of what it reads.
        kind: of the gauge.
        faults: takes what is wrong.
        key: under which they stand.
    """
    if isinstance(given, CaseNumber):
        _refuse_nonsense(given, dimension, (key,), kind, faults)
        return
    if given.reading is not None:
        _refuse_nonsense(given.reading, dimension, (key, "reading"), kind, faults)
    for name in PARTS:
        part: CaseNumber | None = getattr(given, name)
        if part is None:
            continue
        if part.text == ESTIMATE and kind not in TYPICAL:
            faults.add((key, name), "no-size", *UNKNOWN_SIZE)
        elif part.text != ESTIMATE and part.dimension != dimension:
            message = f"'{shorten(part.text)}' is {with_article(part.dimension)}; "
            message += f"expected {with_article(dimension)}"
            faults.add((key, name), "unit", message, f"Its units: {unit_list(dimension)}.")
    if given.reading is None and kind not in TYPICAL:
        hint = f"Write 'reading: ...' in a unit of {dimension}."
        faults.add((key,), "missing-key", "'reading' is missing", hint)
    elif given.reading is not None and given.reading.factor == 0.0:
        message = "the reading error must exceed zero"
        faults.add((key, "reading"), "out-of-range", message, "Write one above zero.")


def _refuse_nonsense(
    given: CaseNumber, dimension: str, key: tuple[str, ...], kind: str, faults: SectionFaults
) -> None:
    """Refuse an error of a reading that no instrument of a kind has, by far.

    Args:
        given: its standard deviation.
        dimension: of what the gauge reads.
        key: under which it stands.
        kind: of the gauge.
        faults: takes the fault.
    """
    usual = TYPICAL.get(kind)
    if usual is None or given.text == ESTIMATE or given.factor == 0.0:
        return
    if not UNITS[usual.unit][0] == given.dimension == dimension:
        return  # of another quantity, if it may be
    if usual.reading / NONSENSE <= given.factor <= usual.reading * NONSENSE:
        return
    unit = shown_unit(usual.unit, given.dimension)
    size = f"{in_unit(usual.reading, usual.unit, given.dimension):.3g} {unit}"
    message = f"'{shorten(given.text)}' is an implausible accuracy for a gauge"
    hint = f"Gauges of the kind {kind} have about {size}; is it another unit?"
    faults.add(key, "out-of-range", message, hint)


NONSENSE = 1e6
"""Times the usual accuracy of a kind of gauge, or this part of it, that no instrument has.

A millionth of that of an extensometer is the size of an atom; and what is computed has
errors of rounding that such readings would be fitted to.
"""


def error_parts(given: AnyAccuracy, kind: str, survey: str) -> ErrorParts:
    """What the errors of a gauge are made of.

    Args:
        given: the parts as the case says, or `estimate`.
        kind: of the gauge.
        survey: to which the gauge belongs.
    """
    usual = TYPICAL.get(kind, UsualErrors(1.0))
    if isinstance(given, CaseNumber):
        known = (("reading", _component(kind, "reading")),)
        return ErrorParts(usual.reading, survey=survey, estimated=known)
    sizes: dict[str, Any] = {}
    estimated: dict[str, str] = {}
    for name in PARTS:
        part: CaseNumber | None = getattr(given, name)
        if part is None and name == "zero":
            sizes[name] = sizes["reading"]
            estimated |= {name: estimated["reading"]} if "reading" in estimated else {}
        elif part is None:
            sizes[name] = getattr(usual, name)
        elif part.text == ESTIMATE:
            own = usual.reading if name in ("reading", "zero") else getattr(usual, name)
            sizes[name] = own or usual.reading
            estimated[name] = _component(kind, name)
        else:
            sizes[name] = part.factor
    surveyed = float(given.zero is None)
    return ErrorParts(
        **sizes, survey=survey, zero_surveyed=surveyed, estimated=tuple(estimated.items())
    )


def usual_examples(kind: str) -> list[Any]:
    """Ways to write the accuracy of a kind of gauge, with usual sizes; none where none are."""
    usual = TYPICAL.get(kind)
    if usual is None:
        return []
    sizes = {
        name: in_unit(getattr(usual, name), usual.unit, UNITS[usual.unit][0])
        for name in PARTS
        if name != "zero"
    }
    root = {"along": "/sqrt(m)"}
    parts = {name: f"{x:.3g} {usual.unit}{root.get(name, '')}" for name, x in sizes.items() if x}
    return [parts["reading"], ESTIMATE, *([parts] if len(parts) > 1 else [])]


def unit_shown(given: AnyAccuracy, kind: str, dimension: str) -> str:
    """The unit in which people want to see what a gauge reads.

    Args:
        given: how accurate it is, as the case says.
        kind: of the gauge.
        dimension: of what it reads.
    """
    if dimension == "length":
        return "mm"
    parts = [given] if isinstance(given, CaseNumber) else [given.reading, given.zero, given.epoch]
    units = [part.unit for part in parts if part is not None and part.unit]
    usual = TYPICAL[kind].unit if kind in TYPICAL else ""
    fitting = [u for u in (*units, usual) if size_in(u, dimension) is not None]
    return fitting[0] if fitting else DIMENSIONS[dimension]


def _component(kind: str, part: str) -> str:
    return f"{kind}: {part}"

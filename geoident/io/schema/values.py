"""The values of a case as pydantic types: texts, names, quantities, numbers and counts.

Each type validates the text that is written and describes itself in the JSON schema, so the schema
can't say anything else than the code does.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    Tag,
    WithJsonSchema,
)
from pydantic_core import CoreSchema, core_schema

from geoident.io.text.wording import Refusal, shorten
from geoident.model.parameter import Scalar
from geoident.units import (
    DIMENSIONLESS,
    DIMENSIONS,
    LARGEST,
    NUMBER_PATTERN,
    UNITS,
    UnitError,
    read_quantity,
    units_of,
    with_article,
)

NAME_PATTERN = r"[A-Za-z_][A-Za-z0-9_]*"
_TIE = re.compile(rf"(?:({NUMBER_PATTERN})\s*\*?\s*|(-))?\$({NAME_PATTERN})")
_BARE = re.compile(NUMBER_PATTERN)
_WHOLE = re.compile(r"[-+]?[0-9]+")
_BETWEEN = re.compile(r"\s*(?:\.\.+|\N{HORIZONTAL ELLIPSIS}|;|\s(?:to|bis|-|\N{EN DASH})\s)\s*")
"""What people write between two ends of a range, where a comma is expected."""
_LONGEST = 80
_TURN = 2 * math.pi * (1 + 1e-9)  # rad; 360 deg and 400 gon are rounded
_EXAMPLES: Mapping[str | None, str] = {
    "pressure": "15 MPa",
    "length": "12.5 m",
    "density": "2650 kg/m3",
    "unit weight": "26 kN/m3",
    "acceleration": "9.81 m/s2",
    "velocity": "0.5 mm/month",
    "diffusivity": "2 m2/year",
    "pressure rate": "2 kPa/month",
    "angle rate": "0.01 mrad/month",
    "strain rate": "5 microstrain/month",
    "time": "10 days",
    "viscosity": "5e14 Pa s",
    "force": "100 kN",
    "line load": "100 kN/m",
    "area": "600 mm2",
    "bending stiffness": "30 MNm2/m",
    "flexural rigidity": "250 MNm2",
    "moment per length": "150 kNm/m",
    "angle": "30 deg",
    "temperature": "10 degC",
    "temperature rate": "0.1 K/year",
    "expansion": "1e-5 1/K",
    "conductivity": "2.5 W/mK",
    "heat capacity": "2.2 MJ/m3K",
    "specific heat": "900 J/kgK",
    "film coefficient": "25 W/m2K",
    "compressibility": "2e-7 1/kPa",
    "strain": "50 microstrain",
    DIMENSIONLESS: "0.25",
    None: "15 GPa",
}
_SERIALIZE_TEXT = core_schema.plain_serializer_function_ser_schema(lambda given: given.text)


def require_text(value: object, expected: str) -> str:
    """The text itself.

    Raises:
        Refusal: nothing, a list or a mapping is written.
    """
    if isinstance(value, str):
        return value
    raise Refusal("wrong-kind", f"found {kind_of(value)}; expected {expected}")


def kind_of(value: object) -> str:
    """What a node of the file is, for a message."""
    if value is None:
        return "nothing"
    if isinstance(value, dict):
        return "a mapping"
    return "a list" if isinstance(value, list) else f"'{shorten(value)}'"


def _flag(value: object) -> bool:
    if isinstance(value, bool):
        return value
    text = require_text(value, "true or false")
    if text not in {"true", "false"}:
        message = f"found '{shorten(text)}'; expected true or false"
        raise Refusal("not-listed", message, "Write 'true' or 'false'.")
    return text == "true"


def _name(value: object) -> str:
    text = require_text(value, "a name")
    if not text.strip() or text != text.strip() or "\n" in text or len(text) > 100:
        hint = "One line, up to 100 characters, without blanks at its ends."
        raise Refusal("bad-name", f"'{shorten(text)}' is not a name", hint)
    return text


def _parameter_name(value: object) -> str:
    text = require_text(value, "a name")
    if not re.fullmatch(NAME_PATTERN, text):
        hint = "Letters, digits and underscores, not beginning with a digit."
        raise Refusal("bad-name", f"'{shorten(text)}' is not a name for a parameter", hint)
    return text


Flag = Annotated[bool, BeforeValidator(_flag)]
Name = Annotated[str, BeforeValidator(_name)]
ParameterName = Annotated[
    str, BeforeValidator(_parameter_name), Field(pattern=rf"^{NAME_PATTERN}$")
]
Text = Annotated[str, BeforeValidator(lambda value: require_text(value, "a text"))]


@dataclass(frozen=True)
class CaseNumber:
    """A number as the case gives it.

    Args:
        text: as written.
        factor: the number in SI units, or the factor of a tie.
        parameter: the parameter that it is tied to, or None.
        dimension: key of `geoident.units.DIMENSIONS`.
        unit: as normalised by `geoident.units`, empty for a tie.
        varied_by: the section of the field of which the number is the mean, of the growth that
            begins from it, or of the rock mass from which it follows; None for one number.
        may_be_tied: a parameter may stand in its place.
        called: what people call such a quantity, where its dimension has the name of another.
    """

    text: str
    factor: float
    parameter: str | None
    dimension: str
    unit: str = ""
    varied_by: Any = None
    may_be_tied: bool = False
    called: str = ""

    @property
    def value(self) -> Scalar | float:
        """For the model: a scalar where a parameter may stand, else a number in SI units."""
        return self.scalar if self.may_be_tied else self.factor

    @property
    def scalar(self) -> Scalar:
        """For the model."""
        return Scalar(self.factor, self.parameter)

    @property
    def parts(self) -> list[CaseNumber]:
        """The numbers that are given: itself, or those from which it follows."""
        return [self]


class Components(list[CaseNumber]):
    """Numbers of which there is one for each axis of the model."""


def tied_parameter(text: str) -> str | None:
    """The parameter to which a text such as ``0.6 $E_rock`` ties a number; None for another."""
    tie = _TIE.fullmatch(text.strip()) if len(text) <= _LONGEST else None
    return None if tie is None else tie[3]


def scalar_of(given: CaseNumber | None) -> Scalar | None:
    """The number for the model; None where nothing is given."""
    return None if given is None else given.scalar


@dataclass(frozen=True)
class QuantityType:
    """Annotation of a `CaseNumber`: what the number must be.

    Args:
        dimension: key of `geoident.units.DIMENSIONS`, or None for any.
        tied: ``$parameter`` is allowed.
        above: the number must be larger, if it is given.
        below: the number must be smaller, if it is given.
        signed: it may be negative.
        known_as: what people call such a quantity, where the dimension has the name of another.
        such_as: an example of it.
    """

    dimension: str | None
    tied: bool = False
    above: float | None = None
    below: float | None = None
    signed: bool = True
    known_as: str = ""
    such_as: str = ""

    def parse(self, value: object) -> CaseNumber:
        """The number that a text says.

        Raises:
            UnitError: no quantity, or one of another dimension.
            Refusal: no text, a tie where none may be, or a number outside its range.
        """
        if isinstance(value, CaseNumber):
            return value
        if isinstance(value, dict) and "field" in value:
            message = f"found a field; expected {self.words()}"
            raise Refusal("no-field", message, "Moduli and strengths of materials may be fields.")
        text = require_text(value, self.words())
        tie = _TIE.fullmatch(text.strip()) if len(text) <= _LONGEST else None
        if tie is not None and self.tied:
            factor = _factor(tie[1] or ("-1" if tie[2] else "1"), text)
            called = self.words() if self.known_as else ""
            return CaseNumber(
                text, factor, tie[3], self.dimension or "", may_be_tied=True, called=called
            )
        if text.strip().startswith("$") or tie is not None:
            raise self._refuse_tie(text, well_formed=tie is not None)
        given = self._quantity(text)
        _require_angle(given)
        return self._in_range(given)

    def words(self) -> str:
        """What is expected, for a message."""
        if self.known_as:
            return f"a {self.known_as}"
        return with_article(self.dimension) if self.dimension else "a number with its unit"

    def _quantity(self, text: str) -> CaseNumber:
        try:
            quantity = read_quantity(text, self.dimension or "")
        except UnitError as error:
            name = text.strip()
            if self.known_as and self.dimension:
                message = error.message.replace(with_article(self.dimension), self.words())
                error = UnitError(message, f"Write it like {self.such_as}, traction by motion.")
            if not (self.tied and re.fullmatch(NAME_PATTERN, name)):
                raise error from None
            tie = f"To tie it to a parameter of this name write ${shorten(name)}."
            raise UnitError(error.message, f"{tie} {error.hint}".strip()) from None
        return CaseNumber(
            text, quantity.value, None, quantity.dimension, quantity.unit, may_be_tied=self.tied
        )

    def _refuse_tie(self, text: str, *, well_formed: bool) -> Refusal:
        if self.tied and not well_formed:
            hint = "Write $NAME or FACTOR $NAME, such as 0.6 $E_rock."
            return Refusal("bad-tie", f"'{shorten(text)}' is not a tie to a parameter", hint)
        message = f"'{shorten(text)}': a parameter cannot be used here; expected {self.words()}"
        return Refusal("bad-tie", message, "Write the number itself.")

    def _in_range(self, given: CaseNumber) -> CaseNumber:
        if self.tied and self.above == 0.0 and 0.0 < given.factor < 1.0 / LARGEST:
            message = f"'{given.text}' is too small to be computed with"
            raise Refusal("out-of-range", message, "Check its exponent.")
        if not self.signed and given.factor < 0.0:
            raise Refusal("out-of-range", f"'{given.text}' is negative", "Drop the -.")
        too_small = self.above is not None and not given.factor > self.above
        too_large = self.below is not None and not given.factor < self.below
        if not (too_small or too_large):
            return given
        hint = "Correct the number or its unit."
        if self.below is None:
            limit = "be positive" if self.above == 0 else f"exceed {self.above:g}"
            hint = f"Write {self.words()}, such as {self._example()}."
        elif self.above is None:
            limit = f"be less than {self.below:g}"
        else:
            limit = f"be between {self.above:g} and {self.below:g}"
        raise Refusal("out-of-range", f"'{given.text}': it must {limit}", hint)

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(
            self.parse, serialization=_SERIALIZE_TEXT
        )

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return self.described()

    def described(self) -> dict[str, Any]:
        """The JSON schema of the number."""
        units = UNITS if self.dimension is None else units_of(self.dimension)
        tie = rf"|(({NUMBER_PATTERN}\s*\*?\s*)|-)?\${NAME_PATTERN}" if self.tied else ""
        pattern = rf"^\s*({quantity_pattern(units)}{tie})\s*$"
        kind = ["number", "string"] if self.dimension in {None, DIMENSIONLESS} else "string"
        return {
            "type": kind,
            "pattern": pattern,
            "patternErrorMessage": self._refuse(units),
            "description": self._describe(),
            "examples": [self._example()],
            "x-quantity": self._short(),
        }

    def _refuse(self, units: Collection[str]) -> str:
        """What an editor says where the pattern does not match."""
        known = ", ".join(unit for unit in units if unit)
        tie = ", or $NAME of a parameter" if self.tied else ""
        which = f" (units: {known})" if self.dimension and known else ""
        return f"{self.words()} is expected, such as {self._example()}{which}{tie}"

    def _example(self) -> str:
        """A number that is allowed there."""
        if self.dimension == "pressure" and self.above == 0:
            return self.such_as or "15 GPa"
        return self.such_as or _EXAMPLES[self.dimension]

    def _short(self) -> str:
        """What is allowed there, in a few words."""
        words = self.known_as or self.dimension if self.dimension != DIMENSIONLESS else "number"
        return f"{words or 'quantity'}{' or `$parameter`' if self.tied else ''}"

    def _describe(self) -> str:
        si = DIMENSIONS.get(self.dimension or "", "")
        text = f"{self.words()}{f' (SI: {si})' if si else ''}"
        return f"{text}, or $parameter with or without a factor" if self.tied else text


_LEAST_FACTOR, _MOST_FACTOR = 1e-12, 1e12


def _factor(number: str, text: str) -> float:
    """The factor of a tie.

    Raises:
        Refusal: it leaves nothing of its parameter, or no one can mean it.
    """
    factor = float(number)
    if factor == 0.0:
        message = f"'{shorten(text)}' is zero, whatever the parameter is"
        raise Refusal("out-of-range", message, "Write the number itself, or another factor.")
    if not _LEAST_FACTOR <= abs(factor) <= _MOST_FACTOR:
        message = f"'{shorten(text)}': expected a factor "
        raise Refusal(
            "out-of-range",
            f"{message}from {_LEAST_FACTOR:g} to {_MOST_FACTOR:g}",
            "Check its exponent.",
        )
    return factor


def _require_angle(given: CaseNumber) -> None:
    """Refuse an angle of more than a whole turn: it is in degrees, whatever unit it is given.

    Raises:
        Refusal: it is one.
    """
    if given.dimension != "angle" or abs(given.factor) <= _TURN:
        return
    message = f"'{given.text}' is an angle of {math.degrees(given.factor):.4g} degrees; "
    hint = "Correct the number or its unit."
    if given.unit == "rad":
        hint = f"Write '{given.text.replace('rad', 'deg')}' if these are degrees."
    raise Refusal("out-of-range", f"{message}expected at most 360", hint)


@dataclass(frozen=True)
class Count:
    """Annotation of an int: a whole number from ``least`` to ``most``."""

    least: int = 1
    most: int | None = None

    def parse(self, value: object) -> int:
        """The number that a text says.

        Raises:
            Refusal: no whole number, or too small.
        """
        text = str(value) if isinstance(value, int) else require_text(value, "a whole number")
        try:
            number = float(text)
        except ValueError:
            number = -1.5
        most = 10**9 if self.most is None else self.most
        if not number.is_integer() or not self.least <= number <= most:
            end = "on" if self.most is None else f"to {most}"
            message = f"'{shorten(text)}' is not a whole number from {self.least} {end}"
            raise Refusal("bad-count", message, "Write a number without decimals and unit.")
        return int(number)

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.parse)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        most = {} if self.most is None else {"maximum": self.most}
        return {"type": "integer", "minimum": self.least, **most}


@dataclass(frozen=True)
class SharesUnit:
    """Annotation of a list of quantities whose bare numbers take the unit of the last entry."""

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_before_validator_function(share_unit, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        described = handler(schema)
        return {**described, "items": {"anyOf": [described["items"], {"type": "number"}]}}


def quantity_pattern(units: Any) -> str:
    """Regular expression of a number with one of some units."""
    alternatives = "|".join(
        re.escape(unit).replace(r"\-", "-").replace(r"\ ", r"\s?") for unit in units if unit
    )
    needed = "?" if "" in units else ""
    return rf"{NUMBER_PATTERN}(\s*({alternatives})){needed}"


def or_words(described: dict[str, Any], *words: str) -> None:
    """Lets some words match, too, where the pattern of a number does.

    Args:
        described: the JSON schema of the number, which is changed.
        words: that may stand in its place.
    """
    number = described["pattern"].removeprefix(r"^\s*(").removesuffix(r")\s*$")
    described["pattern"] = rf"^\s*({'|'.join((number, *words))})\s*$"


def share_unit(value: object) -> object:
    """A list whose bare numbers take the unit of the last entry: ``[12.5, 3 m]``.

    >>> share_unit(["12.5", "3 m", None])
    ['12.5 m', '3 m', None]
    """
    texts = [x for x in value if x is not None] if isinstance(value, list) else []
    if not isinstance(value, list) or not texts or not isinstance(texts[-1], str):
        return value
    try:
        unit = read_quantity(texts[-1]).unit
    except UnitError:
        return value
    return [f"{x.strip()} {unit}".strip() if _is_bare(x) else x for x in value]


def _is_bare(value: object) -> bool:
    return (
        isinstance(value, str) and len(value) <= _LONGEST and bool(_BARE.fullmatch(value.strip()))
    )


_NUMBER_OR_TIE = re.compile(r"\s*(?:[-+.]?\s*[0-9]|[-+]?\s*\$)")


def level_or_group(value: object) -> str:
    """``level`` or ``group``: what begins as a number or a tie is a level, else it is a name."""
    if isinstance(value, CaseNumber):
        return "level"
    return "level" if _NUMBER_OR_TIE.match(str(value)) else "group"


@dataclass(frozen=True)
class Exactly:
    """Annotation of a list that has this number of entries, no fewer and no more."""

    entries: int

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_before_validator_function(self._counted, handler(source))

    def _counted(self, value: object) -> object:
        if isinstance(value, list) and len(value) != self.entries:
            count = f"found {len(value)} {'entry' if len(value) == 1 else 'entries'}"
            hint = f"Write {self.entries} of them, or remove the key if it need not be there."
            meant = _meant(value)
            if len(meant) == self.entries:
                hint = f"If a number has a decimal comma, write a point: [{', '.join(meant)}]."
                if len(value) == 1:
                    hint = f"Write [{', '.join(meant)}]."
            raise Refusal("wrong-kind", f"{count}; expected {self.entries}", hint)
        return value

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return {**handler(schema), "minItems": self.entries, "maxItems": self.entries}


def _meant(entries: list[Any]) -> list[str]:
    """The entries that were probably meant, where commas or their lack made others of them.

    >>> _meant(["0", "3 GPa", "30 GPa"]), _meant(["0.3 .. 3.0"])
    (['0.3 GPa', '30 GPa'], ['0.3', '3.0'])
    """
    if not all(isinstance(entry, str) and len(entry) <= _LONGEST for entry in entries):
        return []
    if len(entries) == 1:
        return _BETWEEN.split(entries[0].strip())
    meant: list[str] = []
    whole = False  # what was before it is the whole part of a number
    for entry in (entry.strip() for entry in entries):
        joined = whole and entry[:1].isdigit()
        if joined:
            meant[-1] += f".{entry}"
        else:
            meant.append(entry)
        whole = not joined and _WHOLE.fullmatch(entry) is not None
    return meant


class OrFile:
    """Annotation of a list or of rows that may also be the name of a CSV file, read before."""

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return {"anyOf": [handler(schema), {"type": "string"}]}


@dataclass(frozen=True)
class CountOr:
    """Annotation of a whole number from one on, or a word."""

    word: str

    def parse(self, value: object) -> int | str:
        """The number that a text says, or the word.

        Raises:
            Refusal: neither.
        """
        if value == self.word:
            return self.word
        try:
            return Count().parse(value)
        except Refusal as refusal:
            hint = f"Write '{self.word}', or a number without decimals and unit."
            raise Refusal("bad-count", f"{refusal.message}, or '{self.word}'", hint) from refusal

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.parse)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return {"anyOf": [{"type": "integer", "minimum": 1}, {"const": self.word}]}


def shape_of(value: object) -> str:
    """``text``, ``list`` or ``mapping``: tells the ways apart in which some keys can be written."""
    if isinstance(value, Mapping | BaseModel):
        return "mapping"
    return "list" if isinstance(value, list | tuple) else "text"


_A = TypeVar("_A")
_B = TypeVar("_B")
TextOrList = Annotated[
    Annotated[_A, Tag("text")] | Annotated[_B, Tag("list")],
    Discriminator(lambda value: "list" if shape_of(value) == "list" else "text"),
]
"""One value, or a list: ``TextOrList[VALUE, LIST]``."""
TextOrMapping = Annotated[
    Annotated[_A, Tag("text")] | Annotated[_B, Tag("mapping")],
    Discriminator(lambda value: "mapping" if shape_of(value) == "mapping" else "text"),
]
"""One value, or a mapping: ``TextOrMapping[VALUE, MAPPING]``."""
TEXT_LIST_OR_MAPPING = Discriminator(shape_of)

# A number that may be tied to a parameter has a plain name; of one that may not it is `Fixed...`.
Stress = Annotated[CaseNumber, QuantityType("pressure", tied=True)]
Modulus = Annotated[CaseNumber, QuantityType("pressure", tied=True, above=0.0)]
Ratio = Annotated[CaseNumber, QuantityType(DIMENSIONLESS, tied=True, above=-1.0, below=0.5)]
Pressure = Annotated[CaseNumber, QuantityType("pressure", tied=True, signed=False)]
Density = Annotated[CaseNumber, QuantityType("density", tied=True, signed=False)]
Angle = Annotated[CaseNumber, QuantityType("angle", tied=True)]
FrictionAngle = Annotated[CaseNumber, QuantityType("angle", tied=True, signed=False)]
UnitWeight = Annotated[CaseNumber, QuantityType("unit weight", tied=True)]
Length = Annotated[CaseNumber, QuantityType("length", tied=True)]
Drift = Annotated[CaseNumber, QuantityType("velocity", tied=True)]
Coefficient = Annotated[CaseNumber, QuantityType(DIMENSIONLESS, tied=True)]
Force = Annotated[CaseNumber, QuantityType("force", tied=True)]
LineForce = Annotated[CaseNumber, QuantityType("line load", tied=True)]
TemperatureChange = Annotated[CaseNumber, QuantityType("temperature", tied=True)]
Expansion = Annotated[CaseNumber, QuantityType("expansion", tied=True)]
Conductivity = Annotated[CaseNumber, QuantityType("conductivity", tied=True, above=0.0)]
HeatCapacity = Annotated[CaseNumber, QuantityType("heat capacity", tied=True, above=0.0)]
SpecificHeat = Annotated[CaseNumber, QuantityType("specific heat", tied=True, above=0.0)]
FilmCoefficient = Annotated[CaseNumber, QuantityType("film coefficient", tied=True, above=0.0)]
Permeability = Annotated[CaseNumber, QuantityType("velocity", tied=True)]
Compressibility = Annotated[CaseNumber, QuantityType("compressibility", tied=True)]
Diffusivity = Annotated[CaseNumber, QuantityType("diffusivity", tied=True, above=0.0)]
FixedTemperature = Annotated[CaseNumber, QuantityType("temperature")]
Size = Annotated[CaseNumber, QuantityType("length", tied=True, above=0.0)]
Area = Annotated[CaseNumber, QuantityType("area", tied=True, above=0.0)]
Multiple = Annotated[CaseNumber, QuantityType(DIMENSIONLESS, tied=True, above=0.0)]
AxialStiffness = Annotated[CaseNumber, QuantityType("force", tied=True, above=0.0)]
WallStiffness = Annotated[CaseNumber, QuantityType("line load", tied=True, above=0.0)]
WallSubgrade = Annotated[
    CaseNumber,
    QuantityType(
        "unit weight", tied=True, above=0.0, known_as="stiffness per area", such_as="100 MPa/m"
    ),
]
WallMoment = Annotated[CaseNumber, QuantityType("moment per length", tied=True, above=0.0)]
FlexuralRigidity = Annotated[CaseNumber, QuantityType("flexural rigidity", tied=True, above=0.0)]
BendingStiffness = Annotated[CaseNumber, QuantityType("bending stiffness", tied=True, above=0.0)]
Time = Annotated[CaseNumber, QuantityType("time", tied=True, above=0.0)]
Viscosity = Annotated[CaseNumber, QuantityType("viscosity", tied=True, above=0.0)]
FixedStress = Annotated[CaseNumber, QuantityType("pressure")]
FixedStrength = Annotated[CaseNumber, QuantityType("pressure", above=0.0)]
FixedPressure = Annotated[CaseNumber, QuantityType("pressure", signed=False)]
FixedLength = Annotated[CaseNumber, QuantityType("length")]
FixedMultiple = Annotated[CaseNumber, QuantityType(DIMENSIONLESS, above=0.0)]
FixedCoefficient = Annotated[CaseNumber, QuantityType(DIMENSIONLESS)]
FixedAngle = Annotated[CaseNumber, QuantityType("angle")]
FixedSize = Annotated[CaseNumber, QuantityType("length", above=0.0)]
FixedTime = Annotated[CaseNumber, QuantityType("time")]
FixedUnitWeight = Annotated[CaseNumber, QuantityType("unit weight", above=0.0)]
FixedDuration = Annotated[CaseNumber, QuantityType("time", above=0.0)]
FixedAcceleration = Annotated[CaseNumber, QuantityType("acceleration")]
AnyQuantity = Annotated[CaseNumber, QuantityType(None)]


def _not_kelvin(given: CaseNumber) -> CaseNumber:
    """A temperature, not a difference of two.

    Raises:
        Refusal: it is in kelvin.
    """
    if given.unit == "K":
        message = f"'{given.text}' is in kelvin, in which differences of temperatures are given"
        raise Refusal("unit", message, "Write a temperature like 12 degC.")
    return given


CelsiusTemperature = Annotated[TemperatureChange, AfterValidator(_not_kelvin)]


def _in_order(bounds: list[CaseNumber]) -> list[CaseNumber]:
    """Bounds of which the lower is below the upper, as far as they can be compared.

    Raises:
        Refusal: it is not.
    """
    lower, upper = bounds
    if lower.dimension == upper.dimension and lower.factor >= upper.factor:
        message = f"the lower bound '{lower.text}' is not below the upper '{upper.text}'"
        hint = f"Write [{upper.text}, {lower.text}]." if lower.factor > upper.factor else ""
        raise Refusal("bad-bounds", message, hint or "Let them differ.")
    return bounds


_SHARED = "; bare numbers take the unit of the last entry, as in [12.5, 3 m]"
Coordinates = Annotated[
    list[FixedLength],
    AfterValidator(Components),
    SharesUnit(),
    Field(description=f"Coordinates, 2 in plane strain and 3 in a solid{_SHARED}."),
]
Line = Annotated[list[Coordinates], Exactly(2)]
Bounds = Annotated[
    list[AnyQuantity],
    AfterValidator(_in_order),
    SharesUnit(),
    Exactly(2),
    Field(description=f"Lower and upper bound{_SHARED}."),
]
Accelerations = Annotated[list[FixedAcceleration], AfterValidator(Components), SharesUnit()]
Stresses = Annotated[list[Stress], AfterValidator(Components), SharesUnit()]
Permeabilities = Annotated[list[Permeability], AfterValidator(Components), SharesUnit()]
Forces = Annotated[list[Force], AfterValidator(Components), SharesUnit()]
LineForces = Annotated[list[LineForce], AfterValidator(Components), SharesUnit()]
TemperatureValues = Annotated[
    list[Annotated[CaseNumber, QuantityType("temperature")]], SharesUnit()
]
Coefficients = Annotated[list[Coefficient], AfterValidator(Components)]
DirectionVector = list[Annotated[CaseNumber, QuantityType(DIMENSIONLESS)]]
_GROUP = {"type": "string", "pattern": "^[^-+.$0-9]", "description": "name of a group of faces"}
LevelOrGroup = Annotated[
    Annotated[Length, Tag("level")] | Annotated[Name, WithJsonSchema(_GROUP), Tag("group")],
    Discriminator(level_or_group),
]

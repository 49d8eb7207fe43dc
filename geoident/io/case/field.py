"""Constants that vary from place to place: their section, tests that measured them, their field.

    E: {field: {mean: $E_rock, sd: 30 %, length: [20 m, 5 m], along: {dip: 30 deg}}}

Files of tests are written into the case before it is validated, so that the resolved case holds
their numbers and a result needs no file beside it:

    x [m], y [m], E [GPa], accuracy [GPa]
    12.5,  40,    14.2,    1.0
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, TypeAlias

from pydantic import (
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    Tag,
    model_validator,
)
from pydantic_core import CoreSchema, core_schema

from geoident.errors import Fault, InputError, Location
from geoident.io.case.frames import attitude, axes_along
from geoident.io.schema.section import Context, Section, refuse, require_one_of
from geoident.io.schema.values import (
    Angle,
    AnyQuantity,
    Coordinates,
    Count,
    DirectionVector,
    Given,
    GivenAngle,
    GivenSize,
    Modulus,
    Positive,
    SharesUnit,
    Stress,
    Text,
    shape_of,
)
from geoident.io.text.faults import Faults, Places
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.wording import did_you_mean, shorten
from geoident.io.text.yaml_reader import Node
from geoident.model.case import KeyPath, format_path
from geoident.model.ground import Attitude, Axes, PointValue
from geoident.model.ground import Field as RandomField
from geoident.units import (
    DIMENSIONLESS,
    UnitError,
    normal_unit,
    read_quantity,
    require_dimension,
    size_in,
    with_article,
)

_AXES = ("x", "y", "z")
_LIMIT = 10 * 10**6  # bytes
_MOST_SD = 2.0
_SMOOTHEST = 10.0
_ROUGHEST = 0.1
_HEADER = "Begin with a line such as 'x [m], y [m], value [GPa]' ('accuracy [GPa]' may follow)."


class AlongSection(Section):
    """The axes of a field's correlation lengths, as strata lie: by angles, or by two vectors.

    Axis 1 goes down the dip, 2 along the strike, 3 along the normal; `rotation` turns 1 and 2.
    """

    dip: GivenAngle | None = Field(
        None, description="Inclination of axis 1; in 2-D it falls towards +x.", examples=["30 deg"]
    )
    dip_direction: GivenAngle | None = Field(
        None, description="Azimuth of the line of dip, clockwise from north (y) in a solid."
    )
    rotation: GivenAngle | None = Field(
        None, description="Turns axes 1 and 2 about the normal, right-handed; 0 if missing."
    )
    axis_1: DirectionVector | None = Field(
        None, description="Axis 1 in place of the angles, in x, y, z; its length does not matter."
    )
    axis_2: DirectionVector | None = Field(
        None, description="Axis 2, at a right angle to 1, in x, y, z."
    )

    @model_validator(mode="after")
    def _one_way(self) -> AlongSection:
        ways = [("dip",), ("dip", "rotation"), ("dip", "dip_direction"), ("axis_1", "axis_2")]
        ways += [("dip", "dip_direction", "rotation")]
        expected = "dip (with dip_direction and rotation), or axis_1 with axis_2, is"
        require_one_of(self, ways, expected, "Along the model's axes: leave out 'along'.")
        return self

    def frame(self, context: Context) -> Attitude | Axes:
        """The axes for the model."""
        if self.axis_1 is not None and self.axis_2 is not None:
            return axes_along(context, self.axis_1, self.axis_2)
        return attitude(context, self.dip, self.dip_direction, self.rotation)


class PointValueSection(Section):
    """The value of the constant at a point, from a test there."""

    at: Coordinates
    value: AnyQuantity = Field(description="What was measured.", examples=["12 GPa"])
    accuracy: AnyQuantity | None = Field(
        None,
        description="Standard deviation of the value as one of the ground around (also of how far "
        "a small sample stands for an element), in its unit or in %; exact if missing.",
    )
    line: Annotated[int, Count()] | None = Field(
        None, description="Line of the file from which it comes."
    )


class PointFileSection(Section):
    """A CSV file of measured values, with the columns x, y (z), value and perhaps accuracy."""

    file: Text = Field(description="Path of the file, relative to the case.")
    values: list[PointValueSection] = Field(
        [], description="What it holds; read from the file if missing."
    )


def _wrong_lengths(number: int, dim: int) -> tuple[str, str]:
    """What is wrong with a number of correlation lengths in a model, and the remedy."""
    found = "found no length" if number == 0 else f"found {number} lengths"
    if dim == 2:
        hint = "Write one length, or [along the dip, normal to it], such as [20 m, 5 m]."
        return f"{found}; one, or two for the axes of a plane model, expected", hint
    hint = "Write one length, or one for each axis of `along`, such as [30 m, 20 m, 5 m]."
    return f"{found}; one, two or three expected", hint


def _entry(value: object) -> str:
    if isinstance(value, str):
        return "<file name>"
    named = "file" in value if isinstance(value, dict) else isinstance(value, PointFileSection)
    return "<file>" if named else "<point>"


Measured = Annotated[
    Annotated[Text, Tag("<file name>")]
    | Annotated[PointFileSection, Tag("<file>")]
    | Annotated[PointValueSection, Tag("<point>")],
    Discriminator(_entry),
]
Lengths = Annotated[
    Annotated[GivenSize, Tag("text")]
    | Annotated[
        list[GivenSize],
        SharesUnit(),
        Field(json_schema_extra={"minItems": 1, "maxItems": 3}),
        Tag("list"),
    ],
    Discriminator(shape_of),
]


class FieldBase(Section):
    """A constant that varies from place to place: a lognormal random field."""

    mean: AnyQuantity = Field(description="Median of the values.")
    sd: AnyQuantity = Field(
        description="Standard deviation: that of the logarithm, in %, or in the unit of a mean "
        "that is a number.",
        examples=["30 %"],
    )
    length: Lengths = Field(
        description="Correlation length: one in all directions, or one along each axis of `along` "
        "(in 2-D along the dip and normal to it; in a solid along axes 1, 2 and 3, or in the plane "
        "of 1 and 2 and normal to it).",
        examples=[["20 m", "5 m"]],
    )
    along: AlongSection | None = Field(
        None, description="How the axes of the lengths lie; along the model's axes if missing."
    )
    smoothness: Positive = Field(
        Given("1.5", 1.5, None, DIMENSIONLESS),
        description="Smoothness nu of the Matern correlation: 0.5 is exponential (rough), 1.5 once "
        "differentiable, 2.5 twice.",
    )
    modes: Annotated[int, Count()] | None = Field(
        None,
        description="Most modes; if missing, those that hold 99 % of the variance (up to 300).",
    )
    measured: list[Measured] = Field(
        [],
        description="Values from tests at points, through which the field passes: CSV files (x, y, "
        "value, accuracy, with units in the header), or points.",
        examples=[["boreholes.csv"]],
    )

    @model_validator(mode="after")
    def _in_range(self) -> FieldBase:
        nu = self.smoothness.factor
        if not _ROUGHEST <= nu <= _SMOOTHEST:
            message = f"'{self.smoothness.text}': it must be between {_ROUGHEST:g} and "
            message += f"{_SMOOTHEST:g}"
            refuse(("smoothness",), "out-of-range", message, "Write 0.5, 1.5 or 2.5.")
        mean, sd = self.mean, self.sd
        if mean.parameter is None and mean.factor <= 0:
            message = f"'{mean.text}': the mean of a field must be positive"
            refuse(("mean",), "out-of-range", message, "A field is lognormal.")
        if sd.dimension not in (DIMENSIONLESS, mean.dimension):
            message = f"'{sd.text}' is {with_article(sd.dimension)}; a part of the mean in % or "
            message += f"{with_article(mean.dimension)} is expected"
            refuse(("sd",), "unit", message, "Write it such as 30 %.")
        if sd.dimension != DIMENSIONLESS and mean.parameter is not None:
            message = f"'{sd.text}': where the mean is a parameter, the scatter is a part of it"
            refuse(("sd",), "unit", message, "Write it in %, such as 30 %.")
        relative = self.relative_sd
        if not 0 < relative <= _MOST_SD:
            message = f"'{sd.text}' is {100 * relative:.4g} % of the mean; it must be above 0 "
            message += f"and up to {100 * _MOST_SD:g} %"
            hint = f"Did you mean '{sd.text} %'?" if sd.unit == "" and sd.factor > 1 else ""
            refuse(("sd",), "out-of-range", message, hint or "Correct the number or its unit.")
        return self

    @property
    def relative_sd(self) -> float:
        """The standard deviation as a part of the mean, and so that of the logarithm."""
        if self.sd.dimension == DIMENSIONLESS:
            return self.sd.factor
        return self.sd.factor / self.mean.factor

    def built(
        self, context: Context, *, material: str, constant: str, surface: int | None
    ) -> RandomField:
        """The field for the model; what does not fit the analysis is noted as a fault.

        Args:
            context: of the key `field`.
            material: of which it is.
            constant: its name in the model.
            surface: index of the yield surface whose strength it is, or None.
        """
        mean = self.mean
        along = self.along.frame(context.at("along")) if self.along is not None else None
        given = self.length if isinstance(self.length, list) else [self.length]
        if not 1 <= len(given) <= context.dim:
            context.at("length").refuse("wrong-dimension", *_wrong_lengths(len(given), context.dim))
        points = [
            value
            for entry, place in self._entries(context.at("measured"))
            if (value := _point_value(entry, mean, *place)) is not None
        ]
        _check_repeated(points, context.at("measured"))
        return RandomField(
            material=material,
            constant=constant,
            mean=mean.scalar,
            sd=self.relative_sd,
            lengths=tuple(length.factor for length in given),
            frame=along or _upright(context),
            smoothness=self.smoothness.factor,
            modes=self.modes,
            measured=tuple(points),
            surface=surface,
            dimension=mean.dimension,
            unit=mean.unit,
            path=context.path,
        )

    def _entries(self, context: Context) -> Iterator[tuple[PointValueSection, tuple[Context, str]]]:
        """Every measured value with its place and with where it comes from."""
        for n, entry in enumerate(self.measured):
            place = context.at(n)
            if isinstance(entry, PointValueSection):
                yield entry, (place, "")
            elif isinstance(entry, PointFileSection):
                for k, value in enumerate(entry.values):
                    line = "" if value.line is None else f", line {value.line}"
                    yield value, (place.at("values", k), f"{entry.file}{line}")


class ModulusFieldSection(FieldBase):
    """A modulus or a strength that varies from place to place: a lognormal random field."""

    mean: Modulus = Field(description="Median of the values.", examples=["$E_rock"])


class AngleFieldSection(FieldBase):
    """An angle of strength that varies from place to place: a lognormal random field."""

    mean: Angle = Field(description="Median of the values.", examples=["35 deg"])


class VariedModulusSection(Section):
    """In place of one number: a field."""

    field: ModulusFieldSection = Field(description="How it varies from place to place.")


class VariedAngleSection(Section):
    """In place of one number: a field."""

    field: AngleFieldSection = Field(description="How it varies from place to place.")


@dataclass(frozen=True)
class FieldOf:
    """Annotation of a `Given`: it is written as a field, and the number is its mean."""

    section: type[Section]

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        def mean_of(section: Any) -> Given:
            mean: Given = section.field.mean
            return replace(mean, field=section.field)

        def written(given: Given) -> Any:
            return {"field": given.field.model_dump(by_alias=True, exclude_none=True)}

        return core_schema.no_info_after_validator_function(
            mean_of,
            handler.generate_schema(self.section),
            serialization=core_schema.plain_serializer_function_ser_schema(written),
        )

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return handler(schema)


def _number_or_field(value: object) -> str:
    varied = value.field is not None if isinstance(value, Given) else isinstance(value, dict)
    return "<field>" if varied else "<number>"


FieldModulus = Annotated[
    Annotated[Modulus, Tag("<number>")]
    | Annotated[Given, FieldOf(VariedModulusSection), Tag("<field>")],
    Discriminator(_number_or_field),
]
FieldStrength = Annotated[
    Annotated[Stress, Tag("<number>")]
    | Annotated[Given, FieldOf(VariedModulusSection), Tag("<field>")],
    Discriminator(_number_or_field),
]
FieldAngle = Annotated[
    Annotated[Angle, Tag("<number>")]
    | Annotated[Given, FieldOf(VariedAngleSection), Tag("<field>")],
    Discriminator(_number_or_field),
]


def fields_in(
    section: Section,
    context: Context,
    *,
    material: str,
    surface: int | None = None,
    names: Mapping[str, str] | None = None,
) -> tuple[RandomField, ...]:
    """The fields among the numbers of a section.

    Args:
        section: of a material, or of one of its yield surfaces.
        context: of the section.
        material: name of the material.
        surface: index of the yield surface, or None.
        names: key to the constant's name in the model, where it is another one.
    """
    found = []
    for name in type(section).model_fields:
        given = getattr(section, name)
        if isinstance(given, Given) and isinstance(given.field, FieldBase):
            place, constant = context.at(name, "field"), (names or {}).get(name, name)
            found.append(
                given.field.built(place, material=material, constant=constant, surface=surface)
            )
    return tuple(found)


def _upright(context: Context) -> Attitude | Axes:
    """Axis 1 along x, 3 upwards: in a section strata that lie flat, in a solid x, y, z."""
    if context.dim == 2:
        return attitude(context, None, None)
    return Axes((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))


def _point_value(
    section: PointValueSection, mean: Given, context: Context, origin: str
) -> PointValue | None:
    """One measured value; None, with a fault, where it is none."""
    position = context.at("at").vector(section.at, "the point")
    whence = f" ({origin})" if origin else ""
    value, accuracy = section.value, section.accuracy
    wrong = False
    if value.dimension != mean.dimension:
        message = f"'{value.text}' is {with_article(value.dimension)}; "
        message += f"{with_article(mean.dimension)} is expected{whence}"
        context.at("value").refuse("unit", message, "Write it in the dimension of the mean.")
        wrong = True
    elif value.factor <= 0:
        message = f"'{value.text}': a field is positive everywhere{whence}"
        context.at("value").refuse("out-of-range", message, "Correct the number, or remove it.")
        wrong = True
    if accuracy is not None and accuracy.dimension not in (DIMENSIONLESS, mean.dimension):
        message = f"'{accuracy.text}' is {with_article(accuracy.dimension)}; a part of the value "
        message += f"in % or {with_article(mean.dimension)} is expected{whence}"
        context.at("accuracy").refuse("unit", message, "Write it in the unit of the value.")
        wrong = True
    elif accuracy is not None and accuracy.factor < 0:
        message = f"'{accuracy.text}': a standard deviation is not negative{whence}"
        context.at("accuracy").refuse("out-of-range", message, "Write 0 for an exact value.")
        wrong = True
    if wrong or position is None:
        return None
    deviation = 0.0
    if accuracy is not None:
        part = accuracy.dimension == DIMENSIONLESS
        deviation = accuracy.factor * (value.factor if part else 1.0)
    where = context.path[context.path.index("measured") :]
    return PointValue(position, value.factor, deviation, origin, where)


def _check_repeated(points: list[PointValue], context: Context) -> None:
    """Note exact values that contradict each other at one point."""
    exact: dict[tuple[float, ...], PointValue] = {}
    for point in points:
        if point.accuracy > 0:
            continue
        first = exact.setdefault(point.position, point)
        if first.value != point.value:
            where = ", ".join(f"{x:g}" for x in point.position)
            named = f" ({first.origin}; {point.origin})" if point.origin else ""
            message = f"two exact values at ({where}) m differ{named}"
            context.refuse("contradiction", message, "Give their accuracy, or remove one.")


# Files of measured values.

_Row: TypeAlias = "list[tuple[str, int]]"


def with_measured(places: Places, folder: Path, faults: Faults) -> Places:
    """The case with the values of the files that its fields name.

    Args:
        places: the case.
        folder: of the case.
        faults: is told where a file cannot be read, or is no table of measured values.
    """
    wanted = list(_named(places.data))
    if not wanted:
        return places
    data = deepcopy(places.data)
    solid = isinstance(places.data, dict) and places.data.get("analysis") == "solid"
    for path, name in wanted:
        dimension = "angle" if path[-4] == "friction" else "pressure"
        before = len(faults.found)
        values = _Table(folder / name, path, solid=solid, dimension=dimension).read(faults)
        if len(faults.found) > before:
            faults.spoils(path)
        node: Any = data
        for step in path[:-1]:
            node = node[step]
        node[path[-1]] = {"file": name, "values": values}
    return replace(places, data=data)


def _named(data: Node) -> list[tuple[KeyPath, str]]:
    """Every file of measured values that is given by its name alone, with the path of its entry."""
    materials = data.get("materials") if isinstance(data, dict) else None
    found: list[tuple[KeyPath, str]] = []

    def visit(node: Node, path: KeyPath) -> None:
        if isinstance(node, list):
            for n, part in enumerate(node):
                visit(part, (*path, n))
        if not isinstance(node, dict):
            return
        for key, part in node.items():
            measured = part.get("measured") if key == "field" and isinstance(part, dict) else None
            for n, entry in enumerate(measured if isinstance(measured, list) else ()):
                name = entry.get("file") if isinstance(entry, dict) else entry
                bare = isinstance(entry, str) or (isinstance(entry, dict) and "values" not in entry)
                if isinstance(name, str) and bare:
                    found.append(((*path, key, "measured", n), name))
            visit(part, (*path, key))

    visit(materials, ("materials",))
    return found


@dataclass(frozen=True)
class _Table:
    """A file of measured values.

    Args:
        file: its path.
        path: of the entry of the case that names it.
        solid: points have three coordinates.
        dimension: of the values.
    """

    file: Path
    path: KeyPath
    solid: bool
    dimension: str

    def read(self, faults: Faults) -> list[Node]:
        """Its values as they would be written in the case."""
        try:
            text = decode(
                read_bytes(str(self.file), limit=_LIMIT, what="table of measured values"),
                str(self.file),
            )
        except InputError as error:
            first = error.faults[0]
            beside = self._beside() if first.code == "unreadable-file" else ""
            message = f"'{shorten(self.file.name)}': {first.message}"
            faults.add(self.path, first.code, message, beside or first.hint)
            return []
        lines = text.splitlines()
        delimiter = ";" if lines and ";" in lines[0] else ","
        rows = [_cells(line, delimiter) for line in lines]
        columns = self._columns(rows[0] if rows else [], faults)
        if columns is None:
            return []
        found: list[Node] = []
        for number, row in enumerate(rows[1:], start=2):
            if any(text for text, _ in row):
                value = self._value(row, number, columns, faults)
                found += [] if value is None else [value]
        if len(rows) < 2:
            self._fault(faults, 1, 1, "bad-table", "the table has no row", _HEADER)
        return found

    def _beside(self) -> str:
        try:
            names = [p.name for p in self.file.parent.iterdir() if p.suffix == self.file.suffix]
        except OSError:
            return ""
        return did_you_mean(self.file.name, names, what="Files there")

    def _fault(
        self, faults: Faults, line: int, column: int, code: str, message: str, hint: str = ""
    ) -> None:
        place = Location(str(self.file), line, column)
        faults.extend([Fault(code, message, hint, place, format_path(self.path))])

    def _columns(self, header: _Row, faults: Faults) -> dict[str, tuple[int, str]] | None:
        """Coordinate, ``value`` or ``accuracy`` to its place and its unit; None with a fault."""
        axes = _AXES if self.solid else _AXES[:2]
        constant = str(self.path[-4])
        known = {name: name for name in (*axes, "value", "accuracy")} | {constant: "value"}
        found: dict[str, tuple[int, str]] = {}
        before = len(faults.found)
        for n, (title, at) in enumerate(header):
            name, unit = _title(title)
            meant = known.get(name)
            if meant is None:
                message = f"the column '{shorten(title)}' is not known here"
                hint = did_you_mean(name, known, what="Columns")
                self._fault(faults, 1, at, "unknown-column", message, hint)
                continue
            if meant in found:
                message = f"the column '{meant}' is there twice"
                self._fault(faults, 1, at, "duplicate-column", message, "Remove one.")
                continue
            dimension = "length" if meant in _AXES else self.dimension
            found[meant] = (n, self._unit(unit, dimension, meant, title, at, faults))
        for name in (*axes, "value"):
            if name not in found and len(faults.found) == before:
                message = f"there is no column '{name}'"
                self._fault(faults, 1, 1, "missing-column", message, _HEADER)
        return found if len(faults.found) == before else None

    def _unit(
        self, unit: str, dimension: str, name: str, title: str, at: int, faults: Faults
    ) -> str:
        """The unit of a column, in its usual spelling; noted as a fault where it is none."""
        if name == "accuracy" and unit.strip() == "%":
            return "%"
        try:
            normal = normal_unit(unit, dimension)
        except UnitError as error:
            self._fault(faults, 1, at, "unit", error.message, error.hint)
            return unit
        if not unit or size_in(normal, dimension) is None:
            message = f"'{shorten(title)}' has no unit of {with_article(dimension)}"
            hint = f"Write it in brackets, such as '{name} [{'m' if name in _AXES else 'GPa'}]'."
            self._fault(faults, 1, at, "unit", message, hint)
        return normal

    def _value(
        self, row: _Row, line: int, columns: dict[str, tuple[int, str]], faults: Faults
    ) -> dict[str, Node] | None:
        """A row as an entry of the case; None, with a fault, where it is none."""
        written: dict[str, str] = {}
        before = len(faults.found)
        if len(row) > len(columns):
            message = f"found {len(row)} cells; {len(columns)} expected"
            hint = "Remove what is too much; a decimal comma is written as a point."
            self._fault(faults, line, row[len(columns)][1], "bad-row", message, hint)
        for name, (n, unit) in columns.items():
            text, at = row[n] if n < len(row) else ("", 1)
            if name == "accuracy" and not text:
                continue
            try:
                dimension = "length" if name in _AXES else self.dimension
                quantity = read_quantity(f"{text} {unit}", DIMENSIONLESS if unit == "%" else "")
                if unit != "%":
                    require_dimension(quantity, dimension, text)
                written[name] = f"{text} {unit}"
            except UnitError:
                what = f"'{shorten(text)}' is no number" if text else "the cell is empty"
                hint = f"Write the {name} in {unit} as a number, or remove the row."
                self._fault(faults, line, at, "bad-number", f"{what} ({name})", hint)
        if len(faults.found) > before:
            return None
        entry: dict[str, Node] = {
            "at": [written[axis] for axis in _AXES if axis in written],
            "value": written["value"],
            "line": str(line),
        }
        return entry | ({"accuracy": written["accuracy"]} if "accuracy" in written else {})


def _cells(line: str, delimiter: str) -> _Row:
    """The cells of a line without blanks around, each with its column in the line, from 1."""
    cells, at = [], 0
    for raw in line.split(delimiter):
        start = at + len(raw) - len(raw.lstrip()) + 1
        cells.append((raw.strip().strip('"').strip(), start))
        at += len(raw) + 1
    return cells


def _title(text: str) -> tuple[str, str]:
    """Name and unit of a column: ``E [GPa]`` or ``E (GPa)``."""
    for opening, closing in ("[]", "()"):
        if text.endswith(closing) and opening in text:
            name, _, unit = text[:-1].partition(opening)
            return name.strip(), unit.strip()
    return text.strip(), ""

"""Laboratory and field tests: each is a small model that the case does not have to describe.

`with_tests` writes the key `tests` of a case as its mesh, supports, stages, gauges and readings,
before the case is validated. All that computes, fits and reports a case does so with tests, too.
Tests of one kind of specimen share a mesh of unit size: each begins anew from the initial state, on
a branch of stages of its own, and takes its rows one by one.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from geoident.io.case.gauges.accuracy import StandardDeviationOf
from geoident.io.schema.faults import add_schema_faults
from geoident.io.schema.section import Section, SectionFaults
from geoident.io.schema.values import (
    CaseNumber,
    FixedStress,
    Name,
    QuantityType,
    SharesUnit,
)
from geoident.io.text.faults import Faults, Places
from geoident.io.text.yaml_reader import Node

Pressure = Annotated[CaseNumber, QuantityType("pressure", above=0.0)]
Pressures = Annotated[list[FixedStress], Field(min_length=1), SharesUnit()]
Strains = Annotated[
    list[Annotated[CaseNumber, QuantityType("strain")]], Field(min_length=1), SharesUnit()
]
PressureError = Annotated[CaseNumber, StandardDeviationOf("pressure", above=0.0, usual=False)]
StrainError = Annotated[CaseNumber, StandardDeviationOf("strain", above=0.0, usual=False)]

BESIDE_TESTS = ("format", "title", "parameters", "materials", "tests", "bad", "fit", "report")
"""Keys of a case of tests; all others follow from the tests."""

COLUMNS: Mapping[str, Mapping[str, str]] = {
    "triaxial": {
        "axial_strain": "strain",
        "deviator_stress": "pressure",
        "volumetric_strain": "strain",
    },
    "oedometer": {"vertical_stress": "pressure", "axial_strain": "strain"},
}
"""Kind of test to the columns of its readings and their dimensions; the first is imposed."""

_MIDDLE: Node = ["0.5 m", "0.5 m"]


class RowsSection(Section):
    """Rows of a test, column by column, or a CSV file whose first line names the columns."""

    def check(self, faults: SectionFaults) -> None:
        """All columns are as long as the first."""
        columns = {name: getattr(self, name) for name in type(self).model_fields}
        first = next(iter(columns))
        for name, values in columns.items():
            if values is not None and len(values) != len(columns[first]):
                message = f"{len(values)} values for {len(columns[first])} of {first}"
                faults.add((name,), "wrong-number", message, "Write one value for each row.")


class TriaxialRows(RowsSection):
    """Rows of a triaxial test: `{axial_strain: [0.5, 1 %], deviator_stress: [60, 80 kPa]}`.

    A file begins with a line such as 'axial_strain [%], deviator_stress [kPa]'. Strains and
    stresses are positive in compression and count from the end of consolidation.
    """

    axial_strain: Strains = Field(description="Imposed, row by row.")
    deviator_stress: Pressures | None = Field(None, description="Axial less radial stress.")
    volumetric_strain: Strains | None = Field(None, description="Of the specimen.")


class OedometerRows(RowsSection):
    """Rows of an oedometer test: `{vertical_stress: [50, 100 kPa], axial_strain: [0.8, 1.5 %]}`.

    A file begins with a line such as 'vertical_stress [kPa], axial_strain [%]'. Stresses may fall
    again (unloading). Strains are positive in compression and count from the seating stress.
    """

    vertical_stress: Pressures = Field(description="Effective, imposed, row by row.")
    axial_strain: Strains | None = Field(None, description="Settlement by height.")


class TestSection(Section):
    """A test in the laboratory."""

    rows: ClassVar[str]
    """The column that is imposed."""

    material: Name = Field(description="The material of the specimen, one of `materials`.")

    @property
    @abstractmethod
    def initial(self) -> float:
        """The stress in the specimen at its beginning, the same in all directions, Pa."""

    @abstractmethod
    def begin(self) -> dict[str, Node]:
        """What the stage does at whose end its gauges read zero."""

    @abstractmethod
    def step(self, value: float) -> dict[str, Node]:
        """What the stage of a row does that imposes a value, SI."""

    @abstractmethod
    def gauge(self, column: str) -> dict[str, Node]:
        """The gauge that reads a column, without its accuracy and zero."""

    def check(self, faults: SectionFaults) -> None:
        """What was read has an accuracy."""
        readings, accuracy = getattr(self, "readings"), getattr(self, "accuracy")  # noqa: B009
        for column in type(accuracy).model_fields:
            if getattr(readings, column) is not None and getattr(accuracy, column) is None:
                message = f"the accuracy of '{column}', which was read, is missing"
                hint = f"Add the standard deviation of one value: accuracy: {{{column}: ...}}."
                faults.add(("accuracy",), "missing-key", message, hint)


class TriaxialAccuracy(Section):
    """Standard deviation of one value of each column; with it alone the column is predicted."""

    deviator_stress: PressureError | None = Field(None, description="Of the deviator stress.")
    volumetric_strain: StrainError | None = Field(None, description="Of the volumetric strain.")


class OedometerAccuracy(Section):
    """Standard deviation of one value of each column; with it alone the column is predicted."""

    axial_strain: StrainError | None = Field(None, description="Of the strain.")


class TriaxialSection(TestSection):
    """Drained triaxial test: axial strain is imposed under a constant cell pressure.

    Its channels are `TEST deviator stress` and `TEST volumetric strain`, its stages `TEST
    consolidated` and one for each row, such as `TEST at 1.5 %`.
    """

    rows = "axial_strain"
    kind: Literal["triaxial"]
    cell_pressure: Pressure = Field(description="Effective, after consolidation.")
    readings: TriaxialRows = Field(description="Rows, or the name of a CSV file that has them.")
    accuracy: TriaxialAccuracy = Field(description="Accuracy by column.")

    @property
    def initial(self) -> float:
        """All around."""
        return self.cell_pressure.factor

    def begin(self) -> dict[str, Node]:
        """Consolidation."""
        return {"loads": _loads(side=self.initial, top=self.initial)}

    def step(self, value: float) -> dict[str, Node]:
        """The cap moves down."""
        return {"supports": {"top": {"y": f"{-value!r} m"}}}

    def gauge(self, column: str) -> dict[str, Node]:
        """Since the cell pressure is constant, the axial stress changes by the deviator stress."""
        if column == "deviator_stress":
            return {"kind": "pressure-cell", "normal": ["0", "1"]}
        return {"kind": "strain", "component": "volume", "positive": "compression"}


class OedometerSection(TestSection):
    """Oedometer test: vertical stresses are imposed, and a ring holds the specimen.

    Its channel is `TEST axial strain`, its stages are `TEST seated` and one for each row, such as
    `TEST at 200 kPa`.
    """

    rows = "vertical_stress"
    kind: Literal["oedometer"]
    seating_stress: Pressure = Field(
        description="Vertical stress from which strains count: that of the first reading."
    )
    readings: OedometerRows = Field(description="Rows, or the name of a CSV file that has them.")
    accuracy: OedometerAccuracy = Field(description="Accuracy by column.")

    @property
    def initial(self) -> float:
        """The ring gives way to nothing: as good as all around."""
        return self.seating_stress.factor

    def begin(self) -> dict[str, Node]:
        """The ring holds what comes after the initial stress."""
        return {"supports": {"side": {"x": "fixed"}}, "loads": _loads(top=self.initial)}

    def step(self, value: float) -> dict[str, Node]:
        """Weights are put on, or taken off."""
        return {"loads": _loads(top=value)}

    def gauge(self, column: str) -> dict[str, Node]:
        """The vertical strain."""
        return {"kind": "strain", "component": "yy", "positive": "compression"}


AnyTest = Annotated[TriaxialSection | OedometerSection, Field(discriminator="kind")]

_ZERO_STAGE = {"triaxial": "consolidated", "oedometer": "seated"}


class _Tests(BaseModel):
    """The key `tests` alone."""

    model_config = ConfigDict(extra="ignore")
    tests: Annotated[dict[Name, AnyTest], Field(min_length=1)]


def with_tests(places: Places, faults: Faults) -> Places:
    """The case with its tests written as stages of a specimen, with gauges and readings.

    Args:
        places: the case, with what the files of the tests hold.
        faults: knows of files that cannot be read.

    Raises:
        InputError: with what is wrong with the tests.
    """
    data = places.data
    if not isinstance(data, dict) or "tests" not in data:
        return places
    faults.raise_any()
    for key in data:
        without_readings = key == "readings" and data[key] == []  # for those who compute them
        if key not in BESIDE_TESTS and not without_readings:
            message = "the case is of 'tests', whose ground and stages are given with them"
            hint = "Remove it. Site and laboratory are two cases, which a project fits together."
            faults.add((key,), "no-ground", message, hint, key=True)
    known: dict[int, tuple[str, ...]] = {}
    try:
        tests = _Tests.model_validate(data, context=known).tests
    except ValidationError as error:
        add_schema_faults(faults, error.errors(include_url=False), data, known)
        tests = {}
    materials = data.get("materials")
    names = list(materials) if isinstance(materials, dict) else []
    for name, test in tests.items():
        if test.material not in names:
            faults.add_unknown(("tests", name, "material"), "material", test.material, names)
    faults.raise_any()
    rest = {key: node for key, node in data.items() if key != "tests"}
    return replace(places, data={**_case_of(tests), **rest})


def _case_of(tests: Mapping[str, AnyTest]) -> dict[str, Node]:
    """The keys of a case that computes the tests."""
    least = min(test.initial for test in tests.values())
    first = next(iter(tests.values()))
    stages: list[Node] = []
    gauges: dict[str, Node] = {}
    readings: list[Node] = []
    for name, test in tests.items():
        zero = f"{name} {_ZERO_STAGE[test.kind]}"
        rows: Any = test.readings
        imposed: list[CaseNumber] = getattr(rows, test.rows)
        names = list(_row_names(name, imposed))
        begin = {"name": zero, "independent": "true", "base": "virgin", **test.begin()}
        if test.material != first.material:
            begin["change"] = {"specimen": test.material}
        stages.append(begin)
        for stage, base, value in zip(names, [zero, *names], imposed, strict=False):
            row: dict[str, Node] = {"name": stage, "independent": "true", "base": base}
            stages.append(row | test.step(value.factor))
        for column in type(test.accuracy).model_fields:
            accuracy: CaseNumber | None = getattr(test.accuracy, column)
            if accuracy is None:
                continue
            gauge = f"{name} {column.replace('_', ' ')}"
            gauges[gauge] = {
                **test.gauge(column), "point": _MIDDLE, "accuracy": accuracy.text, "zero": zero,
                "branch": "true",
            }  # fmt: skip
            values: Sequence[CaseNumber] = getattr(rows, column) or ()
            readings += [
                {"gauge": gauge, "stage": stage, "value": value.text}
                for stage, value in zip(names, values, strict=False)
            ]
    stress = _pressure(-least)
    return {
        "analysis": "axisymmetric",
        "mesh": {"file": "geoident:specimen"},
        "groups": {"specimen": first.material},
        "supports": {"bottom": "y"},
        "in_situ": {"model": "constant", "xx": stress, "yy": stress, "zz": stress, "held": "false"},
        "loads": _loads(side=least, top=least),
        "stages": stages,
        "gauges": gauges,
        "readings": readings,
    }


def _row_names(test: str, imposed: Sequence[CaseNumber]) -> Iterator[str]:
    """Names of the stages of the rows; a value that comes again gets a number."""
    count: dict[str, int] = {}
    for value in imposed:
        text = value.text if value.unit in value.text else f"{value.text} {value.unit}"
        count[text] = count.get(text, 0) + 1
        yield f"{test} at {text}" + (f" ({count[text]})" if count[text] > 1 else "")


def _loads(**pressures: float) -> dict[str, Node]:
    """Pressures on the faces of the specimen, Pa."""
    return {face: {"on": face, "pressure": _pressure(p)} for face, p in pressures.items()}


def _pressure(size: float) -> str:
    return f"{size / 1e3:.15g} kPa"

"""Laboratory and field tests: each is a small model that the case does not have to describe.

`with_tests` writes the key `tests` of a case as its mesh, supports, stages, gauges and readings,
before the case is validated. All that computes, fits and reports a case does so with tests, too.
The meshes have unit size and come with geoident (theory 2.11). Tests on one mesh begin from the
same initial state, each on a branch of stages of its own, and take their rows one by one.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, cast

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from geoident.io.case.gauges.accuracy import StandardDeviationOf
from geoident.io.schema.faults import add_schema_faults
from geoident.io.schema.section import Section, SectionFaults, optional
from geoident.io.schema.values import (
    CaseNumber,
    Coefficient,
    FixedLength,
    FixedSize,
    FixedStress,
    Name,
    OrFile,
    QuantityType,
    SharesUnit,
    Stress,
)
from geoident.io.text.faults import Faults, Places
from geoident.io.text.yaml_reader import Node
from geoident.model.case import KeyPath

Keys = dict[str, Node]
"""A mapping of a case."""

Pressure = Annotated[CaseNumber, QuantityType("pressure", above=0.0, such_as="150 kPa")]
PastStress = Annotated[
    CaseNumber, QuantityType("pressure", tied=True, above=0.0, such_as="150 kPa")
]
Pressures = Annotated[list[FixedStress], Field(min_length=1), SharesUnit()]
Strains = Annotated[
    list[Annotated[CaseNumber, QuantityType("strain")]], Field(min_length=1), SharesUnit()
]
ReadPressures = Annotated[list[FixedStress | None], Field(min_length=1), SharesUnit()]
"""Of what is read, None where it was not."""
ReadStrains = Annotated[
    list[Annotated[CaseNumber, QuantityType("strain")] | None], Field(min_length=1), SharesUnit()
]
ReadLengths = Annotated[list[FixedLength | None], Field(min_length=1), SharesUnit()]
PressureError = Annotated[CaseNumber, StandardDeviationOf("pressure", above=0.0, usual=False)]
StrainError = Annotated[CaseNumber, StandardDeviationOf("strain", above=0.0, usual=False)]
LengthError = Annotated[CaseNumber, StandardDeviationOf("length", above=0.0, usual=False)]

BESIDE_TESTS = ("format", "title", "parameters", "materials", "tests", "bad", "fit", "report")
"""Keys of a case of tests; all others follow from the tests."""

COLUMNS: Mapping[str, Mapping[str, str]] = {
    "triaxial": {
        "axial_strain": "strain",
        "deviator_stress": "pressure",
        "volumetric_strain": "strain",
        "pore_pressure": "pressure",
    },
    "oedometer": {"vertical_stress": "pressure", "axial_strain": "strain"},
    "direct-shear": {
        "shear_strain": "strain",
        "shear_stress": "pressure",
        "vertical_strain": "strain",
    },
    "plate-load": {"pressure": "pressure", "settlement": "length"},
    "pressuremeter": {"pressure": "pressure", "cavity_strain": "strain"},
}
"""Kind of test to the columns of its rows and their dimensions; the first is imposed."""

_RIGID = "rigid plate"
"""Material of what is stiffer than all ground."""
_MIDDLE: Node = ["0.5 m", "0.5 m"]
_WATER: Keys = {"hydraulic": {"permeability": "1e-9 m/s"}}
"""Of a material of an undrained test that says nothing of it; no water flows in 0 d."""
_IN = "An accuracy alone has the column predicted."


class RowsSection(Section):
    """Rows of a test, column by column; of a column that is read a value may be left blank."""

    def check(self, faults: SectionFaults) -> None:
        """All columns are as long as the first."""
        columns = {name: getattr(self, name) for name in type(self).model_fields}
        first = next(iter(columns))
        for name, values in columns.items():
            if values is not None and len(values) != len(columns[first]):
                message = f"{len(values)} values for {len(columns[first])} of {first}"
                faults.add((name,), "wrong-number", message, "Write one value for each row.")


class TriaxialRows(RowsSection):
    """Rows of a triaxial test. In a file: 'axial_strain [%], deviator_stress [kPa]', and so on.

    Strains are positive in compression. They and the pore pressure count from the end of
    consolidation.
    """

    axial_strain: Strains = Field(description="Imposed.", examples=[["0.5 %", "1 %"]])
    deviator_stress: ReadPressures | None = optional("Axial less radial stress.")
    volumetric_strain: ReadStrains | None = optional("Of the specimen, in a drained test.")
    pore_pressure: ReadPressures | None = optional(
        "Its rise since consolidation, without back pressure; undrained."
    )


class OedometerRows(RowsSection):
    """Rows of an oedometer test. In a file: 'vertical_stress [kPa], axial_strain [%]'.

    Strains are positive in compression and count from the seating stress.
    """

    vertical_stress: Pressures = Field(
        description="Effective, imposed; it may fall again.", examples=[["50 kPa", "100 kPa"]]
    )
    axial_strain: ReadStrains | None = optional("Settlement by height.")


class DirectShearRows(RowsSection):
    """Rows of a direct shear test. In a file: 'shear_strain [%], shear_stress [kPa]', and so on."""

    shear_strain: Strains = Field(
        description="Imposed: horizontal motion by the height of the specimen.",
        examples=[["1 %", "5 %"]],
    )
    shear_stress: ReadPressures | None = optional("Force by area.")
    vertical_strain: ReadStrains | None = optional(
        "Settlement by height, positive where the specimen is compressed."
    )


class PlateLoadRows(RowsSection):
    """Rows of a plate load test. In a file: 'pressure [kPa], settlement [mm]'."""

    pressure: Pressures = Field(
        description="Imposed, mean of the plate; it may fall again.",
        examples=[["100 kPa", "200 kPa"]],
    )
    settlement: ReadLengths | None = optional("Of the middle of the plate.")


class PressuremeterRows(RowsSection):
    """Rows of a pressuremeter test. In a file: 'pressure [kPa], cavity_strain [%]'."""

    pressure: Pressures = Field(
        description="Effective, imposed; it may fall again.", examples=[["300 kPa", "500 kPa"]]
    )
    cavity_strain: ReadStrains | None = optional(
        "Growth of the radius by the radius, since the stress in situ."
    )


class TestSection(Section):
    """A test in the laboratory or in the field."""

    mesh: ClassVar[str]
    """The mesh that comes with geoident."""
    group: ClassVar[str] = "specimen"
    """Its group of the ground that is tested."""
    analysis: ClassVar[str] = "axisymmetric"
    begun: ClassVar[str] = "consolidated"
    """What is said of the stage at whose end gauges read zero."""
    drawn: ClassVar[Keys] = {}
    """How its columns are drawn over the one that is imposed, keys of `report.curves`."""

    if TYPE_CHECKING:  # each kind of test has its own
        readings: RowsSection
        accuracy: Section

    material: Name = Field(description="The material that is tested, one of `materials`.")
    preconsolidation_stress: PastStress | None = optional(
        "Highest vertical stress that the sample bore in the ground, effective, "
        "with K0nc of it to the sides: of hardening soil with a cap, in place of `OCR` and `POP`.",
        examples=["180 kPa", "$sigma_p"],
    )

    @property
    def past(self) -> str:
        """The preconsolidation stress as it is written; empty where none is given."""
        return "" if self.preconsolidation_stress is None else self.preconsolidation_stress.text

    @property
    def initial(self) -> float:
        """Of a specimen: the stress at its beginning, the same in all directions, Pa."""
        return 0.0

    @property
    def undrained(self) -> bool:
        """No water leaves while its rows are imposed."""
        return False

    @property
    def start(self) -> str:
        """What is imposed when gauges read zero; empty where a parameter tells it."""
        return "0 %"

    @abstractmethod
    def surroundings(self, least: float) -> Keys:
        """Supports, in-situ stress, loads and materials of the initial state.

        Args:
            least: the least of the initial stresses of all tests of the case, Pa.
        """

    @abstractmethod
    def begin(self) -> Keys:
        """What the stage does at whose end its gauges read zero."""

    @abstractmethod
    def step(self, value: float) -> Keys:
        """What the stage of a row does that imposes a value, SI."""

    @abstractmethod
    def gauge(self, column: str) -> Keys:
        """The gauge that reads a column, without its accuracy and zero."""

    def check(self, faults: SectionFaults) -> None:
        """What was read has an accuracy."""
        for column in type(self.accuracy).model_fields:
            read = getattr(self.readings, column) is not None
            if read and getattr(self.accuracy, column) is None:
                message = f"the accuracy of '{column}', which was read, is missing"
                hint = f"Add the standard deviation of one value: accuracy: {{{column}: ...}}."
                faults.add(("accuracy",), "missing-key", message, hint)


class TriaxialAccuracy(Section):
    """Standard deviation of one value of each column."""

    deviator_stress: PressureError | None = optional(_IN)
    volumetric_strain: StrainError | None = optional(_IN)
    pore_pressure: PressureError | None = optional(_IN)


_NOT_READ = {
    "drained": ("pore_pressure", "water leaves a drained specimen, so that its pressure stays"),
    "undrained": ("volumetric_strain", "no water leaves an undrained specimen: its volume stays"),
}
"""Drainage of a triaxial test to the column that it does not have, and why."""


class TriaxialSection(TestSection):
    """Triaxial test: axial strain is imposed under a constant cell pressure.

    Its channels are `TEST deviator stress` and `TEST volumetric strain`, undrained `TEST pore
    pressure`; its stages `TEST consolidated` and one for each row, such as `TEST at 1.5 %`.
    """

    mesh = "specimen"
    kind: Literal["triaxial"]
    drainage: Literal["drained", "undrained"] = Field(
        "drained",
        description="While it is sheared, after consolidation (CD or CU test). Water stays in an "
        "undrained specimen, which is full of it; `hydraulic` of its material is not needed.",
    )
    cell_pressure: Pressure = Field(description="Effective, after consolidation.")
    readings: Annotated[TriaxialRows, OrFile()] = Field(
        description="Rows, or the name of a CSV file that has them."
    )
    accuracy: TriaxialAccuracy = Field(description="Accuracy by column.")

    @property
    def initial(self) -> float:
        """All around."""
        return self.cell_pressure.factor

    def surroundings(self, least: float) -> Keys:
        """A cylinder on a smooth base."""
        return _specimen(least, {"bottom": "y"}, "side", "top")

    def begin(self) -> Keys:
        """Consolidation."""
        return {"loads": _loads(side=self.initial, top=self.initial)}

    def step(self, value: float) -> Keys:
        """The cap moves down; in no time no water leaves."""
        moved: Keys = {"supports": {"top": {"y": f"{-value!r} m"}}}
        return {**moved, "lasts": "0 d"} if self.undrained else moved

    def gauge(self, column: str) -> Keys:
        """The total axial stress changes by the deviator stress: the cell pressure is constant."""
        if column == "deviator_stress":
            return {"kind": "pressure-cell", "point": _MIDDLE, "normal": ["0", "1"]}
        if column == "pore_pressure":
            return {"kind": "piezometer", "point": _MIDDLE}
        return _strain("volume")

    def check(self, faults: SectionFaults) -> None:
        """The columns are those of a test with its drainage."""
        super().check(faults)
        column, why = _NOT_READ[self.drainage]
        for key in ("readings", "accuracy"):
            if getattr(getattr(self, key), column) is not None:
                other = "drained" if self.undrained else "undrained"
                hint = f"Remove the column, or write 'drainage: {other}'."
                faults.add((key, column), "wrong-pair", why, hint)

    @property
    def undrained(self) -> bool:
        """The water stays in the specimen."""
        return self.drainage == "undrained"


class OedometerAccuracy(Section):
    """Standard deviation of one value of each column."""

    axial_strain: StrainError | None = optional(_IN)


class OedometerSection(TestSection):
    """Oedometer test: vertical stresses are imposed, and a ring holds the specimen.

    Its channel is `TEST axial strain`, its stages are `TEST seated` and one for each row, such as
    `TEST at 200 kPa`.
    """

    mesh, begun = "specimen", "seated"
    drawn: ClassVar[Keys] = {"scale": "log", "downwards": "true"}
    kind: Literal["oedometer"]
    seating_stress: Pressure = Field(
        description="Vertical stress from which strains count: that of the first reading."
    )
    readings: Annotated[OedometerRows, OrFile()] = Field(
        description="Rows, or the name of a CSV file that has them."
    )
    accuracy: OedometerAccuracy = Field(description="Accuracy by column.")

    @property
    def initial(self) -> float:
        """Of a specimen that has not been loaded sideways otherwise: all around."""
        return self.seating_stress.factor

    @property
    def start(self) -> str:
        """The seating stress."""
        return self.seating_stress.text

    def surroundings(self, least: float) -> Keys:
        """A cylinder on a smooth base."""
        return _specimen(least, {"bottom": "y"}, "side", "top")

    def begin(self) -> Keys:
        """The ring holds what comes after the initial stress."""
        return {"supports": {"side": {"x": "fixed"}}, "loads": _loads(top=self.initial)}

    def step(self, value: float) -> Keys:
        """Weights are put on, or taken off."""
        return {"loads": _loads(top=value)}

    def gauge(self, column: str) -> Keys:
        """The vertical strain."""
        return _strain("yy")


class DirectShearAccuracy(Section):
    """Standard deviation of one value of each column."""

    shear_stress: PressureError | None = optional(_IN)
    vertical_strain: StrainError | None = optional(_IN)


class DirectShearSection(TestSection):
    """Direct shear test, as simple shear in plane strain under a constant normal stress.

    Its channels are `TEST shear stress.xy` and `TEST vertical strain`, its stages `TEST
    consolidated` and one for each row, such as `TEST at 5 %`.
    """

    mesh, analysis = "shear-box", "plane-strain"
    kind: Literal["direct-shear"]
    normal_stress: Pressure = Field(description="Effective, on the horizontal plane.")
    readings: Annotated[DirectShearRows, OrFile()] = Field(
        description="Rows, or the name of a CSV file that has them."
    )
    accuracy: DirectShearAccuracy = Field(description="Accuracy by column.")

    @property
    def initial(self) -> float:
        """All around."""
        return self.normal_stress.factor

    def surroundings(self, least: float) -> Keys:
        """A box whose cap can rise, but not turn."""
        keys = _specimen(least, {"bottom": "fixed", "moved": "x"}, "top")
        return {**keys, "materials": _rigid(), "groups": {"cap": _RIGID}}

    def begin(self) -> Keys:
        """Consolidation between the walls of the box."""
        return {"loads": _loads(top=self.initial)}

    def step(self, value: float) -> Keys:
        """The cap moves sideways."""
        return {"supports": {"moved": {"x": f"{value!r} m"}}}

    def gauge(self, column: str) -> Keys:
        """The shear stress is the same everywhere."""
        if column == "shear_stress":
            return {"kind": "stress", "point": _MIDDLE, "components": ["xy"]}
        return _strain("yy")


class PlateLoadAccuracy(Section):
    """Standard deviation of one value of each column."""

    settlement: LengthError | None = optional(_IN)


class PlateLoadSection(TestSection):
    """Plate load test on a level surface of ground without weight, deep and uniform.

    Its channel is `TEST settlement`, its stages are `TEST placed` and one for each row, such as
    `TEST at 200 kPa`.
    """

    mesh, group, begun = "half-space", "ground", "placed"
    drawn: ClassVar[Keys] = {"downwards": "true"}
    kind: Literal["plate-load"]
    diameter: FixedSize = Field(description="Of the plate.", examples=["300 mm"])
    plate: Literal["rigid", "flexible"] = Field(
        "rigid", description="Stiffness; a rigid one is bonded to the ground."
    )
    overburden: FixedStress = Field(
        description="Stress on the ground at the level of the plate, effective; 0 kPa on the "
        "surface. It stands for the weight of the ground that the plate reaches.",
        examples=["10 kPa"],
    )
    K0: Coefficient = Field(description="Horizontal by vertical stress in the ground.")
    readings: Annotated[PlateLoadRows, OrFile()] = Field(
        description="Rows, or the name of a CSV file that has them."
    )
    accuracy: PlateLoadAccuracy = Field(description="Accuracy by column.")

    def surroundings(self, least: float) -> Keys:
        """The overburden everywhere."""
        vertical = self.overburden.text
        return {
            "materials": _rigid() if self.plate == "rigid" else {},
            "groups": {"plate": "absent"},
            "supports": {"far": "fixed"},
            "in_situ": {
                "model": "heim", "vertical": vertical, "K0": self.K0.text, "held": "false"
            },
            "loads": {on: {"on": on, "pressure": vertical} for on in ("surface", "under")},
        }  # fmt: skip

    @property
    def start(self) -> str:
        """The overburden."""
        return self.overburden.text

    def begin(self) -> Keys:
        """The plate takes over the overburden under it."""
        if self.plate == "flexible":
            return {"loads": _loads(under=self.overburden.factor)}
        loads = _loads(top=self.overburden.factor)
        return {"install": {"plate": _RIGID}, "remove": ["under"], "loads": loads}

    def step(self, value: float) -> Keys:
        """A jack pushes."""
        return {"loads": _loads(**{"top" if self.plate == "rigid" else "under": value})}

    def gauge(self, column: str) -> Keys:
        """The settlement of a plate of 1 m radius, by the radius of the plate."""
        radius = 0.5 * self.diameter.factor
        return {"kind": "settlement", "point": ["0 m", "0 m"], "ratio": f"{radius:.12g}"}


class PressuremeterAccuracy(Section):
    """Standard deviation of one value of each column."""

    cavity_strain: StrainError | None = optional(_IN)


class PressuremeterSection(TestSection):
    """Pressuremeter test: a long cylindrical cavity is widened in plane strain, drained.

    Its channel is `TEST cavity strain`, its stages are `TEST placed` and one for each row, such
    as `TEST at 500 kPa`.
    """

    mesh, group, begun = "cavity", "ground", "placed"
    kind: Literal["pressuremeter"]
    horizontal_stress: Stress = Field(
        description="In situ, effective, compression positive.", examples=["$sigma_h"]
    )
    vertical_stress: Stress = Field(description="In situ, effective, compression positive.")
    readings: Annotated[PressuremeterRows, OrFile()] = Field(
        description="Rows, or the name of a CSV file that has them."
    )
    accuracy: PressuremeterAccuracy = Field(description="Accuracy by column.")

    def surroundings(self, least: float) -> Keys:
        """The stress in situ holds the cavity."""
        across, down = self.horizontal_stress.text, self.vertical_stress.text
        return {
            "supports": {"held": "y"},
            "in_situ": {
                "model": "constant", "xx": f"-{across}", "yy": f"-{down}", "zz": f"-{across}",
                "held": "false",
            },
            "loads": {on: {"on": on, "pressure": across} for on in ("wall", "far")},
        }  # fmt: skip

    @property
    def start(self) -> str:
        """The stress of the ground."""
        return "" if self.horizontal_stress.parameter else self.horizontal_stress.text

    def begin(self) -> Keys:
        """The pressure is that of the ground."""
        across = self.horizontal_stress.text
        return {"loads": {"wall": {"on": "wall", "pressure": across}}}

    def step(self, value: float) -> Keys:
        """The pressure in the cavity."""
        return {"loads": _loads(wall=value)}

    def gauge(self, column: str) -> Keys:
        """At the wall the hoop strain is the cavity strain."""
        return {"kind": "strain", "point": ["1 m", "0.5 m"], "component": "zz"}

    def check(self, faults: SectionFaults) -> None:
        """Stresses are written positive."""
        super().check(faults)
        for key in ("horizontal_stress", "vertical_stress"):
            given: CaseNumber = getattr(self, key)
            if given.factor < 0.0:
                message = f"'{given.text}' is negative, and compression is positive here"
                faults.add((key,), "out-of-range", message, "Write it without its sign.")


AnyTest = Annotated[
    TriaxialSection
    | OedometerSection
    | DirectShearSection
    | PlateLoadSection
    | PressuremeterSection,
    Field(discriminator="kind"),
]


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
        simulated = key == "readings" and places.is_overridden((key,))  # in place of the columns
        if key not in BESIDE_TESTS and not simulated:
            message = "the case is of 'tests', whose ground and stages are given with them"
            hint = "Remove it. Site and tests are two cases, which a project fits together."
            if key == "readings":
                hint = "Write the values into the columns of the tests. Simulated ones take the "
                hint += "place of all of them by an override of 'readings'."
            faults.add((key,), "no-ground", message, hint, key=True)
    sections: dict[int, type[Section]] = {}
    tests: dict[str, AnyTest] = {}
    try:
        tests = _Tests.model_validate(data, context=sections).tests
    except ValidationError as error:
        add_schema_faults(faults, error.errors(include_url=False), data, sections)
    materials = node if isinstance(node := data.get("materials"), dict) else {}
    for name, test in tests.items():
        if test.material not in materials:
            faults.add_unknown(("tests", name, "material"), "material", test.material, materials)
            continue
        of = materials[test.material]
        if test.undrained and isinstance(of, dict) and of.get("hydraulic") == "impervious":
            message = f"'{test.material}' is impervious, and no water presses in it"
            hint = f"Remove 'hydraulic' of '{test.material}'."
            faults.add(("tests", name, "drainage"), "no-water", message, hint)
    least = min((test.initial for test in tests.values()), default=0.0)
    first = next(iter(tests), "")
    _check_pasts(tests, least, materials, faults)
    for name, test in tests.items():
        if _initial_state(test, least) != _initial_state(tests[first], least):
            message = f"'{name}' does not begin in the state in which '{first}' does"
            hint = "Make it a case of its own; a project fits several cases together."
            faults.add(("tests", name), "two-states", message, hint, key=True)
    faults.raise_any()
    full = {test.material for test in tests.values() if test.undrained}
    given = {
        name: {**_WATER, **of} if name in full and isinstance(of, dict) else of
        for name, of in materials.items()
    }
    given, remembering = _with_pasts(given, tests)
    written = _case_of(remembering, least)
    written["materials"] = {**given, **cast("Keys", written["materials"])}
    rest = {key: node for key, node in data.items() if key not in ("tests", "materials")}
    head = data.get("report", {})
    if isinstance(head, dict) and "curves" not in head:
        rest["report"] = {**head, "curves": _curves(tests)}
    fit = data.get("fit", {})
    if isinstance(fit, dict):  # the last row of a test says little of a fit without it
        rest["fit"] = {"backtest": "false", **fit}
    made_of: dict[KeyPath, KeyPath] = {}
    for name, test in reversed(tests.items()):
        own = ("materials", remembering[name].material)
        made_of[own] = ("materials", test.material)
        if test.past:
            key = "preconsolidation_stress"
            made_of[(*own, "yield", key)] = ("tests", name, key)
    return replace(places, made_of=made_of, data={**written, **rest})


def _check_pasts(
    tests: Mapping[str, AnyTest], least: float, materials: Keys, faults: Faults
) -> None:
    """The past of each specimen is clear, and its material remembers one.

    Args:
        tests: by name.
        least: the least of their initial stresses, Pa.
        materials: of the case.
        faults: takes what is wrong.
    """
    stressed_more = {test.material for test in tests.values() if test.initial > least}
    for name, of in materials.items():
        strength = of.get("yield") if isinstance(of, dict) else None
        past = strength.keys() & {"OCR", "POP"} if isinstance(strength, dict) else set()
        for key in sorted(past) if name in stressed_more else ():
            message = (
                f"'{name}' has '{key}', and tests that begin under other stresses than "
                f"{least / 1e3:g} kPa: which of them it counts from is not clear"
            )
            hint = "Give 'preconsolidation_stress' in its place: the highest vertical stress "
            hint += "of the past, here or for each test."
            faults.add(("materials", name, "yield", key), "two-states", message, hint, key=True)
    for name, test in tests.items():
        if not test.past or test.material not in materials:
            continue
        of = materials[test.material]
        strength = of.get("yield") if isinstance(of, dict) else None
        path = ("tests", name, "preconsolidation_stress")
        if not isinstance(strength, dict) or strength.get("type") != "hardening-soil":
            message = f"'{test.material}' remembers no stress of the past"
            hint = "Remove it, or make the material a 'hardening-soil' with a cap ('Eoed')."
            faults.add(path, "no-past", message, hint, key=True)
            continue
        for key in ("OCR", "POP", "preconsolidation_stress"):
            if key in strength:
                message = f"'{test.material}' has '{key}', which gives the past of its specimens"
                faults.add(path, "two-pasts", message, "Remove one of them.", key=True)


def _with_pasts(
    materials: Keys, tests: Mapping[str, AnyTest]
) -> tuple[Keys, Mapping[str, AnyTest]]:
    """Materials that remember the stress that the samples bore, and tests of them.

    Samples that bore different stresses have one material each: `clay, once under 180 kPa`.
    """
    pasts: dict[str, set[str]] = {}
    for test in tests.values():
        pasts.setdefault(test.material, set()).add(test.past)
    given = {name: of for name, of in materials.items() if "" in pasts.get(name, {""})}
    renamed: dict[str, AnyTest] = {}
    for name, test in tests.items():
        own, of = test.material, cast("Keys", materials[test.material])
        if test.past:
            own += f", once under {test.past}" if len(pasts[own]) > 1 else ""
            law = {**cast("Keys", of["yield"]), "preconsolidation_stress": test.past}
            given[own] = {**of, "yield": law}
        renamed[name] = test.model_copy(update={"material": own})
    return given, renamed


def _initial_state(test: AnyTest, least: float) -> tuple[str, Keys]:
    return test.mesh, test.surroundings(least)


def _case_of(tests: Mapping[str, AnyTest], least: float) -> Keys:
    """The keys of a case that computes the tests, with the materials that it adds.

    Args:
        tests: by name, all on one mesh.
        least: the least of their initial stresses, Pa.
    """
    first = next(iter(tests.values()))
    stages: list[Node] = []
    gauges: Keys = {}
    readings: list[Node] = []
    for name, test in tests.items():
        zero = f"{name} {test.begun}"
        rows: Any = test.readings
        imposed: list[CaseNumber] = getattr(rows, next(iter(COLUMNS[test.kind])))
        names = list(_row_names(name, imposed))
        begin: Keys = {"name": zero, "independent": "true", "base": "virgin", **test.begin()}
        if test.material != first.material:
            begin["change"] = {test.group: test.material}
        stages.append(begin)
        for stage, base, value in zip(names, [zero, *names], imposed, strict=False):
            row: Keys = {"name": stage, "independent": "true", "base": base}
            stages.append({**row, **test.step(value.factor)})
        for column in type(test.accuracy).model_fields:
            accuracy: CaseNumber | None = getattr(test.accuracy, column)
            if accuracy is None:
                continue
            channel = gauge = _gauge_name(name, column)
            entry = test.gauge(column)
            if isinstance(components := entry.get("components"), list):
                channel = f"{gauge}.{components[0]}"
            more: Keys = {"accuracy": accuracy.text, "zero": zero, "branch": "true"}
            gauges[gauge] = {**entry, **more}
            values: Sequence[CaseNumber | None] = getattr(rows, column) or ()
            readings += [
                {"gauge": channel, "stage": stage, "value": value.text}
                for stage, value in zip(names, values, strict=False)
                if value is not None
            ]
    around = first.surroundings(least)
    groups = {first.group: first.material, **cast("Keys", around.get("groups", {}))}
    return {
        "analysis": first.analysis,
        "mesh": {"file": f"geoident:{first.mesh}"},
        "materials": {},
        **around,
        "groups": groups,
        "stages": stages,
        "gauges": gauges,
        "readings": readings,
    }


def _curves(tests: Mapping[str, AnyTest]) -> list[Node]:
    """Figures of each column over the imposed one, those of tests of one kind together."""
    curves: dict[tuple[str, str], Any] = {}
    for name, test in tests.items():
        over = next(iter(COLUMNS[test.kind]))
        imposed: list[CaseNumber] = getattr(test.readings, over)
        at = dict(zip(_row_names(name, imposed), map(_with_unit, imposed), strict=True))
        if test.start:
            at = {f"{name} {test.begun}": test.start, **at}
        for column in type(test.accuracy).model_fields:
            if getattr(test.accuracy, column) is None:
                continue
            words = {"read": column.replace("_", " "), "over": over.replace("_", " ")}
            none = {**words, **test.drawn, "gauges": {}, "stages": {}}
            curve = curves.setdefault((test.kind, column), none)
            curve["gauges"][name] = _gauge_name(name, column)
            curve["stages"].update(at)
    return list(curves.values())


def _gauge_name(test: str, column: str) -> str:
    return f"{test} {column.replace('_', ' ')}"


def _with_unit(value: CaseNumber) -> str:
    """A number of a list, whose unit may stand at its end."""
    return value.text if value.unit in value.text else f"{value.text} {value.unit}"


def _row_names(test: str, imposed: Sequence[CaseNumber]) -> Iterator[str]:
    """Names of the stages of the rows; a value that comes again gets a number."""
    count: dict[str, int] = {}
    for value in imposed:
        text = _with_unit(value)
        count[text] = count.get(text, 0) + 1
        yield f"{test} at {text}" + (f" ({count[text]})" if count[text] > 1 else "")


def _specimen(least: float, supports: Keys, *pressed: str) -> Keys:
    """A specimen under the same stress in all directions, Pa."""
    stress: Node = f"{-least / 1e3:.15g} kPa"
    return {
        "supports": supports,
        "in_situ": {"model": "constant", "xx": stress, "yy": stress, "zz": stress, "held": "false"},
        "loads": _loads(**dict.fromkeys(pressed, least)),
    }


def _loads(**pressures: float) -> Keys:
    """Pressures on faces, Pa."""
    return {face: {"on": face, "pressure": f"{p / 1e3:.15g} kPa"} for face, p in pressures.items()}


def _strain(component: str) -> Keys:
    """The gauge of a strain of a specimen that is compressed."""
    given: Keys = {"kind": "strain", "point": _MIDDLE, "component": component}
    return {**given, "positive": "compression"}


def _rigid() -> Keys:
    """A material beside which all ground is soft."""
    return {_RIGID: {"elastic": "isotropic", "E": "1e5 GPa", "nu": "0.25"}}

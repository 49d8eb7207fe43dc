"""The forms of a constant: a number, a field whose mean is the number, or what it grows from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import (
    BeforeValidator,
    Discriminator,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    Tag,
    TypeAdapter,
    WithJsonSchema,
)
from pydantic_core import CoreSchema, core_schema

from geoident.io.case.varied.field import VariedAngleSection, VariedModulusSection, VariedSection
from geoident.io.case.varied.growth import DepthGrowthSection, GrowthBase, StressGrowthSection
from geoident.io.case.varied.rock_mass import KEY, DerivedModulus, RockMassModulusSection
from geoident.io.schema.section import Context, Section, SectionFaults
from geoident.io.schema.values import Angle, CaseNumber, Modulus, Stress
from geoident.model.ground import Growth, RandomField


@dataclass(frozen=True)
class InPlaceOfNumber:
    """Annotation of a `CaseNumber` that is written as a section, which becomes its `varied_by`.

    The method ``number`` of the section gives it.
    """

    section: type[VariedSection | GrowthBase | RockMassModulusSection]

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_after_validator_function(
            lambda section: section.number(),
            handler.generate_schema(self.section),
            serialization=core_schema.plain_serializer_function_ser_schema(
                lambda given: given.varied_by.model_dump(by_alias=True, exclude_none=True)
            ),
        )

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return handler(schema)


_BY_DEPTH, _BY_STRESS = DepthGrowthSection.model_fields, StressGrowthSection.model_fields


def _number_or_varied(value: object) -> str:
    """Which form a modulus has, by the keys that only one form has."""
    if isinstance(value, CaseNumber) and isinstance(value.varied_by, GrowthBase):
        return "<depth>" if isinstance(value.varied_by, DepthGrowthSection) else "<stress>"
    if isinstance(value, dict) and "field" not in value:
        if not value.keys().isdisjoint(_BY_DEPTH):
            return "<depth>"
        if not value.keys().isdisjoint(_BY_STRESS):
            return "<stress>"
    return _number_or_field(value)


def _number_varied_or_derived(value: object) -> str:
    """The same of Young's modulus, which may follow from what is known of the rock mass."""
    if isinstance(value, DerivedModulus) or (isinstance(value, dict) and KEY in value):
        return "<rock mass>"
    return _number_or_varied(value)


def _number_or_field(value: object) -> str:
    varied = (
        value.varied_by is not None if isinstance(value, CaseNumber) else isinstance(value, dict)
    )
    return "<field>" if varied else "<number>"


_ModulusForms = (
    Annotated[Modulus, Tag("<number>")]
    | Annotated[CaseNumber, InPlaceOfNumber(VariedModulusSection), Tag("<field>")]
    | Annotated[CaseNumber, InPlaceOfNumber(DepthGrowthSection), Tag("<depth>")]
    | Annotated[CaseNumber, InPlaceOfNumber(StressGrowthSection), Tag("<stress>")]
)
ModulusOrVaried = Annotated[_ModulusForms, Discriminator(_number_or_varied)]
YoungModulus = Annotated[
    _ModulusForms
    | Annotated[CaseNumber, InPlaceOfNumber(RockMassModulusSection), Tag("<rock mass>")],
    Discriminator(_number_varied_or_derived),
]
StrengthOrVaried = Annotated[
    Annotated[Stress, Tag("<number>")]
    | Annotated[CaseNumber, InPlaceOfNumber(VariedModulusSection), Tag("<field>")]
    | Annotated[CaseNumber, InPlaceOfNumber(DepthGrowthSection), Tag("<depth>")]
    | Annotated[CaseNumber, InPlaceOfNumber(StressGrowthSection), Tag("<stress>")],
    Discriminator(_number_or_varied),
]


def _no_growth(value: object) -> object:
    """Refuse growth where an angle is asked for."""
    if isinstance(value, dict) and _number_or_varied(value) in ("<depth>", "<stress>"):
        faults = SectionFaults()
        message = "an angle does not grow: it makes the shape of the yield surface, which is the "
        message += "same at all points of a material"
        hint = "Let the cohesion grow, or give places of another angle a material of their own."
        faults.add((), "growing-angle", message, hint)
        faults.raise_any()
    return value


FieldAngle = Annotated[
    Annotated[Angle, Tag("<number>")]
    | Annotated[CaseNumber, InPlaceOfNumber(VariedAngleSection), Tag("<field>")],
    Discriminator(_number_or_field),
    BeforeValidator(_no_growth),
    WithJsonSchema(TypeAdapter(Angle).json_schema()),
]
"""An angle. A field of it is read and then refused with the reason, so schemas do not offer it."""


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
    fields = []
    for name in type(section).model_fields:
        given = getattr(section, name)
        if isinstance(given, CaseNumber) and isinstance(given.varied_by, VariedSection):
            place, constant = context.at(name, "field"), (names or {}).get(name, name)
            fields.append(
                given.varied_by.field.built(
                    place, material=material, constant=constant, surface=surface
                )
            )
    return tuple(fields)


def growths_in(
    section: Section,
    context: Context,
    *,
    material: str,
    surface: int | None = None,
    names: Mapping[str, str] | None = None,
) -> tuple[Growth, ...]:
    """The growths among the numbers of a section; arguments as of `fields_in`."""
    given = ((name, getattr(section, name)) for name in type(section).model_fields)
    return tuple(
        value.varied_by.built(
            context.at(name),
            material=material,
            constant=(names or {}).get(name, name),
            surface=surface,
        )
        for name, value in given
        if isinstance(value, CaseNumber) and isinstance(value.varied_by, GrowthBase)
    )

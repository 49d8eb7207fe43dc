"""Water that takes time to leave the ground: the key `hydraulic` of a material, and `drained`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field, Tag

from geoident.io.case.drains import VerticalDrainsSection
from geoident.io.case.parameters import ParameterSection, numbers_at_start
from geoident.io.schema.section import Context, Section, SectionFaults, optional
from geoident.io.schema.values import (
    TEXT_LIST_OR_MAPPING,
    CaseNumber,
    Coefficient,
    Compressibility,
    Length,
    Modulus,
    Permeabilities,
    Permeability,
    TextOrList,
)
from geoident.model.hydraulic import Drained, Hydraulic

CLOSED = "closed"

_IMPERVIOUS = "Ground that lets no water through is 'hydraulic: impervious'."


class HydraulicSection(Section):
    """Water in the pores that takes time to leave (Biot's consolidation).

    The pressure above that of `water`, which stands still, is an unknown of its own in stages that
    last.
    """

    permeability: TextOrList[Permeability, Permeabilities] = Field(
        description="Hydraulic conductivity of the ground, one number, or one for each axis of the "
        "model.",
        examples=["1e-9 m/s", "$k", "[2e-9, 5e-10 m/s]"],
    )
    storage: Compressibility | None = optional(
        "Water that ground of unchanged volume takes in by pressure (1 / Biot's "
        "modulus); `porosity` / `water_modulus` if missing.",
        examples=["2e-7 1/kPa"],
    )
    porosity: Coefficient | None = optional(
        "Part of the volume that is water; 0.4 if missing.", examples=["0.5"]
    )
    water_modulus: Modulus | None = optional(
        "Bulk modulus of the water; 2.2 GPa if missing, that of water without air.",
        examples=["200 MPa"],
    )
    biot: Coefficient | None = optional(
        "Biot's coefficient, 1 (grains keep their volume) if missing.", examples=["0.8"]
    )
    drains: VerticalDrainsSection | None = optional(
        "Vertical drains in the ground of this material. A stage installs them where it"
        " changes ground to it.",
        examples=[{"spacing": "1.2 m", "diameter": "66 mm", "smear": "0.2 m", "smear_ratio": "3"}],
    )

    def check(self, faults: SectionFaults) -> None:
        """Numbers that are positive, and one way to say what is stored."""
        for number in self.permeabilities:
            if number.parameter is None and not number.factor > 0.0:
                message = f"'{number.text}' is no permeability: it must be positive"
                faults.add(("permeability",), "out-of-range", message, _IMPERVIOUS)
        stored = self.storage
        if stored is not None and stored.parameter is None and not stored.factor > 0.0:
            message = f"'{stored.text}': it must be positive"
            hint = "Leave it out: water without air and a porosity of 0.4 are taken then."
            faults.add(("storage",), "out-of-range", message, hint)
        if self.storage is not None and (self.porosity or self.water_modulus):
            message = "found 'storage' and what it would follow from"
            hint = "Give 'storage', or 'porosity' and 'water_modulus'."
            faults.add(("storage",), "wrong-pair", message, hint)
        for key in ("porosity", "biot"):
            part: CaseNumber | None = getattr(self, key)
            if part is not None and part.parameter is None and not 0.0 < part.factor <= 1.0:
                message = f"'{part.text}': it must be above 0, and at most 1"
                faults.add((key,), "out-of-range", message, "Correct the number.")

    @property
    def permeabilities(self) -> list[CaseNumber]:
        """The numbers of the permeability."""
        return [*self.permeability] if isinstance(self.permeability, list) else [self.permeability]


class DrainedSection(Section):
    """Faces at which water leaves freely, with no pressure in excess of that at rest, or a head."""

    builds = Drained

    head: Length | None = optional(
        "Level to which the water would rise there; that of `water` if missing.",
        examples=["-4 m", "$head"],
    )


HydraulicValue = Annotated[
    Annotated[Literal["impervious"], Tag("text")] | Annotated[HydraulicSection, Tag("mapping")],
    TEXT_LIST_OR_MAPPING,
]
StageDrainedValue = Annotated[
    Annotated[Literal["closed"], Tag("text")] | Annotated[DrainedSection, Tag("mapping")],
    TEXT_LIST_OR_MAPPING,
]


def build_hydraulic(
    value: HydraulicSection | Literal["impervious"] | None,
    parameters: Mapping[str, ParameterSection],
    context: Context,
) -> Hydraulic | None:
    """The water of a material; what it cannot be, at the start of the parameters, is a fault.

    Args:
        value: as given.
        parameters: of the case.
        context: of the key.
    """
    if not isinstance(value, HydraulicSection):
        return None if value is None else Hydraulic()
    given = value.permeabilities
    if isinstance(value.permeability, list):
        context.at("permeability").has_axes(given)
    permeability = tuple(number.scalar for number in given)
    drains = None if value.drains is None else value.drains.build()
    hydraulic = value.to_model(Hydraulic, context, permeability=permeability, drains=drains)
    numbers = [*value.numbers, *given, *([] if value.drains is None else value.drains.numbers)]
    starts = numbers_at_start(numbers, parameters)
    wrong = None if starts is None or drains is None else drains.breach(starts)
    breach = None if starts is None else hydraulic.breach(starts)
    if wrong is not None:
        key, why = wrong
        context.at("drains", key).refuse("out-of-range", why, "Correct it, or what it starts at.")
    elif breach is not None:
        hint = f"Change the start of its parameter. {_IMPERVIOUS}"
        context.refuse("out-of-range", f"at the start {breach}", hint)
    return hydraulic


def build_drained(
    values: Mapping[str, DrainedSection | Literal["closed"]], context: Context
) -> dict[str, Drained | None]:
    """Drained faces of a stage by group, None for those that close."""
    return {
        name: value.for_model(context.at(name)) if isinstance(value, DrainedSection) else None
        for name, value in values.items()
    }

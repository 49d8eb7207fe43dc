"""Gauges that read forces, stresses, pressures and temperatures: their sections."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import Field

from geoident.io.case.frames import refuse_no_direction
from geoident.io.case.gauges.accuracy import FORCES
from geoident.io.case.gauges.on_structure import TOWARDS, on_structure
from geoident.io.case.gauges.value import (
    StressComponent,
    ValueGauge,
    check_component,
    unit_direction,
)
from geoident.io.schema.estimated import ESTIMATE
from geoident.io.schema.section import Alternatives, Context, SectionFaults, optional
from geoident.io.schema.values import CaseNumber, Coordinates, Count, DirectionVector, Flag, Name
from geoident.model.gauges import Channel, Reads

Principal = Literal["major", "intermediate", "minor", "plane-major", "plane-minor"]


class StressGaugeSection(ValueGauge):
    """Stress at a point: overcoring, flat jack, hydraulic fracturing, stress cells.

    Of `components` and `principal` values one channel each, named GAUGE.xx or GAUGE.major; of a
    `direction` one channel: the normal stress on the plane across it. Principal values count from
    the most compressive one: major, intermediate, minor of all directions; plane-major and
    plane-minor of those in the section of a plane model, or in the horizontal plane of a solid.
    """

    one_of = (
        *ValueGauge.one_of,
        Alternatives("components", "principal", "direction", hint="Give exactly one of them."),
    )

    measures = ("pressure",)

    kind: Literal["stress"]
    point: Coordinates = Field(description="Where it is read.")
    components: list[StressComponent] | None = optional(
        "Components that are read; zz of a section is out of plane, about an axis the hoop stress.",
        min_length=1,
    )
    principal: list[Principal] | None = optional("Principal values that are read.", min_length=1)
    direction: DirectionVector | None = optional("Normal of the plane whose normal stress is read.")
    effective: Flag = Field(
        False, description="Of the skeleton alone; else of skeleton and water together."
    )
    positive: Literal["tension", "compression"] = Field(
        "tension", description="Which stress has positive readings."
    )
    state: Literal["current", "virgin"] = Field(
        "current",
        description="virgin: the stress before all stages, whenever it was read, as by overcoring "
        "in ground that nothing has changed yet.",
    )

    def check(self, faults: SectionFaults) -> None:
        """Nothing is read twice, and a virgin stress has no zero."""
        super().check(faults)
        if self.state == "virgin" and "zero" in self.model_fields_set:
            message = "found 'zero' of a stress in the virgin state, which does not change"
            faults.add(("zero",), "wrong-pair", message, "Remove 'zero' or 'state: virgin'.")
        for way in ("components", "principal"):
            _refuse_twice(way, getattr(self, way) or [], faults)
        refuse_no_direction("direction", self.direction, faults)

    @property
    def reads(self) -> Reads:
        """A value, a change, or the value of the virgin state."""
        return Reads.VIRGIN if self.state == "virgin" else super().reads

    @property
    def parts(self) -> Sequence[str]:
        """Quantities that are read; an empty one for the normal stress."""
        return self.components or self.principal or [""]

    def channels(self, name: str, context: Context) -> list[Channel]:
        """One channel for every component or principal value."""
        point = context.at("point").vector(self.point)
        direction = unit_direction(self.direction, context.at("direction"))
        for n, part in enumerate(self.components or ()):
            check_component(part, context.at("components", n))
        pushed = self.positive == "compression"
        return [
            self.at_point(name, point, direction, context, part, compression=pushed)
            for part in self.parts
        ]


class PressureCellSection(ValueGauge):
    """Total pressure normal to a plane in the ground, or of the ground on a beam or shell.

    Of skeleton and water together, compression positive. In the ground `normal` is the normal of
    the plane; on a beam or shell (`on`) it is read across it, in the ground beside it.
    """

    one_of = (
        *ValueGauge.one_of,
        Alternatives(
            "normal", "on towards?", hint="'towards' distinguishes the sides of a beam or shell."
        ),
    )

    measures = ("pressure",)

    kind: Literal["pressure-cell"]
    point: Coordinates = Field(description="Where it is read.")
    normal: DirectionVector | None = optional("Normal of the plane on which the pressure is read.")
    on: Name | None = optional("Beam or shell on which the pressure is read.")
    towards: Coordinates | None = optional(TOWARDS)

    def check(self, faults: SectionFaults) -> None:
        """The normal has a direction."""
        super().check(faults)
        refuse_no_direction("normal", self.normal, faults)

    @property
    def structure(self) -> str | None:
        """The structure that it sits on."""
        return self.on

    def channels(self, name: str, context: Context) -> list[Channel]:
        """The one channel."""
        point = context.at("point").vector(self.point)
        normal = unit_direction(self.normal, context.at("normal"))
        inside = self.towards and context.at("towards").vector(self.towards)
        own: dict[str, Any] = {"structure": self.on or "", "towards": inside, "compression": True}
        return [self.at_point(name, point, normal, context, **own)]


class PiezometerSection(ValueGauge):
    """Pressure of the water in the pores at a point, compression positive, zero above its table.

    It reads that of `water` at rest, and in ground that consolidates what is in excess of it, too.
    """

    measures = ("pressure",)

    kind: Literal["piezometer"]
    point: Coordinates = Field(description="Where it is read.")

    def channels(self, name: str, context: Context) -> list[Channel]:
        """The one channel."""
        return [self.at_point(name, context.at("point").vector(self.point), None, context)]


class ThermometerSection(ValueGauge):
    """Temperature of the ground at a point, in stages that conduct heat."""

    measures = ("temperature",)

    kind: Literal["thermometer"]
    point: Coordinates = Field(description="Where it is read.")

    def channels(self, name: str, context: Context) -> list[Channel]:
        """The one channel."""
        return [self.at_point(name, context.at("point").vector(self.point), None, context)]


class LoadCellSection(ValueGauge):
    """Force of a structure: of one bolt, strut or anchor, or of a beam or a shell at a place.

    Bolts and anchors count tension positive, struts compression (`sign` says otherwise). Piles that
    bend have M, in kNm, with tension on the side of `towards`, and Q = dM/ds towards the toe. N of
    a beam is positive in tension, M with tension on the inside, Q = dM/ds with s along the beam and
    its inside to the right. Forces of a beam are per metre: N and Q in kN/m, M in kNm/m. Those of
    a shell likewise: n_11, n_22, n_12 in kN/m, tension positive, m_11, m_22, m_12 in kNm/m,
    positive with tension on the inside.
    """

    measures = FORCES

    kind: Literal["load-cell"]
    structure: Name = Field(description="The structure whose force is read.")
    bar: Annotated[int, Count()] | None = optional(
        "Which of its bars, counted from 1; may be missing if it has one, or where a "
        "`point` on grouted bars tells."
    )
    point: Coordinates | None = optional(
        "Where on a beam or a shell; on a grouted bar, where its grout begins if missing."
    )
    quantity: Literal["N", "M", "Q", "n_11", "n_22", "n_12", "m_11", "m_22", "m_12"] = Field(
        "N",
        description="Axial force, bending moment or shear force of a beam or a pile; of a shell "
        "a normal force, shear force in its plane or moment along its axes 1 and 2.",
    )
    sign: Literal["tension", "compression"] | None = optional(
        "Which axial force has positive readings."
    )
    towards: Coordinates | None = optional(TOWARDS)

    @property
    def dimension(self) -> str:
        """Dimension of what it reads: of one bar a force, of a beam a force or moment per metre."""
        if isinstance(self.accuracy, CaseNumber) and self.accuracy.text != ESTIMATE:
            return self.accuracy.dimension
        if self.point is None or self.bar is not None:
            return "moment" if self.quantity == "M" else "force"
        return "moment per length" if self.quantity[0] in "Mm" else "line load"

    def check(self, faults: SectionFaults) -> None:
        """A force is read; only an axial one has a sign."""
        super().check(faults)
        if isinstance(self.accuracy, CaseNumber) and self.dimension not in FORCES:
            message = f"'{self.accuracy.text}' is not a force or moment, or one per length"
            hint = "Forces of one bar in kN, M of a pile in kNm; N and Q of a beam in kN/m, M in "
            hint += "kNm/m."
            faults.add(("accuracy",), "unit", message, hint)
        if self.sign is not None and self.quantity not in ("N", "n_11", "n_22"):
            message = f"'sign' is that of the axial force; {self.quantity} is read"
            faults.add(("sign",), "wrong-pair", message, "Remove it; 'towards' turns moments.")

    def channels(self, name: str, context: Context) -> list[Channel]:
        """The one channel."""
        own: dict[str, Any] = {"quantity": self.quantity, "compression": self.sign == "compression"}
        places = self.point, self.bar, self.towards
        return [on_structure(self, name, *places, context, **own)]


def _refuse_twice(key: str, names: Sequence[str], faults: SectionFaults) -> None:
    for n, name in enumerate(names):
        if name in names[:n]:
            faults.add((key, n), "duplicate", f"'{name}' is listed twice", "Remove one.")


ForceSection = (
    StressGaugeSection
    | PressureCellSection
    | PiezometerSection
    | ThermometerSection
    | LoadCellSection
)
"""What a gauge of forces, stresses, pressures or temperatures may be."""

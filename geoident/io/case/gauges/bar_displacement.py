"""The gauge that reads how grouted bolts and piles move."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from geoident.io.case.frames import refuse_no_direction
from geoident.io.case.gauges.gauge import GaugeBase
from geoident.io.case.gauges.on_structure import on_structure
from geoident.io.case.gauges.value import unit_direction
from geoident.io.schema.section import Alternatives, Context, SectionFaults, optional
from geoident.io.schema.values import Coordinates, Count, DirectionVector, Name
from geoident.model.gauges import Channel


class BarDisplacementSection(GaugeBase):
    """Motion of a grouted bolt or a pile: of its head in a test, a telltale, a bent pile.

    Along itself, of a bolt positive out of the ground, towards its head, of a pile into it; of a
    pile that bends also along a `direction`. It is read while the bar stands since the zero.
    """

    one_of = (
        *GaugeBase.one_of,
        Alternatives("", "positive", "direction", hint="A direction has its own sign."),
    )

    kind: Literal["bar-displacement"]
    structure: Name = Field(description="The bolts or piles.")
    bar: Annotated[int, Count()] | None = optional(
        "Which of its bars, counted from 1; may be missing if it has one, or where a "
        "`point` on grouted bars tells."
    )
    point: Coordinates | None = optional("Where on the bar; where its grout begins if missing.")
    against: Literal["fixed", "ground"] = Field(
        "fixed", description="A place that does not move, or the ground at that point: the slip."
    )
    positive: Literal["out", "in"] | None = optional(
        "Which motion has positive readings: out of the ground, or into it."
    )
    direction: DirectionVector | None = optional(
        "Along which the motion of a pile that bends is read, in place of its own.",
        examples=[["1", "0"]],
    )

    def check(self, faults: SectionFaults) -> None:
        """The direction has a length."""
        super().check(faults)
        refuse_no_direction("direction", self.direction, faults)

    def channels(self, name: str, context: Context) -> list[Channel]:
        """The one channel."""
        own: dict[str, Any] = {"quantity": "slip" if self.against == "ground" else ""}
        along = unit_direction(self.direction, context.at("direction"))
        return [on_structure(self, name, self.point, self.bar, None, context, along, **own)]

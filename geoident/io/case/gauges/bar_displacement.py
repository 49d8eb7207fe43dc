"""The gauge that reads how grouted bolts and piles move along themselves."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from geoident.io.case.gauges.gauge import GaugeBase
from geoident.io.case.gauges.on_structure import on_structure
from geoident.io.schema.section import Context
from geoident.io.schema.values import Coordinates, Count, Name
from geoident.model.gauges import Channel


class BarDisplacementSection(GaugeBase):
    """Motion of a grouted bolt or a pile along itself: of its head in a test, or a telltale.

    Of a bolt positive out of the ground, towards its head; of a pile into it. It is read while the
    bar stands since the zero.
    """

    kind: Literal["bar-displacement"]
    structure: Name = Field(description="The bolts or piles.")
    bar: Annotated[int, Count()] | None = Field(
        None, description="Which of its bars, counted from 1; may be missing if it has one."
    )
    point: Coordinates | None = Field(
        None, description="Where on the bar; where its grout begins if missing."
    )
    against: Literal["fixed", "ground"] = Field(
        "fixed", description="A place that does not move, or the ground at that point: the slip."
    )
    positive: Literal["out", "in"] | None = Field(
        None, description="Which motion has positive readings: out of the ground, or into it."
    )

    def channels(self, name: str, context: Context) -> list[Channel]:
        """The one channel."""
        own: dict[str, Any] = {"quantity": "slip" if self.against == "ground" else ""}
        return [on_structure(self, name, self.point, self.bar, None, context, **own)]

"""The gauge of a model elsewhere: a named reading, of which the model knows where it is."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

from pydantic import Field, Tag, model_validator

from geoident.io.case.gauges.accuracy import ACCURACY, AS_PARTS, StandardDeviationOf
from geoident.io.case.gauges.value import ValueGauge
from geoident.io.schema.estimated import ESTIMATE
from geoident.io.schema.section import Context, SectionFaults
from geoident.io.schema.values import Given, Of
from geoident.model.gauges import PARTS, Channel
from geoident.units import DIMENSIONLESS, unit_list, with_article

OfAnyDimension = Annotated[
    Annotated[Given, StandardDeviationOf(None, above=0.0), Tag("text")] | AS_PARTS, ACCURACY
]
PlainOffset = Annotated[Given, Of(None, tied=True)]


class PlainReadingSection(ValueGauge):
    """A reading by its name: of a model that is computed elsewhere (`model`).

    What it reads has the unit of its accuracy. Without `zero` it is the number that the model
    gives, with `zero` its change since that stage.
    """

    kind: Literal["reading"]
    accuracy: OfAnyDimension = Field(
        description="Standard deviation of one reading, whose unit says what is read; or what its "
        "errors are made of, where readings share some.",
        examples=["0.1 mm", {"reading": "0.1 mm", "epoch": "0.2 mm"}],
    )

    offset: PlainOffset | None = Field(None, description="Added to all readings.")
    drift_per_stage: PlainOffset | None = Field(None, description="Drift per stage.")

    @model_validator(mode="after")
    def _sizes_are_given(self) -> PlainReadingSection:
        given = self.accuracy
        faults = SectionFaults()
        message = "nothing is known of the usual accuracy of a plain reading"
        hint = (
            "Give a size, and 'accuracies: estimate' under 'fit' to have it estimated from there."
        )
        if isinstance(given, Given):
            if given.text == ESTIMATE:
                faults.add(("accuracy",), "no-size", message, hint)
        else:
            for name in PARTS:
                part: Given | None = getattr(given, name)
                if part is not None and part.text == ESTIMATE:
                    faults.add(("accuracy", name), "no-size", message, hint)
        for key, added in (("offset", self.offset), ("drift_per_stage", self.drift_per_stage)):
            if added is None or added.parameter is not None:
                continue
            if added.dimension != self.dimension:
                message = f"'{added.text}' is {with_article(added.dimension)}; the accuracy says "
                message += f"that {with_article(self.dimension)} is read"
                faults.add((key,), "unit", message, f"Its units: {unit_list(self.dimension)}.")
        faults.raise_any()
        return self

    @property
    def dimension(self) -> str:
        """Dimension of what the gauge reads: that of its accuracy."""
        given = self.accuracy if isinstance(self.accuracy, Given) else self.accuracy.reading
        return given.dimension if given is not None else DIMENSIONLESS

    def channels(self, name: str, context: Context) -> list[Channel]:
        """The one channel, which is nowhere."""
        found = self.reads(name, name, (self.kind, None, (), ()), context.path)
        return [replace(found, reads=self.made_of)]

"""The gauge of a model elsewhere: a named reading, of which the model knows where it is."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

from pydantic import Field, Tag, model_validator

from geoident.io.case.gauges.accuracy import ACCURACY, AS_PARTS, UNKNOWN_SIZE, StandardDeviationOf
from geoident.io.case.gauges.gauge import Motion
from geoident.io.case.gauges.value import DRIFT, ValueGauge
from geoident.io.schema.estimated import ESTIMATE
from geoident.io.schema.section import Context, SectionFaults
from geoident.io.schema.values import CaseNumber, QuantityType
from geoident.model.gauges import PARTS, Channel
from geoident.units import DIMENSIONLESS

OfAnyDimension = Annotated[
    Annotated[CaseNumber, StandardDeviationOf(None, above=0.0, usual=False), Tag("text")]
    | AS_PARTS,
    ACCURACY,
]
PlainOffset = Annotated[CaseNumber, QuantityType(None, tied=True)]
PlainRate = PlainOffset


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
    drift: PlainRate | None = Field(None, description=DRIFT)
    drift_per_stage: PlainOffset | None = Field(None, description="Drift per stage.")

    @model_validator(mode="after")
    def _sizes_are_given(self) -> PlainReadingSection:
        given = self.accuracy
        faults = SectionFaults()
        for name in () if isinstance(given, CaseNumber) else PARTS:
            part: CaseNumber | None = getattr(given, name)
            if part is not None and part.text == ESTIMATE:
                faults.add(("accuracy", name), "no-size", *UNKNOWN_SIZE)
        self.note_other_dimensions(faults)
        faults.raise_any()
        return self

    @property
    def dimension(self) -> str:
        """Dimension of what the gauge reads: that of its accuracy."""
        given = self.accuracy if isinstance(self.accuracy, CaseNumber) else self.accuracy.reading
        return given.dimension if given is not None else DIMENSIONLESS

    def channels(self, name: str, context: Context) -> list[Channel]:
        """The one channel, which is nowhere."""
        found = self.make_channel(name, name, Motion(None, (), ()), context.path)
        return [replace(found, reads=self.reads)]

"""The gauge of a model elsewhere: a named reading, of which the model knows where it is."""

from __future__ import annotations

from typing import Literal

from geoident.io.case.gauges.gauge import Motion
from geoident.io.case.gauges.value import ValueGauge
from geoident.io.schema.section import Context
from geoident.io.schema.values import CaseNumber
from geoident.model.gauges import Channel
from geoident.units import DIMENSIONLESS


class PlainReadingSection(ValueGauge):
    """A reading by its name: of a model that is computed elsewhere (`model`).

    What it reads has the unit of its accuracy. Without `zero` it is the number that the model
    gives, with `zero` its change since that stage.
    """

    measures = ()

    kind: Literal["reading"]

    @property
    def dimension(self) -> str:
        """Dimension of what the gauge reads: that of its accuracy."""
        given = self.accuracy if isinstance(self.accuracy, CaseNumber) else self.accuracy.reading
        return given.dimension if given is not None else DIMENSIONLESS

    def channels(self, name: str, context: Context) -> list[Channel]:
        """The one channel, which is nowhere."""
        return [self.make_channel(name, name, Motion(None, (), ()), context.path)]

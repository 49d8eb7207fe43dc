"""What sections of gauges share that read a strain, a force, a stress or a pressure.

What they read has a value of its own: without `zero` it is the value itself that is read (a stress,
a force), with `zero` its change since that stage. Strains of the ground are changes always. The
plain reading of an external model, which knows where it is, stands here, too.
"""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from geoident.io.case.gauges.gauge import GaugeBase, Motion, unit_vector
from geoident.io.schema.section import Context
from geoident.io.schema.values import CaseNumber, Name
from geoident.model.arrays import Vector
from geoident.model.case import VIRGIN
from geoident.model.gauges import Channel, Reads
from geoident.units import DIMENSIONLESS

StressComponent = Literal["xx", "yy", "zz", "xy", "yz", "xz"]

_ZERO = (
    "Stage at whose end the gauge reads zero: it then reads the change since. Without it the "
    f"value itself is read. '{VIRGIN}' is the state before the first stage."
)


class ValueGauge(GaugeBase):
    """A gauge that reads values, or their changes."""

    zero: Name = Field(VIRGIN, description=_ZERO)

    @property
    def reads(self) -> Reads:
        """Whether a value is read, or a change since a zero that the case gives."""
        return Reads.CHANGE if "zero" in self.model_fields_set else Reads.VALUE

    def at_point(
        self,
        name: str,
        point: Vector,
        direction: Vector | None,
        place: Context,
        part: str = "",
        **given: Any,
    ) -> Channel:
        """One channel at a point.

        Args:
            name: of the gauge.
            point: where.
            direction: of what is read; None where it has none.
            place: where the gauge is written.
            part: the quantity that it reads, empty for the only one.
            given: see `make_channel`.
        """
        motion = Motion(None, point, direction or (0.0,) * place.dim)
        channel = f"{name}.{part}" if part else name
        return self.make_channel(channel, name, motion, place.path, **{"quantity": part, **given})


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


def unit_direction(given: list[CaseNumber] | None, place: Context) -> Vector | None:
    """A unit vector (dim,), if one is given."""
    return None if given is None else unit_vector(place.vector(given))


def check_component(component: str, place: Context) -> None:
    """Note a component that the analysis does not have."""
    if place.dim == 2 and component in ("yz", "xz"):
        message = f"a plane model has no component {component}"
        place.refuse("wrong-dimension", message, "Its components: xx, yy, zz, xy.")

"""What sections of gauges share that read a strain, a force, a stress or a pressure.

What they read has a value of its own: without `zero` it is the value itself that is read (a stress,
a force), with `zero` its change since that stage. Strains of the ground are changes always.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from pydantic import Field

from geoident.io.case.gauges.gauge import GaugeBase, Motion, point_of, unit_vector
from geoident.io.schema.section import Context, SectionFaults
from geoident.io.schema.values import CaseNumber, Name
from geoident.model.arrays import Vector
from geoident.model.case import VIRGIN
from geoident.model.gauges import Channel, Reads
from geoident.units import rate_of, unit_list, with_article

DRIFT = (
    "Drift of the gauge with time since its zero, without `zero` since the date of 'virgin'; "
    "needs dates."
)

StressComponent = Literal["xx", "yy", "zz", "xy", "yz", "xz"]

_ZERO = (
    "Stage at whose end the gauge reads zero: it then reads the change since. Without it the "
    f"value itself is read. '{VIRGIN}' is the state before the first stage."
)


class ValueGauge(GaugeBase):
    """A gauge that reads values, or their changes."""

    zero: Name = Field(VIRGIN, description=_ZERO)

    def note_other_dimensions(self, faults: SectionFaults) -> None:
        """Note what is added to readings, where it is no quantity like them.

        Args:
            faults: takes what is wrong.
        """
        read = self.dimension
        for key, wanted in (("offset", read), ("drift", rate_of(read)), ("drift_per_stage", read)):
            given: CaseNumber | None = getattr(self, key)
            if given is None or given.parameter is not None or given.dimension == wanted:
                continue
            message = f"'{given.text}' is {with_article(given.dimension)}; the accuracy says that "
            message += f"{with_article(read)} is read"
            hint = f"Its units: {unit_list(wanted)}." if wanted else "Use 'drift_per_stage'."
            faults.add((key,), "unit", message, hint)

    @property
    def reads(self) -> Reads:
        """Whether a value is read, or a change since a zero that the case gives."""
        return Reads.CHANGE if "zero" in self.model_fields_set else Reads.VALUE

    def at_point(
        self, name: str, part: str, point: Vector, direction: Vector, key: Context
    ) -> Channel:
        """One channel at a point.

        Args:
            name: of the gauge.
            part: the quantity that it reads, empty for the only one.
            point: where.
            direction: of what is read.
            key: where the gauge is written.
        """
        motion = Motion(None, point, direction)
        found = self.make_channel(f"{name}.{part}" if part else name, name, motion, key.path)
        return replace(found, reads=self.reads, quantity=part)


def optional_point(given: list[CaseNumber] | None, place: Context) -> Vector | None:
    """A point, if one is given; None, with a fault, for no point."""
    return None if given is None else point_of(given, place)


def unit_direction(given: list[CaseNumber] | None, place: Context) -> Vector | None:
    """A unit vector (dim,), zeros where none is given; None, with a fault, for no vector."""
    if given is None:
        return (0.0,) * place.dim
    vector = place.vector(given, "the direction")
    return None if vector is None else unit_vector(vector)


def has_component(component: str, place: Context) -> bool:
    """Whether the analysis has a component; a fault where it has not."""
    if place.dim == 3 or component not in ("yz", "xz"):
        return True
    message = f"a plane model has no component {component}"
    place.refuse("wrong-dimension", message, "Its components: xx, yy, zz, xy.")
    return False


def refuse_no_direction(key: str, given: list[CaseNumber] | None, faults: SectionFaults) -> None:
    """A fault where a vector has no direction.

    Args:
        key: where it is written, in its section.
        given: the vector, if there is one.
        faults: takes the fault.
    """
    if given is not None and not any(x.factor for x in given):
        message = "the direction has length zero"
        faults.add((key,), "zero-direction", message, "Write a vector such as [0, 1].")

"""Constants of a law: one for all gauges, or one for each, as numbers or tied to parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal, TypeVar

from pydantic import Discriminator, Tag

from geoident.io.case.external.surroundings import ModelContext
from geoident.io.schema.values import CaseNumber, Name, QuantityType
from geoident.model.case import KeyPath
from geoident.model.parameter import Scalar
from geoident.units import in_unit, shown_unit, with_article

_AT: KeyPath = ("model",)


def _shape(value: object) -> str:
    return "<by gauge>" if isinstance(value, Mapping) else "text"


_T = TypeVar("_T")
ByGauge = Annotated[
    Annotated[_T, Tag("text")] | Annotated[dict[Name, _T], Tag("<by gauge>")],
    Discriminator(_shape),
]
"""One number for all gauges, or gauge to number."""
Constant = CaseNumber | dict[str, CaseNumber]
"""A constant of all gauges, or one for each."""
LikeReading = Annotated[CaseNumber, QuantityType(None, tied=True)]
"""A constant of what the gauge reads."""


@dataclass(frozen=True)
class LawConstants:
    """Makes the constants of a law; what is wrong with them is noted.

    Args:
        law: what it is called.
        around: what the case says beside it.
    """

    law: str
    around: ModelContext

    def of(
        self, key: str, given: Constant, *, least: Literal["", "above", "at"] = ""
    ) -> tuple[Scalar, ...]:
        """One number for each channel.

        Args:
            key: of the constant, below ``model``; with dots where it is deeper.
            given: what is written there.
            least: ``above`` where it must be positive, ``at`` where it may be 0.
        """
        path: KeyPath = (*_AT, *key.split("."))
        around = self.around
        names = [channel.name for channel in around.channels]
        if isinstance(given, CaseNumber):
            self._require(path, given, least)
            return (given.scalar,) * len(names)
        for name, number in given.items():
            if name not in names:
                around.faults.add_unknown((*path, name), "gauge", name, names, key=True)
            self._require((*path, name), number, least)
        missing = [name for name in names if name not in given]
        if missing:
            message = f"no {key} for {', '.join(map(repr, missing))}"
            hint = "Add it, or write one number for all gauges."
            around.faults.add(path, "missing-gauge", message, hint, key=True)
        return tuple(given[name].scalar if name in given else Scalar(1.0) for name in names)

    def like_readings(self, key: str, given: Constant) -> tuple[Scalar, ...]:
        """One number for each channel, of the dimension of what it reads.

        Args:
            key: of the constant.
            given: what is written there.
        """
        scalars = self.of(key, given)
        for channel in self.around.channels:
            path: KeyPath = (*_AT, key)
            own = given if isinstance(given, CaseNumber) else given.get(channel.name)
            if own is None:
                continue
            if own is not given:
                path = (*path, channel.name)
            dimension = own.dimension
            if own.parameter is not None:
                parameter = self.around.parameters.get(own.parameter)
                dimension = channel.dimension if parameter is None else parameter.dimension
            if dimension != channel.dimension:
                message = f"'{own.text}' is {with_article(dimension)}; '{channel.name}' reads "
                message += with_article(channel.dimension)
                hint = "Correct its unit, or the accuracy of the gauge, which says what is read."
                self.around.faults.add(path, "unit", message, hint)
        return scalars

    def _require(self, path: KeyPath, given: CaseNumber, least: str) -> None:
        """A constant is positive at all values that its parameter may have."""

        def wrong(value: float) -> bool:
            return value <= 0.0 if least == "above" else value < 0.0

        words = "positive" if least == "above" else "0 or more"
        key = [part for part in path[1:] if part not in self._names][-1]
        parameter = self.around.parameters.get(given.parameter or "")
        if least and wrong(given.factor):
            message = f"'{given.text}': {key} must be {words}"
            self.around.faults.add(path, "out-of-range", message, "Correct the number.")
        elif least and parameter is not None and wrong(parameter.lower):
            unit = parameter.unit, parameter.dimension
            bound = f"{in_unit(parameter.lower, *unit):.6g} {shown_unit(*unit)}".rstrip()
            message = f"the bound {bound} lets {key} of the {self.law} be "
            message += "0 or negative" if least == "above" else "negative"
            hint = f"Raise it: {key} must be {words}."
            place: KeyPath = ("parameters", parameter.name, "bounds", 0)
            self.around.faults.add(place, "out-of-range", message, hint)

    @property
    def _names(self) -> set[str]:
        return {channel.name for channel in self.around.channels}

"""Parameters that are identified, and the numbers of a case that depend on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np

from geoident.model.arrays import Floats
from geoident.model.results.bands import NORMAL_95

Scale = Literal["linear", "log"]

Values = Mapping[str, float]
"""Parameter name to value, SI."""


@dataclass(frozen=True)
class Scalar:
    """A number of the case: ``factor``, or ``factor`` times a parameter.

    Args:
        factor: the number itself in SI units, or the tie's factor (dimensionless).
        parameter: name of the parameter it is tied to, or None for a given number.
    """

    factor: float
    parameter: str | None = None

    def value(self, values: Values) -> float:
        """The number at the given parameter values (SI).

        >>> Scalar(0.6, "E").value({"E": 10.0})
        6.0
        """
        return self.factor if self.parameter is None else self.factor * values[self.parameter]

    @property
    def parameters(self) -> frozenset[str]:
        """Names of the parameters that it depends on."""
        return frozenset() if self.parameter is None else frozenset({self.parameter})

    def columns(self, values: Values, names: Sequence[str]) -> Floats:
        """Its value, then its derivatives by n parameters, (1 + n,).

        Args:
            values: parameters by name, SI.
            names: to differentiate by.

        >>> Scalar(0.6, "E").columns({"E": 10.0}, ("E", "nu"))
        array([6. , 0.6, 0. ])
        """
        slopes = (self.factor if name == self.parameter else 0.0 for name in names)
        return np.array([self.value(values), *slopes])


def scalars_of(record: Any) -> dict[str, Scalar]:
    """The fields of a record that are numbers of the case, by name."""
    values = {entry.name: getattr(record, entry.name) for entry in fields(record)}
    return {name: value for name, value in values.items() if isinstance(value, Scalar)}


@dataclass(frozen=True)
class Prior:
    """What is known of a parameter before any reading (theory 6).

    Args:
        mean: mean (normal) or median (lognormal), SI.
        sd: standard deviation, SI; for lognormal that of the logarithm times ``mean``.
        kind: ``normal`` or ``lognormal``.
    """

    mean: float
    sd: float
    kind: Literal["normal", "lognormal"] = "normal"

    def __str__(self) -> str:
        """As programs read it.

        >>> str(Prior(8e6, 1e6))
        'normal(8e+06, 1e+06)'
        """
        return f"{self.kind}({self.mean:.6g}, {self.sd:.6g})"

    def score(self, value: float) -> float:
        """By how many standard deviations a value, SI, is off, of a lognormal one its logarithm.

        Minus infinity where a lognormal prior excludes it.

        >>> Prior(8.0, 2.0).score(5.0)
        -1.5
        """
        if self.kind == "normal":
            return (value - self.mean) / self.sd
        return float(np.log(value / self.mean)) * self.mean / self.sd if value > 0.0 else -np.inf

    def slope(self, value: float) -> float:
        """Derivative of `score`, 1/SI."""
        return 1.0 / self.sd if self.kind == "normal" else self.mean / (self.sd * value)

    def at_score(self, score: float) -> float:
        """The value, SI, that has a score."""
        if self.kind == "normal":
            return self.mean + self.sd * score
        return float(self.mean * np.exp(self.sd / self.mean * score))

    def narrows(self, lower: float, upper: float) -> bool:
        """Whether an end of its 95 % interval lies within bounds, SI: else only these limit.

        >>> Prior(8.0, 2.0).narrows(5.0, 20.0), Prior(8.0, 9.0).narrows(5.0, 20.0)
        (True, False)
        """
        return self.at_score(-NORMAL_95) > lower or self.at_score(NORMAL_95) < upper


@dataclass(frozen=True)
class Parameter:
    """One unknown of the identification.

    Args:
        name: the name behind ``$`` in the case.
        start: value to start from, SI.
        lower: lower bound, SI.
        upper: upper bound, SI.
        scale: ``log`` works on the logarithm (moduli), ``linear`` on the value itself.
        prior: knowledge beside the readings, or None.
        dimension: physical dimension, a key of `geoident.units.DIMENSIONS`.
        unit: unit in which the user wrote the start value, for tables.
        field: name of the field of which it is the coefficient of a mode; empty for a parameter
            that the case names. People are shown the field in its place.
        period: of an angle of axes or planes, rad: values that differ by it mean the same ground;
            None for what is no such angle.
        mirror: name of another angle and a half turn of it: with the other sign of this one and the
            other one further by that, the ground is the same (a dip and its direction).
        describe: what it is, in the words of the case.
    """

    name: str
    start: float
    lower: float
    upper: float
    scale: Scale = "linear"
    prior: Prior | None = None
    dimension: str = "dimensionless"
    unit: str = ""
    field: str = ""
    period: float | None = None
    mirror: tuple[str, float] | None = None
    describe: str = ""

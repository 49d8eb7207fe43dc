"""A project: several sections of one ground, and what their parameters have in common.

A law is a formula in what is known of a section and in constants that are found. It is evaluated
with dual numbers, so its derivatives are exact.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from geoident.errors import Location
from geoident.model.arrays import Floats
from geoident.model.dual import Dual
from geoident.model.parameter import Parameter

FUNCTIONS: Mapping[str, Callable[[Dual], Dual]] = {
    "exp": Dual.exp,
    "log": Dual.log,
    "log10": lambda x: x.log() * (1.0 / np.log(10.0)),
    "sqrt": Dual.root,
}
"""Functions that a law may use; ``log`` is the natural logarithm."""


@dataclass(frozen=True)
class LawTerm:
    """A node of a formula.

    Args:
        kind: ``number``, ``name``, one of ``+ - * / ^``, ``negative``, or a key of `FUNCTIONS`.
        arguments: one or two terms; none of a number or a name.
        value: of a number.
        name: of a name.
    """

    kind: str
    arguments: tuple[LawTerm, ...] = ()
    value: float = 0.0
    name: str = ""

    def names(self) -> Iterator[str]:
        """All names in the formula, from left to right."""
        if self.kind == "name":
            yield self.name
        for argument in self.arguments:
            yield from argument.names()

    def at(self, values: Mapping[str, Dual]) -> Dual:
        """The value of the formula and its derivatives.

        Args:
            values: of all its names.

        >>> x = Dual(np.array([3.0, 1.0]))
        >>> two = LawTerm("number", value=2.0)
        >>> LawTerm("*", (two, LawTerm("name", name="x"))).at({"x": x}).columns
        array([6., 2.])
        """
        match self.kind:
            case "number":
                return Dual.constant(self.value, next(iter(values.values())).n if values else 0)
            case "name":
                return values[self.name]
        found = [argument.at(values) for argument in self.arguments]
        with np.errstate(all="ignore"):  # what is not finite is seen by who asks
            return _applied(self.kind, found)


def _applied(kind: str, of: list[Dual]) -> Dual:
    if kind == "negative":
        return -of[0]
    return FUNCTIONS[kind](of[0]) if kind in FUNCTIONS else _OPERATIONS[kind](of[0], of[1])


def _power(base: Dual, exponent: Dual) -> Dual:
    """A power; of a base that is not positive only where the exponent is a given number."""
    if exponent.columns[..., 1:].any():
        return base.power(exponent)
    n = float(exponent.value)
    if n == 0.0:
        return base.times(0.0).plus(1.0)
    return base.through(lambda x: x**n, lambda x: n * x ** (n - 1.0))


_OPERATIONS: Mapping[str, Callable[[Dual, Dual], Dual]] = {
    "+": lambda x, y: x + y,
    "-": lambda x, y: x - y,
    "*": lambda x, y: x * y,
    "/": lambda x, y: x / y,
    "^": _power,
}


ScatterKind = Literal["estimate", "given", "none"]


@dataclass(frozen=True)
class Scatter:
    """How far the sections scatter about a law.

    Args:
        kind: ``estimate`` from the sections, ``given``, or ``none``: the law holds everywhere.
        size: standard deviation where it is given: of the logarithm for a parameter scaled by it,
            else SI.
        dimension: of what was given, key of `geoident.units.DIMENSIONS`.
    """

    kind: ScatterKind = "estimate"
    size: float = 0.0
    dimension: str = ""


@dataclass(frozen=True)
class ParameterLaw:
    """The law of a parameter of the sections.

    Args:
        parameter: its name in the cases.
        text: the formula as written.
        formula: of what is known of a section and of the law's own constants, SI.
        constants: the law's own, which are found.
        scatter: of the sections about it.
    """

    parameter: str
    text: str
    formula: LawTerm
    constants: tuple[Parameter, ...]
    scatter: Scatter

    def at(self, covariates: Mapping[str, float], constants: Floats) -> tuple[float, Floats]:
        """The value in a section, SI, and its derivatives (c,) by the law's constants.

        Args:
            covariates: what is known of the section, SI.
            constants: (c,) SI.
        """
        n = len(self.constants)
        values = {name: Dual.constant(value, n) for name, value in covariates.items()}
        for k, constant in enumerate(self.constants):
            values[constant.name] = Dual(np.array([constants[k], *np.eye(n)[k]]))
        found = self.formula.at(values)
        return float(found.value), np.asarray(found.columns[1:])


@dataclass(frozen=True)
class ProjectSection:
    """A section of a project.

    Args:
        name: of it.
        case: path of its case.
        overrides: of values of its case, ``path=value``.
        covariates: what is known of it, SI.
        predicted: it is left out of the fit and predicted.
        place: where it is written.
        places: where each of its overrides is written, in their order.
    """

    name: str
    case: str
    overrides: tuple[str, ...]
    covariates: Mapping[str, float]
    predicted: bool
    place: Location
    places: tuple[Location, ...] = ()


@dataclass(frozen=True)
class Covariate:
    """Something that is known of every section.

    Args:
        name: of it.
        dimension: key of `geoident.units.DIMENSIONS`.
        unit: in which it is written first.
    """

    name: str
    dimension: str
    unit: str


@dataclass(frozen=True)
class Project:
    """Several sections of one ground.

    Args:
        path: of the file.
        title: free text.
        sections: all of them, also those that are left out.
        covariates: what is known of every section.
        shared: names of parameters with one value for all sections.
        laws: of parameters that differ from section to section.
        places: key path, such as ``("shared", 0)``, to where it is written.
    """

    path: str
    title: str
    sections: tuple[ProjectSection, ...]
    covariates: tuple[Covariate, ...]
    shared: tuple[str, ...]
    laws: tuple[ParameterLaw, ...]
    places: Mapping[tuple[str | int, ...], Location]

    @property
    def fitted(self) -> tuple[ProjectSection, ...]:
        """The sections whose readings are used."""
        return tuple(section for section in self.sections if not section.predicted)

    def place(self, *path: str | int) -> Location:
        """Where a key is written; the nearest one above it where it is not."""
        for end in range(len(path), 0, -1):
            if path[:end] in self.places:
                return self.places[path[:end]]
        return Location(self.path)

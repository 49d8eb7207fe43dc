"""A project: several sections of one ground, and what their parameters have in common."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from geoident.errors import Location
from geoident.model.arrays import Floats
from geoident.model.dual import Dual
from geoident.model.parameter import Parameter
from geoident.model.project.formulas import LawTerm
from geoident.model.run import Run

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
        value = self.formula.at(values)
        return float(value.value), np.asarray(value.columns[1:])


@dataclass(frozen=True)
class ProjectSection(Run):
    """A section of a project: a run of its case, and what is known beside.

    Args:
        covariates: what is known of it, SI.
        predicted: it is left out of the fit and predicted.
    """

    covariates: Mapping[str, float] = field(default_factory=dict)
    predicted: bool = False


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

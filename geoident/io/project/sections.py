"""The keys of a project file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from geoident.io.case.parameters import ParameterSection
from geoident.io.project.formula import parse_formula
from geoident.io.schema.estimated import ESTIMATE, NONE, SizeOrWord
from geoident.io.schema.run_file import Settings
from geoident.io.schema.section import Section, optional
from geoident.io.schema.values import (
    AnyQuantity,
    CaseNumber,
    Flag,
    Name,
    ParameterName,
    Text,
    require_text,
)
from geoident.io.text.wording import Refusal, did_you_mean, shorten
from geoident.units import DIMENSIONLESS


def _formula(value: object) -> str:
    text = require_text(value, "a formula")
    parse_formula(text)
    return text


@dataclass(frozen=True)
class ScatterSize(SizeOrWord):
    """Annotation of a `CaseNumber`: standard deviation, ``estimate`` or ``none`` (NaN, zero)."""

    dimension: str | None = None
    expected = "a standard deviation, such as 30 %, or estimate or none"
    called = "standard deviation"
    code = "bad-scatter"
    shown = (ESTIMATE, NONE, "30 %")

    def remedy(self, text: str) -> str:
        """What to write in place of a text that is neither."""
        return did_you_mean(text, (ESTIMATE, NONE), what="Words")

    def refuse_size(self, given: CaseNumber) -> None:
        """Judge a size.

        Raises:
            Refusal: it is not positive.
        """
        if given.factor <= 0.0:
            message = f"'{shorten(given.text)}': a standard deviation is above zero"
            raise Refusal("out-of-range", message, f"Write '{NONE}' where nothing scatters.")


class SiteSection(Section):
    """A section: a case, and what is known of the section beside it."""

    name: Name | None = optional("Name of the section; by default that of the file of its case.")
    case: Text = Field(description="Path of its case.", examples=["km-1.yaml"])
    set: Settings = Field(
        {},
        description="Path to a value that replaces that of its case.",
        examples=[{"readings": "km-1.csv", "in_situ.vertical": "8 MPa"}],
    )
    covariates: dict[ParameterName, AnyQuantity] = Field(
        {},
        description="What is known of it, by which its parameters may differ; the same names for "
        "all sections.",
        examples=[{"GSI": 27, "depth": "120 m"}],
    )
    predict: Flag = Field(
        False,
        description="The section is left out of the fit, and predicted; its readings only judge "
        "the prediction.",
    )


class LawSection(Section):
    """How a parameter follows from what is known of a section."""

    formula: Annotated[str, BeforeValidator(_formula)] = Field(
        description="Its value, from covariates and constants of the law by + - * / ^, exp, log "
        "(natural), log10 and sqrt, all in SI units.",
        examples=["a * exp(b * GSI)"],
    )
    constants: dict[ParameterName, ParameterSection] = Field(
        {}, description="Name to a constant of the law, which is found; it has its bounds and may "
        "have a prior as a parameter of a case.",
    )  # fmt: skip
    scatter: Annotated[CaseNumber, ScatterSize()] = Field(
        CaseNumber(ESTIMATE, math.nan, None, DIMENSIONLESS),
        description="Standard deviation by which sections scatter about the law: `estimate`d from "
        "them, given, or `none`. Of a parameter with `scale: log` it is that of the logarithm "
        "(30 % or 0.3), else in the unit of the parameter.",
    )


class ProjectFile(Section):
    """A project for geoident: several sections of one ground, and what they have in common."""

    format: Literal["geoident-project/1"] = Field(description="Type and version of this file.")
    title: Text = Field("", description="Free text.")
    sections: list[SiteSection] = Field(min_length=1, description="The sections.")
    shared: list[ParameterName] = Field(
        [],
        description="Parameters of the cases that have one value for all sections.",
        examples=[["K0"]],
    )
    laws: dict[ParameterName, LawSection] = Field(
        {},
        description="Parameter of the cases to the law that it follows. Parameters that are "
        "neither shared nor have a law are of each section alone.",
    )

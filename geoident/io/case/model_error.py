"""The model error of a fit: ``estimate``, ``none``, a part of the motion, or a mapping."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Discriminator, Field, GetJsonSchemaHandler, Tag
from pydantic_core import CoreSchema

from geoident.io.schema.section import Section
from geoident.io.schema.values import Given, GivenSize, Of, or_words, require_text
from geoident.io.text.wording import Refusal, did_you_mean, shorten
from geoident.model.methods import ModelErrorOptions
from geoident.units import DIMENSIONLESS, UnitError

ESTIMATE, NONE = "estimate", "none"

_NO = ("no", "off", "false")
_LARGEST = 2.0
"""A model that is wrong by twice its own motion is no model."""


def _hint(text: str) -> str:
    near = did_you_mean(text, (ESTIMATE, NONE))
    return near if near.startswith("Did") else "Write it such as 15 %."


@dataclass(frozen=True)
class RelativeError(Of):
    """Annotation of a `Given`: a part of the motion, ``estimate`` or ``none`` (a NaN, a zero)."""

    dimension: str | None = DIMENSIONLESS

    def parse(self, value: object) -> Given:
        """The size that a text says.

        Raises:
            Refusal: no such text, or a size out of range.
        """
        if isinstance(value, Given):
            return value
        text = require_text(value, self.words())
        if text.strip() in (ESTIMATE, NONE):
            size = math.nan if text.strip() == ESTIMATE else 0.0
            return Given(text.strip(), size, None, DIMENSIONLESS)
        try:
            given = super().parse(text)
        except (UnitError, Refusal) as error:
            message = f"'{shorten(text)}' is not {self.words()}"
            hint = f"Did you mean '{NONE}'?" if text.strip() in _NO else _hint(text.strip())
            raise Refusal("bad-model-error", message, hint) from error
        if not 0.0 <= given.factor <= _LARGEST:
            message = f"'{shorten(text)}': it must be between 0 and {100 * _LARGEST:g} %"
            bare = given.unit == "" and given.factor > _LARGEST
            hint = f"Did you mean '{text} %'?" if bare else "10 to 30 % of the motion are usual."
            raise Refusal("out-of-range", message, hint)
        return given

    def words(self) -> str:
        """What is expected, for a message."""
        return "a part of the computed motion, such as 15 %, or estimate or none"

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        described = super().__get_pydantic_json_schema__(schema, handler)
        or_words(described, ESTIMATE, NONE)
        described["description"] = self.words()
        described["examples"] = ["15 %", ESTIMATE, NONE]
        described["x-quantity"] = f"part of the motion, `{ESTIMATE}` or `{NONE}`"
        return described


class ModelErrorSection(Section):
    """How far the ground may differ from the model."""

    size: Annotated[Given, RelativeError()] = Field(
        Given(ESTIMATE, math.nan, None, DIMENSIONLESS),
        description="Part of the computed motion by which the model is wrong; `estimate` from what "
        "is left of the readings, or `none`.",
    )
    length: GivenSize | None = Field(
        None,
        description="Distance over which it is correlated; without it, how far the gauges are "
        "spread. The results hardly depend on it.",
        examples=["20 m"],
    )


def _shape(value: object) -> str:
    return "mapping" if isinstance(value, Mapping | ModelErrorSection) else "text"


ModelErrorValue = Annotated[
    Annotated[Given, RelativeError(), Tag("text")] | Annotated[ModelErrorSection, Tag("mapping")],
    Discriminator(_shape),
]


def model_error_options(value: Given | ModelErrorSection | None) -> ModelErrorOptions:
    """What a case says of the model error, for the model.

    Args:
        value: as it is written, or None where it is not.
    """
    if value is None:
        return ModelErrorOptions()
    size = value.size if isinstance(value, ModelErrorSection) else value
    given = value.length if isinstance(value, ModelErrorSection) else None
    length = None if given is None else given.factor
    if math.isnan(size.factor):
        return ModelErrorOptions("estimate", length=length, written=True)
    if size.factor == 0.0:
        return ModelErrorOptions("none", length=length, written=True)
    return ModelErrorOptions("given", size.factor, length, written=True)

"""The model error of a fit: ``estimate``, ``none``, a part of the motion, or a mapping."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from geoident.io.schema.estimated import ESTIMATE, NONE, SizeOrWord
from geoident.io.schema.section import Section, optional
from geoident.io.schema.values import CaseNumber, FixedDuration, FixedSize, TextOrMapping
from geoident.io.text.wording import Refusal, did_you_mean, shorten
from geoident.model.methods import ModelErrorOptions
from geoident.units import DIMENSIONLESS

_NO = ("no", "off", "false")
_LARGEST = 2.0
"""A model that is wrong by twice its own motion is no model."""


@dataclass(frozen=True)
class RelativeError(SizeOrWord):
    """Annotation of a `CaseNumber`: part of the motion, ``estimate`` or ``none`` (NaN, zero)."""

    dimension: str | None = DIMENSIONLESS
    expected = "a part of the computed motion, such as 15 %, or estimate or none"
    called = "part of the motion"
    code = "bad-model-error"
    shown = ("15 %", ESTIMATE, NONE)

    def remedy(self, text: str) -> str:
        """What to write in place of a text that is neither."""
        if text in _NO:
            return f"Did you mean '{NONE}'?"
        near = did_you_mean(text, (ESTIMATE, NONE))
        return near if near.startswith("Did") else "Write it such as 15 %."

    def refuse_size(self, given: CaseNumber) -> None:
        """Judge a size.

        Raises:
            Refusal: it is negative, or larger than a model may err.
        """
        if 0.0 <= given.factor <= _LARGEST:
            return
        message = f"'{shorten(given.text)}': it must be between 0 and {100 * _LARGEST:g} %"
        bare = given.unit == "" and given.factor > _LARGEST
        hint = f"Did you mean '{given.text} %'?" if bare else "10 to 30 % of the motion are usual."
        raise Refusal("out-of-range", message, hint)


class ModelErrorSection(Section):
    """How far the ground may differ from the model."""

    size: Annotated[CaseNumber, RelativeError()] = Field(
        CaseNumber(ESTIMATE, math.nan, None, DIMENSIONLESS),
        description="Part of the computed motion by which the model is wrong; `estimate` from the "
        "residuals, or `none`.",
    )
    length: FixedSize | None = optional(
        "Distance over which it is correlated; without it, how far the gauges are "
        "spread. The results hardly depend on it.",
        examples=["20 m"],
    )
    time: FixedDuration | None = optional(
        "Time over which it is correlated: errors then last, and are those of what "
        "is read since the zero. Without it a third of the time of the readings, where the model "
        "is a program, a function, a table or a law; of other models each stage has an "
        "error of its own beside that of all. Needs dates.",
        examples=["60 days"],
    )


ModelErrorValue = TextOrMapping[Annotated[CaseNumber, RelativeError()], ModelErrorSection]


def model_error_options(value: CaseNumber | ModelErrorSection | None) -> ModelErrorOptions:
    """What a case says of the model error, for the model.

    Args:
        value: as it is written, or None where it is not.
    """
    if value is None:
        return ModelErrorOptions()
    size = value.size if isinstance(value, ModelErrorSection) else value
    given = value.length if isinstance(value, ModelErrorSection) else None
    length = None if given is None else given.factor
    lasting = value.time if isinstance(value, ModelErrorSection) else None
    time = None if lasting is None else lasting.factor
    if math.isnan(size.factor):
        return ModelErrorOptions("estimate", length=length, time=time, written=True)
    if size.factor == 0.0:
        return ModelErrorOptions("none", length=length, time=time, written=True)
    return ModelErrorOptions("given", size.factor, length, time, written=True)

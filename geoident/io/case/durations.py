"""How long a stage lasts, as a case says it, and the moments that it names.

A moment is named by its stage and the time since that began: ``fill 1 + 12 d``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from geoident.io.schema.values import CaseNumber, QuantityType, or_words, require_text
from geoident.io.text.wording import Refusal, shorten
from geoident.model.moments import (
    moment_name,
    rounded,
    stage_and_time,
    time_text,
)
from geoident.units import UnitError

BY_DATES = "dates"
"""Stands in place of a duration that follows from `dates`."""

_DATE = re.compile(r"\d{1,4}[-./]\d{1,2}[-./]\d{1,4}")

SAME = 1.0
"""Dates and durations agree to this, s."""


@dataclass(frozen=True)
class DurationOrDates(QuantityType):
    """Annotation of a `CaseNumber`: a time from zero on, or ``dates`` (a NaN)."""

    dimension: str | None = "time"
    expected: ClassVar[str] = f"a time such as 12 d, or {BY_DATES}"

    def parse(self, value: object) -> CaseNumber:
        """The time that a text says.

        Raises:
            Refusal: no such text, or a negative time.
        """
        if isinstance(value, CaseNumber):
            return value
        text = require_text(value, self.expected).strip()
        if text == BY_DATES:
            return CaseNumber(text, math.nan, None, "time")
        try:
            given = super().parse(text)
        except (UnitError, Refusal) as error:
            message = f"'{shorten(text)}' is not {self.expected}"
            hint = f"Write it like 12 d, or '{BY_DATES}' for what the dates of stages say."
            raise Refusal("bad-time", message, hint) from error
        return require_no_negative(given)

    def described(self) -> dict[str, Any]:
        """The JSON schema of the number."""
        described = super().described()
        or_words(described, BY_DATES)
        described["description"] = self.expected
        described["x-quantity"] = f"time, or `{BY_DATES}`"
        return described


def require_no_negative(given: CaseNumber) -> CaseNumber:
    """A time, as it is given.

    Raises:
        Refusal: it is negative.
    """
    if given.factor < 0.0:
        message = f"'{given.text}' is a negative time"
        raise Refusal("out-of-range", message, "Write it without its sign, or 0 d for no time.")
    return given


@dataclass(frozen=True)
class Timetable:
    """When the stages of a case begin and end, as far as it says so.

    Args:
        stages: names, the virgin state first.
        bases: stage to that on which it builds.
        lasts: stage to how long it lasts, s, for those that last.
        dates: stage to the date of its end, seconds since 1970.
    """

    stages: tuple[str, ...]
    bases: Mapping[str, str] = field(default_factory=dict)
    lasts: Mapping[str, float] = field(default_factory=dict)
    dates: Mapping[str, float] = field(default_factory=dict)

    def begin(self, stage: str) -> float | None:
        """The date at which a stage that lasts begins, seconds since 1970; None if unknown."""
        end = self.dates.get(stage)
        return None if end is None or stage not in self.lasts else end - self.lasts[stage]

    def moment(self, name: str) -> tuple[str, float] | None:
        """Stage and time, s since it began, of the name of a moment; None if it is none.

        Raises:
            Refusal: there is no such moment.
        """
        parts = None if name in self.stages else stage_and_time(name, self.stages)
        if parts is None:
            return None
        stage, text = parts
        try:
            time = require_no_negative(QuantityType("time").parse(text)).factor
        except UnitError as error:
            message = f"'{shorten(text)}' is not the time since the beginning of '{stage}'"
            raise Refusal("bad-time", message, error.hint) from error
        self.require_within(stage, time)
        return stage, rounded(time)

    def require_within(self, stage: str, time: float) -> None:
        """A stage has a moment at a time, s since its beginning.

        Raises:
            Refusal: it does not last, or not so long.
        """
        lasts = self.lasts.get(stage)
        if lasts is None:
            message = (
                f"the stage '{stage}' has no duration, so it has no moment at {time_text(time)}"
            )
            longer = time_text(max(time, 86400.0))
            hint = f"Say how long it lasts, such as lasts: {longer}; or leave out the time."
            raise Refusal("no-duration", message, hint)
        if time > lasts + SAME:
            message = f"'{stage}' lasts {time_text(lasts)}, and {time_text(time)} is later"
            hint = f"Let it last longer (lasts: {time_text(time)}), or name a later stage."
            raise Refusal("after-stage", message, hint)

    def canonical(self, name: str) -> str:
        """The name of a stage or moment as results have it; one that is neither as it is.

        Raises:
            Refusal: there is no such moment.
        """
        moment = self.moment(name)
        return name if moment is None else self.name_of(*moment)

    def name_of(self, stage: str, time: float) -> str:
        """The name of a moment of a stage that lasts, of which the last one is its end."""
        return stage if time >= self.lasts[stage] - SAME else moment_name(stage, time)


def is_date(text: str) -> bool:
    """Whether a text begins as a date does, of whatever form."""
    return _DATE.match(text) is not None

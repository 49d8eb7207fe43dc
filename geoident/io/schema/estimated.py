"""Sizes that need not be given: ``estimate`` or ``none`` stands in place of a number."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

from geoident.io.schema.values import CaseNumber, QuantityType, or_words, require_text
from geoident.io.text.wording import Refusal, shorten
from geoident.units import DIMENSIONLESS, UnitError

ESTIMATE, NONE = "estimate", "none"


@dataclass(frozen=True)
class SizeOrWord(QuantityType):
    """Annotation of a `CaseNumber`: a size, ``estimate`` or ``none`` (a NaN, a zero).

    Attributes:
        expected: what is expected, for messages.
        called: what the size is, for the page of keys.
        code: of the fault where it is neither.
        shown: examples.
    """

    expected: ClassVar[str]
    called: ClassVar[str]
    code: ClassVar[str]
    shown: ClassVar[tuple[str, ...]]

    @abstractmethod
    def remedy(self, text: str) -> str:
        """What to write in place of a text that is neither."""

    @abstractmethod
    def refuse_size(self, given: CaseNumber) -> None:
        """Judge a size.

        Raises:
            Refusal: it is out of range.
        """

    def parse(self, value: object) -> CaseNumber:
        """The size that a text says.

        Raises:
            Refusal: no such text, or a size out of range.
        """
        if isinstance(value, CaseNumber):
            return value
        text = require_text(value, self.words()).strip()
        if text in (ESTIMATE, NONE):
            return CaseNumber(text, math.nan if text == ESTIMATE else 0.0, None, DIMENSIONLESS)
        try:
            given = super().parse(text)
        except (UnitError, Refusal) as error:
            message = f"'{shorten(text)}' is not {self.words()}"
            raise Refusal(self.code, message, self.remedy(text)) from error
        self.refuse_size(given)
        return given

    def words(self) -> str:
        """What is expected, for a message."""
        return self.expected

    def described(self) -> dict[str, Any]:
        """The JSON schema of the number."""
        described = super().described()
        or_words(described, ESTIMATE, NONE)
        described["description"] = self.words()
        described["examples"] = list(self.shown)
        described["x-quantity"] = f"{self.called}, `{ESTIMATE}` or `{NONE}`"
        return described

"""A key that holds a time: text in the file, in SI a number."""

from __future__ import annotations

from typing import Annotated

from pydantic import BeforeValidator, PlainSerializer, WithJsonSchema

from geoident.io.schema.values import require_text
from geoident.io.text.wording import Refusal, shorten
from geoident.units import UnitError, read_duration


def _duration(value: object) -> float:
    """Seconds of a text such as ``90 s``, ``10 min`` or ``1h30min``."""
    if isinstance(value, float):
        return value
    text = require_text(value, "a time").strip()
    try:
        seconds = read_duration(text)
    except UnitError as error:
        raise Refusal("bad-time", f"'{shorten(text)}' is not a time", error.hint) from error
    if seconds <= 0.0:
        raise Refusal("bad-time", "the time must be positive", "Remove the key.")
    return seconds


GivenTime = Annotated[
    float,
    BeforeValidator(_duration),
    PlainSerializer(lambda seconds: f"{seconds:g} s"),
    WithJsonSchema({"type": "string", "description": "a time such as 30 s or 1h30min"}),
]
"""Seconds; written again as text, as in the file."""

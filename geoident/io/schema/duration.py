"""Times as people write them: ``90 s``, ``10 min``, ``1h30min``."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import BeforeValidator

from geoident.io.schema.values import require_text
from geoident.io.text.wording import Refusal, shorten

_PART = re.compile(r"\s*([0-9]+(?:\.[0-9]*)?)\s*([a-z]+)\s*")
_SECONDS = {"s": 1.0, "sec": 1.0, "min": 60.0, "m": 60.0, "h": 3600.0, "d": 86400.0}


def _duration(value: object) -> float:
    """Seconds of a text such as ``90 s``, ``10 min`` or ``1h30min``."""
    if isinstance(value, float):
        return value
    text = require_text(value, "a time").strip()
    parts = _PART.findall(text)
    if not parts or _PART.sub("", text) or any(unit not in _SECONDS for _, unit in parts):
        hint = "Write it like 90 s, 10 min or 1h30min."
        raise Refusal("bad-time", f"'{shorten(text)}' is not a time", hint)
    seconds = sum(float(number) * _SECONDS[unit] for number, unit in parts)
    if seconds <= 0.0:
        raise Refusal("bad-time", "the time must be positive", "Remove the key.")
    return seconds


GivenTime = Annotated[float, BeforeValidator(_duration, json_schema_input_type=str)]

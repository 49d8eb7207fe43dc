"""The words of a case as pydantic types: texts, names and true or false."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import BeforeValidator, Field

from geoident.io.text.wording import Refusal, shorten

NAME_PATTERN = r"[A-Za-z_][A-Za-z0-9_]*"


def require_text(value: object, expected: str) -> str:
    """The text itself.

    Raises:
        Refusal: nothing, a list or a mapping is written.
    """
    if isinstance(value, str):
        return value
    raise Refusal("wrong-kind", f"found {kind_of(value)}; {expected} is expected")


def kind_of(value: object) -> str:
    """What a node of the file is, for a message."""
    if value is None:
        return "nothing"
    if isinstance(value, dict):
        return "a mapping"
    return "a list" if isinstance(value, list) else f"'{shorten(value)}'"


def _flag(value: object) -> bool:
    if isinstance(value, bool):
        return value
    text = require_text(value, "true or false")
    if text not in {"true", "false"}:
        raise Refusal("not-listed", f"found '{shorten(text)}'; true or false is expected")
    return text == "true"


def _name(value: object) -> str:
    text = require_text(value, "a name")
    if not text.strip() or text != text.strip() or "\n" in text or len(text) > 100:
        hint = "One line, up to 100 characters, without blanks at its ends."
        raise Refusal("bad-name", f"'{shorten(text)}' is not a name", hint)
    return text


def _parameter_name(value: object) -> str:
    text = require_text(value, "a name")
    if not re.fullmatch(NAME_PATTERN, text):
        hint = "Letters, digits and underscores, not beginning with a digit."
        raise Refusal("bad-name", f"'{shorten(text)}' is not a name for a parameter", hint)
    return text


Flag = Annotated[bool, BeforeValidator(_flag)]
Name = Annotated[str, BeforeValidator(_name)]
ParameterName = Annotated[
    str, BeforeValidator(_parameter_name), Field(pattern=rf"^{NAME_PATTERN}$")
]
Text = Annotated[str, BeforeValidator(lambda value: require_text(value, "a text"))]

"""``geoident schema``: the JSON schema of case files, for editors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from geoident.io.schema import case_schema


def schema() -> Mapping[str, Any]:
    """The JSON schema of a case file."""
    return case_schema()

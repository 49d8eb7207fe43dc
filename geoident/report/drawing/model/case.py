"""The case behind a result, from the result file alone."""

from __future__ import annotations

from functools import lru_cache

from geoident.errors import InputError
from geoident.io.case.file import parse_case
from geoident.model.case import Case
from geoident.model.results.result import Result


def case_of(result: Result) -> Case | None:
    """The case of a result without its readings; None where this version cannot read it."""
    return _parsed(result.case_resolved)


@lru_cache(maxsize=8)
def _parsed(text: str) -> Case | None:
    try:
        return parse_case(
            text, "case.yaml", overrides=["readings=[]"], with_mesh=False, with_texts=False
        ).case
    except InputError:
        return None

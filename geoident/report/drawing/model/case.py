"""The case behind a result, from the result file alone."""

from __future__ import annotations

from functools import lru_cache

from geoident.errors import InputError
from geoident.model.case import Case
from geoident.model.results.result import Result


def case_of(result: Result) -> Case | None:
    """The case of a result without its readings; None where this version cannot read it."""
    return _case_of_text(result.case_resolved)


@lru_cache(maxsize=8)  # A page compares few results, and asks for the case of each several times.
def _case_of_text(text: str) -> Case | None:
    from geoident.io.case.file import parse_case  # noqa: PLC0415 - large, and not needed elsewhere

    try:
        return parse_case(
            text, "case.yaml", overrides=["readings=[]"], with_mesh=False, with_texts=False
        ).case
    except InputError:
        return None

"""The case behind a result, from the result file alone."""

from __future__ import annotations

from geoident.errors import InputError
from geoident.io.case.file import parse_case
from geoident.model.case import Case
from geoident.model.results.result import Result


def case_of(result: Result) -> Case | None:
    """The case of a result without its readings; None where this version cannot read it."""
    try:
        return parse_case(
            result.case_resolved, "case.yaml", overrides=["readings=[]"], with_mesh=False
        ).case
    except InputError:
        return None

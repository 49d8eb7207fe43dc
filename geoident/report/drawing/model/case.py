"""The case behind a result, from the result file alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from geoident.errors import InputError
from geoident.model.case import Case
from geoident.model.results.result import Labelled, Result

_MOST = 8
"""Cases that are kept."""

_known: dict[str, Case | None] = {}
"""Those that were read last, by their texts; None for one that this version cannot read."""


def case_of(result: Result) -> Case | None:
    """The case of a result without its readings; None where this version cannot read it."""
    text = result.case_resolved
    if text not in _known:
        remember(cases_of_texts([text]))
    return _known[text]


def texts_of_cases(results: Labelled) -> tuple[str, ...]:
    """The texts of the cases of some results, each once."""
    return tuple(dict.fromkeys(result.case_resolved for _, result in results))


def cases_of_texts(texts: Iterable[str]) -> dict[str, Case | None]:
    """The cases of some texts, such as another process may read them meanwhile."""
    from geoident.io.case.file import parse_case  # noqa: PLC0415 - large, and not needed elsewhere

    found: dict[str, Case | None] = {}
    for text in texts:
        try:
            found[text] = parse_case(
                text, "case.yaml", overrides=["readings=[]"], with_mesh=False, with_texts=False
            ).case
        except InputError:
            found[text] = None
    return found


def remember(cases: Mapping[str, Case | None]) -> None:
    """Keep cases by their texts; the oldest give way."""
    _known.update(cases)
    for text in list(_known)[: max(0, len(_known) - _MOST)]:
        del _known[text]

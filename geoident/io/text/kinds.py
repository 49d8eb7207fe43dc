"""Files of geoident in place of one another: a campaign for a case, a case for a campaign."""

from __future__ import annotations

from geoident.errors import Fault, InputError, Term
from geoident.io.text.faults import Places
from geoident.io.text.yaml_reader import Document

_KINDS = {
    "case": ("a case", f"A case is for {Term.FIT} and most other commands."),
    "campaign": ("a campaign", "A campaign is for `geoident batch`."),
    "project": ("a project of several sections", "A project is for `geoident fit`."),
    "candidates": ("a list of candidates", f"Candidates are for {Term.CANDIDATES}."),
    "cluster": ("a cluster file", f"A cluster file stands after {Term.CLUSTER}."),
}
"""What a format says that a file is, and what to do with one where it is not wanted."""


def refuse_other_kind(document: Document, kind: str) -> None:
    """Refuse a file that says to be one of another kind, before all of its keys are refused.

    Args:
        document: what was read.
        kind: what is expected, as in its format: ``case``, ``campaign``, ``project``,
            ``candidates``, ``cluster``.

    Raises:
        InputError: with one fault, at the format.
    """
    data = document.data
    format_text = data.get("format") if isinstance(data, dict) else None
    if not isinstance(format_text, str) or not format_text.startswith("geoident-"):
        return
    other = format_text.removeprefix("geoident-").partition("/")[0]
    if other == kind or other not in _KINDS:
        return
    kind_text, hint = _KINDS[other]
    location = Places(document, data).locate(("format",))
    message = f"this file is {kind_text}; expected {_KINDS[kind][0]}"
    raise InputError([Fault("other-kind", message, hint, location, "format")])

"""``geoident schema``: what a case file may hold, for editors and for people."""

from __future__ import annotations

from geoident.io.docs.case_schema import case_schema_text, key_page_text


def schema() -> str:
    """The JSON schema of a case file."""
    return case_schema_text()


def key_page() -> str:
    """All keys of a case file, in Markdown."""
    return key_page_text()

"""The JSON schema of case files, generated from the code that validates them.

``python -m geoident.io.schema.document`` prints it, with ``--markdown`` as the page of all keys.
"""

from __future__ import annotations

import json
import sys
from typing import Any

from pydantic.json_schema import GenerateJsonSchema

from geoident.io.case.schema import CaseSection
from geoident.io.case.values import Given
from geoident.io.docs.key_page import key_page, referred

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def case_schema() -> dict[str, Any]:
    """The schema of case files.

    >>> case_schema()["title"]
    'geoident case'
    """
    schema = CaseSection.model_json_schema(schema_generator=_Generator)
    schema |= {"$schema": DIALECT, "title": "geoident case"}
    for section in (schema, *schema["$defs"].values()):
        _describe_keys(section, schema["$defs"])
    return schema


class _Generator(GenerateJsonSchema):
    """Writes defaults as users do, and no titles that only repeat the keys."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False

    def encode_default(self, dft: Any) -> Any:
        if isinstance(dft, Given):
            return dft.text if dft.unit else dft.factor
        return super().encode_default(dft)


def _describe_keys(section: dict[str, Any], sections: dict[str, Any]) -> None:
    """Describe keys that say nothing themselves by what they choose or hold, for hovering."""
    for key in section.get("properties", {}).values():
        found = [sections[name] for name in referred(key)]
        about = section if "const" in key else found[0] if len(found) == 1 else None
        if "description" not in key and about is not None:
            key["description"] = about["description"].partition("\n\n")[0].replace("\n", " ")


def case_schema_text() -> str:
    """The schema as it stands in ``schemas/case.schema.json``."""
    return json.dumps(case_schema(), indent=2, ensure_ascii=False) + "\n"


def key_page_text() -> str:
    """The page of all keys as it stands in ``geoident/docs/keys.md``."""
    return key_page(case_schema())


if __name__ == "__main__":
    sys.stdout.write(key_page_text() if "--markdown" in sys.argv[1:] else case_schema_text())

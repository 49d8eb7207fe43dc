"""The JSON schema of case files, generated from the code that validates them.

``python -m geoident.io.schema`` prints it.
"""

from __future__ import annotations

import json
import sys
from typing import Any

from pydantic.json_schema import GenerateJsonSchema

from geoident.io.case_schema import CaseSection
from geoident.io.case_values import Given

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def case_schema() -> dict[str, Any]:
    """The schema of case files.

    >>> case_schema()["title"]
    'geoident case'
    """
    schema = CaseSection.model_json_schema(schema_generator=_Generator)
    schema |= {"$schema": DIALECT, "title": "geoident case"}
    return schema


class _Generator(GenerateJsonSchema):
    """Writes defaults as users do, and no titles that only repeat the keys."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False

    def encode_default(self, dft: Any) -> Any:
        if isinstance(dft, Given):
            return dft.text if dft.unit else dft.factor
        return super().encode_default(dft)


def case_schema_text() -> str:
    """The schema as it stands in ``schemas/case.schema.json``."""
    return json.dumps(case_schema(), indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    sys.stdout.write(case_schema_text())

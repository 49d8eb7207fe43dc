"""The JSON schema of a file, from the sections that validate it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic.json_schema import GenerateJsonSchema

from geoident.io.schema.section import Section
from geoident.io.schema.values import CaseNumber

Schema = Mapping[str, Any]

REF = "#/$defs/"
_DIALECT = "https://json-schema.org/draft/2020-12/schema"


def schema_of(root: type[Section], title: str) -> dict[str, Any]:
    """The schema of a file whose keys are those of a section.

    Args:
        root: the section of the whole file.
        title: of the schema.
    """
    schema = root.model_json_schema(schema_generator=_Generator)
    schema |= {"$schema": _DIALECT, "title": title}
    sections = schema.setdefault("$defs", {})
    for section in (schema, *sections.values()):
        _describe_keys(section, sections)
    return schema


class _Generator(GenerateJsonSchema):
    """Writes defaults as users do, and no titles that only repeat the keys."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False

    def encode_default(self, dft: Any) -> Any:
        if isinstance(dft, CaseNumber):
            return dft.text if dft.unit or math.isnan(dft.factor) else dft.factor
        return super().encode_default(dft)


def _describe_keys(section: dict[str, Any], sections: dict[str, Any]) -> None:
    """Describe keys that say nothing themselves by what they choose or hold, for hovering."""
    for key in section.get("properties", {}).values():
        referred = [sections[name] for name in referred_sections(key)]
        about = section if "const" in key else referred[0] if len(referred) == 1 else None
        if "description" not in key and about is not None:
            key["description"] = paragraphs(about)[0]


def paragraphs(section: Schema) -> list[str]:
    """The description of a section, one line a paragraph."""
    return [" ".join(p.split()) for p in section.get("description", "").split("\n\n") if p]


def referred_sections(node: object) -> list[str]:
    """Names of the sections that a part of the schema refers to, each once, in order."""
    return list(dict.fromkeys(_references(node)))


def _references(node: object) -> Iterator[str]:
    if isinstance(node, Mapping):
        if "$ref" in node:
            yield str(node["$ref"]).removeprefix(REF)
        for key, value in node.items():
            if key != "$defs":
                yield from _references(value)
    elif isinstance(node, list):
        for value in node:
            yield from _references(value)

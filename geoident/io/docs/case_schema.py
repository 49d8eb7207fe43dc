"""The JSON schema of case files and the page of all their keys, from the code that validates them.

``python -m geoident.io.docs.case_schema`` prints the schema, with ``--markdown`` the page.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

from pydantic.json_schema import GenerateJsonSchema

from geoident.io.case.case import CaseSection
from geoident.io.schema.section import Section
from geoident.io.schema.values import CaseNumber
from geoident.units import DIMENSIONS, units_of

Schema = Mapping[str, Any]

_HEAD = """\
# All keys of a case file

Made from the code that reads cases (`geoident schema --markdown`). Bold keys are required.
A quantity carries its unit (`15 GPa`); where `$parameter` is allowed, a parameter of the case may
take the place of the number, also with a factor (`0.6 $E_rock`).
"""
_UNITS = """\
## Units

Powers and products may also be written `m³`, `m^3`, `kN·m`, `kN m`, and `µ` for `u`. A unit that
stands in several rows takes the dimension that is expected. `tsf` is of short tons; `mH2O` is a
head of water of 1000 kg/m3; `mm/m` of an angle is its tangent.

| dimension | SI | units |
|---|---|---|"""
_REF = "#/$defs/"
_SUFFIX = "Section"
DIALECT = "https://json-schema.org/draft/2020-12/schema"


@cache
def case_schema() -> dict[str, Any]:
    """The schema of case files, made once: not to be changed.

    >>> case_schema()["title"]
    'geoident case'
    """
    return schema_of(CaseSection, "geoident case")


def schema_of(root: type[Section], title: str) -> dict[str, Any]:
    """The schema of a file whose keys are those of a section.

    Args:
        root: the section of the whole file.
        title: of the schema.
    """
    schema = root.model_json_schema(schema_generator=_Generator)
    schema |= {"$schema": DIALECT, "title": title}
    for section in (schema, *schema["$defs"].values()):
        _describe_keys(section, schema["$defs"])
    return schema


class _Generator(GenerateJsonSchema):
    """Writes defaults as users do, and no titles that only repeat the keys."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False

    def encode_default(self, dft: Any) -> Any:
        if isinstance(dft, CaseNumber):
            return dft.text if dft.unit else dft.factor
        return super().encode_default(dft)


def _describe_keys(section: dict[str, Any], sections: dict[str, Any]) -> None:
    """Describe keys that say nothing themselves by what they choose or hold, for hovering."""
    for key in section.get("properties", {}).values():
        found = [sections[name] for name in _referred(key)]
        about = section if "const" in key else found[0] if len(found) == 1 else None
        if "description" not in key and about is not None:
            key["description"] = about["description"].partition("\n\n")[0].replace("\n", " ")


def case_schema_text() -> str:
    """The schema as it is in ``schemas/case.schema.json``."""
    return json.dumps(case_schema(), indent=2, ensure_ascii=False) + "\n"


def key_page_text() -> str:
    """The page of all keys as it is in ``geoident/docs/keys.md``."""
    return "\n".join([key_page(_HEAD, "Case", case_schema()), _units()])


def key_page(head: str, name: str, schema: Schema) -> str:
    """A page of keys: one part for the file, and one for every section in the order of its use.

    Args:
        head: above it.
        name: heading of the first part.
        schema: of the file.
    """
    sections = schema["$defs"]
    parts = [head, _part(name, schema, sections)]
    parts += [_part(title(one), sections[one], sections) for one in _in_order(schema)]
    return "\n".join(parts)


def _units() -> str:
    """The units of each dimension."""
    rows = [
        f"| {dimension} | {f'`{si}`' if si else ''} | {', '.join(f'`{u}`' for u in known if u)} |"
        for dimension, si in DIMENSIONS.items()
        for known in (units_of(dimension),)
    ]
    return "\n".join([_UNITS, *rows, ""])


def _referred(node: object) -> list[str]:
    """Names of the sections that a part of the schema refers to, each once, in order."""
    return list(dict.fromkeys(_references(node)))


def title(name: str) -> str:
    """The heading of a section.

    >>> title("GaussNewtonOptionsSection")
    'Gauss newton options'
    """
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name.removesuffix(_SUFFIX)).capitalize()


def _references(node: object) -> Iterator[str]:
    if isinstance(node, Mapping):
        if "$ref" in node:
            yield str(node["$ref"]).removeprefix(_REF)
        for key, value in node.items():
            if key != "$defs":
                yield from _references(value)
    elif isinstance(node, list):
        for value in node:
            yield from _references(value)


def _in_order(schema: Schema) -> list[str]:
    """Sections as a reader of the case comes upon them, what is inside right after."""
    order: dict[str, None] = {}

    def visit(node: object) -> None:
        for name in _referred(node):
            if name not in order:
                order[name] = None
                visit(schema["$defs"][name])

    visit({key: value for key, value in schema.items() if key != "$defs"})
    return list(order)


def _part(heading: str, section: Schema, sections: Schema) -> str:
    required = (*section.get("required", ()), *section.get("else", {}).get("required", ()))
    rows = [
        f"| {f'**`{name}`**' if name in required else f'`{name}`'} | {_value(key, sections)} "
        f"| {_default(key, required=name in required)} | {_about(key)} |"
        for name, key in section.get("properties", {}).items()
    ]
    table = ["| key | value | default | meaning |", "|---|---|---|---|", *rows] if rows else []
    return "\n".join([f"## {heading}", "", _cell(section.get("description", "")), "", *table, ""])


def _about(key: Schema) -> str:
    generic = key.get("patternErrorMessage", "")  # holds the example of its dimension
    shown = [_yaml(example) for example in key.get("examples", ())]
    examples = ", ".join(f"`{text}`" for text in shown if f"such as {text}" not in generic)
    text = _cell(key.get("description", ""))
    return f"{text} Example: {examples}." if examples else text


def _default(key: Schema, *, required: bool) -> str:
    if required or key.get("default") in (None, "", [], {}):
        return ""
    return f"`{_yaml(key['default'])}`"


def _yaml(value: object) -> str:
    """A value as users write it."""
    if isinstance(value, list):
        return f"[{', '.join(map(_yaml, value))}]"
    return value if isinstance(value, str) else json.dumps(value)


def _value(node: Schema, sections: Schema) -> str:
    """What is allowed there."""
    if "$ref" in node:
        heading = title(str(node["$ref"]).removeprefix(_REF))
        return f"[{heading}](#{heading.lower().replace(' ', '-')})"
    for key in ("anyOf", "oneOf"):
        if key in node:
            words = [_value(n, sections) for n in node[key] if n.get("type") != "null"]
            return " or ".join(dict.fromkeys(words))
    if "const" in node:
        return f"`{node['const']}`"
    if "enum" in node:
        return ", ".join(f"`{_yaml(value)}`" for value in node["enum"])
    return _plain(node, sections)


def _plain(node: Schema, sections: Schema) -> str:
    kind = node.get("type", "")
    if kind == "array":
        return f"list of {_value(node.get('items', {}), sections)}"
    if kind == "object":
        values = node.get("additionalProperties", {})
        return f"names to {_value({} if values is True else values, sections)}"
    if "x-quantity" in node:
        return str(node["x-quantity"])
    words = {"string": "text", "integer": "whole number", "boolean": "`true` or `false`"}
    return words.get(str(kind), str(kind) or "anything")


def _cell(text: str) -> str:
    """Text on one line, as it may stand in a table."""
    return " ".join(text.split()).replace("|", "\\|")


if __name__ == "__main__":
    sys.stdout.write(key_page_text() if "--markdown" in sys.argv[1:] else case_schema_text())

"""The JSON schema in the repository is the one that the code generates."""

import json
import re
from pathlib import Path

import pytest

from geoident.io.schema import case_schema, case_schema_text

FILE = Path(__file__).parents[3] / "schemas" / "case.schema.json"


def test_committed_schema_is_up_to_date():
    remedy = "run: python -m geoident.io.schema > schemas/case.schema.json"
    assert FILE.read_text(encoding="utf-8") == case_schema_text(), remedy


def properties(node):
    if isinstance(node, dict):
        yield from node.get("properties", {}).items()
        for value in node.values():
            yield from properties(value)
    elif isinstance(node, list):
        for value in node:
            yield from properties(value)


def test_every_key_is_described():
    bare = [
        name
        for name, schema in properties(case_schema())
        if "description" not in schema
        and "$ref" not in json.dumps(schema)
        and "const" not in schema
    ]
    assert bare == []


@pytest.mark.parametrize(
    ("text", "fits"),
    [("15 GPa", True), ("0.6 $E_rock", True), ("$E", True), ("15", False), ("15 m", False)],
)
def test_patterns_of_quantities_hold(text, fits):
    schema = case_schema()["$defs"]["IsotropicSection"]["properties"]["E"]["anyOf"][0]
    assert bool(re.search(schema["pattern"], text)) is fits

"""The JSON schema in the repository is the one that the code generates."""

import re
from functools import cache
from pathlib import Path
from typing import ClassVar

import jsonschema
import pytest
import yaml

from geoident.io.docs import case_schema as made
from geoident.io.docs.case_schema import case_schema_text
from geoident.io.docs.key_page import title

ROOT = Path(__file__).parents[3]
FILE = ROOT / "schemas" / "case.schema.json"
PAGE = ROOT / "geoident" / "docs" / "keys.md"
CAVERN = ROOT / "cases" / "cavern" / "case.yaml"
SHIPPED = sorted(
    [*(ROOT / "geoident" / "templates").glob("*/case.yaml"), *(ROOT / "cases").glob("*/case.yaml")],
    key=lambda case: case.parts[-3:],
)

case_schema, key_page_text = made.case_schema, cache(made.key_page_text)


def test_committed_schema_is_up_to_date():
    remedy = "run: python -m geoident.io.docs.case_schema > schemas/case.schema.json"
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
    bare = [name for name, schema in properties(case_schema()) if not schema.get("description")]
    assert bare == []


@pytest.mark.parametrize(
    ("text", "fits"),
    [("15 GPa", True), ("0.6 $E_rock", True), ("$E", True), ("15", False), ("15 m", False)],
)
def test_patterns_of_quantities_hold(text, fits):
    schema = case_schema()["$defs"]["IsotropicSection"]["properties"]["E"]["anyOf"][0]["oneOf"][0]
    assert bool(re.search(schema["pattern"], text)) is fits


def test_committed_page_of_keys_is_up_to_date():
    remedy = "run: python -m geoident.io.docs.case_schema --markdown > geoident/docs/keys.md"
    assert PAGE.read_text(encoding="utf-8") == key_page_text(), remedy


def test_page_of_keys_has_every_key_under_its_section():
    parts = {part.splitlines()[0]: part for part in key_page_text().split("\n## ")[1:]}
    schema = case_schema()
    for name, section in schema["$defs"].items():
        text = parts[title(name)]
        while further := re.search(r"Further keys under \[([^\]]*)\]", text):
            text = text.replace(further[0], parts[further[1]])
        for key in section.get("properties", {}):
            assert f"`{key}`" in text, (name, key)
    assert set(re.findall(r"^- \**`(\w+)`", parts["Case"], re.M)) == set(schema["properties"])


def test_page_of_keys_links_to_parts_that_are_there():
    page = key_page_text()
    anchors = {
        h.lower().replace(":", "").replace(" ", "-")
        for h in re.findall(r"^## (.*)", page, re.MULTILINE)
    }
    links = set(re.findall(r"\]\(#([^)]*)\)", page))
    assert links
    assert links <= anchors


class Yaml12(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
    """As editors read YAML: only true and false are flags, 'on' and dates are texts."""

    yaml_implicit_resolvers: ClassVar = {
        first: [
            (tag, pattern)
            for tag, pattern in rules
            if "timestamp" not in tag and (first in "tTfF" or "bool" not in tag)
        ]
        for first, rules in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }


@pytest.mark.parametrize("case", SHIPPED, ids=lambda case: case.parent.name)
def test_editors_find_no_fault_in_shipped_cases(case):
    data = yaml.load(case.read_text(encoding="utf-8"), Loader=Yaml12)
    validator = jsonschema.Draft202012Validator(case_schema())
    assert [error.message for error in validator.iter_errors(data)] == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("E: $E_rock", "E: 15"),
        ("E: $E_rock", "E: 15 m"),
        ("accuracy: 0.1 mm", "accuracy: 0.1"),
        ("excavate: [drift, lining-drift]", "excavate: drift"),
        ("kind: extensometer", "kind: extensometre"),
        ("supports:", "support:"),
        ("bounds: [0.3, 3.0]", "bounds: [0.3]"),
    ],
)
def test_editors_find_faults(old, new):
    text = CAVERN.read_text(encoding="utf-8")
    assert old in text
    validator = jsonschema.Draft202012Validator(case_schema())
    assert list(validator.iter_errors(yaml.safe_load(text.replace(old, new, 1))))


def quantities(node):
    if isinstance(node, dict):
        if "x-quantity" in node:
            yield node
        for value in node.values():
            yield from quantities(value)
    elif isinstance(node, list):
        for value in node:
            yield from quantities(value)


def test_quantities_say_in_words_what_is_expected_and_show_an_example_that_fits():
    found = list(quantities(case_schema()))
    assert len(found) > 20
    for schema in found:
        assert "is expected, such as" in schema["patternErrorMessage"]
        for example in schema["examples"]:
            number = not isinstance(example, str) and "number" in schema["type"]
            fits = number or re.search(schema["pattern"], example)
            assert fits or isinstance(example, list), schema


@pytest.mark.slow  # pydantic makes it, and all shipped cases are validated by it
def test_the_schema_is_one():
    jsonschema.Draft202012Validator.check_schema(case_schema())

"""The schema and the page of keys of projects are those that the code generates."""

import jsonschema
import pytest
import yaml
from support.projects import EXAMPLE, SECTIONS

from geoident.io.docs.project_schema import (
    project_key_page_text,
    project_schema,
    project_schema_text,
)
from tests.io.docs.test_case_schema import ROOT, properties

MODULE = "python -m geoident.io.docs.project_schema"


def test_committed_files_are_up_to_date():
    file, page = ROOT / "schemas/project.schema.json", ROOT / "geoident/docs/project_keys.md"
    assert file.read_text(encoding="utf-8") == project_schema_text(), f"run: {MODULE} > {file}"
    text = page.read_text(encoding="utf-8")
    assert text == project_key_page_text(), "run: sh tests/manual/renew keys"


def test_every_key_is_described():
    assert not [n for n, schema in properties(project_schema()) if not schema.get("description")]


@pytest.mark.parametrize(
    ("old", "new", "fits"),
    [
        ("", "", True),
        ("scatter: none", "scatter: 30 %", True),
        ("scatter: none", "scatter: some", False),
        ("shared: [K0]", "shared: K0", False),
        ("predict: true", "predict: maybe", False),
        ("formula: a", "formulae: a", False),
    ],
)
def test_the_schema_judges_as_the_code_does(old, new, fits):
    project = yaml.safe_load(SECTIONS.replace(old, new, 1))
    assert jsonschema.Draft202012Validator(project_schema()).is_valid(project) is fits


def test_the_shipped_project_fits():
    project = yaml.safe_load((EXAMPLE / "project.yaml").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator(project_schema()).validate(project)

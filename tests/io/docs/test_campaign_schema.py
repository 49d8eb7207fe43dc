"""The schema and the page of keys of campaigns are those that the code generates."""

import jsonschema
import pytest
import yaml

from geoident.io.docs.campaign_schema import (
    campaign_key_page_text,
    campaign_schema,
    campaign_schema_text,
)
from tests.io.docs.test_case_schema import ROOT, properties

MODULE = "python -m geoident.io.docs.campaign_schema"


def test_committed_files_are_up_to_date():
    file, page = ROOT / "schemas/campaign.schema.json", ROOT / "geoident/docs/campaign_keys.md"
    assert file.read_text(encoding="utf-8") == campaign_schema_text(), f"run: {MODULE} > {file}"
    text = page.read_text(encoding="utf-8")
    assert text == campaign_key_page_text(), "run: sh tests/manual/renew keys"


def test_every_key_is_described():
    assert not [n for n, schema in properties(campaign_schema()) if not schema.get("description")]


@pytest.mark.parametrize(
    ("text", "fits"),
    [
        ("variations: {table: runs.csv}", True),
        ("variations: {product: {in_situ.K0: [1, 2]}}", True),
        ("variations: {sample: {count: 3, values: {a.b: {from: 1 m, to: 2 m}}}}", True),
        ("variations: {sample: {values: {a.b: {from: 1 m, to: 2 m}}}}", False),
        ("variations: {tabel: runs.csv}", False),
        ("retries: -1\nvariations: {table: runs.csv}", False),
    ],
)
def test_the_schema_judges_as_the_code_does(text, fits):
    campaign = yaml.safe_load(f"format: geoident-campaign/1\ncase: case.yaml\n{text}")
    assert jsonschema.Draft202012Validator(campaign_schema()).is_valid(campaign) is fits

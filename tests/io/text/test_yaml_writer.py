"""Texts of cases: what PyYAML would write, to the last character."""

from pathlib import Path

import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

import geoident
from geoident.io.text import yaml_writer
from geoident.io.text.yaml_reader import parse_yaml
from geoident.io.text.yaml_writer import yaml_text

ROOT = Path(geoident.__file__).parents[1]

NASTY = st.sampled_from(
    ["", " ", "~", "null", "NULL", "nullable", "- a", "-", "-2.5 m", "--- a", "...", "? a", ": b",
     "a: b", "a:", "a #b", "#a", "$E", "[a]", "{a", "*a", "&a", "!a", "%a", "@a", "`a", "'a'",
     '"a"',
     "it's", "a\nb", "a\n", "\ta", "a ", " a", "a  b", "25 µm", "é", "\x07", "1e9", "yes", "x" * 99,
     "word " * 30, "a, b", "a/b.c", "10 %", "2*(a-b)^2", "a\u2028b", "\ufeffa", "\U0001f600"]
)  # fmt: skip
TEXTS = NASTY | st.text(max_size=12)
KEYS = st.sampled_from(["E", "a b", "is: odd", "null", "#", "x" * 60]) | st.text(
    min_size=1, max_size=8
)
NODES = st.recursive(
    TEXTS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(KEYS, inner, max_size=4),
    max_leaves=20,
)


@settings(max_examples=50, deadline=None)
@given(NODES)
@example({"a": [["x", ["y"]], [], {}, {"b": {"c": []}}]})
def test_any_tree_is_written_as_pyyaml_writes_it(node):
    try:
        expected = yaml.dump(
            node, Dumper=yaml_writer._Dumper, sort_keys=False, allow_unicode=True, width=100
        )
    except UnicodeEncodeError:  # half of a pair
        return
    if isinstance(node, str):  # a document of one text ends otherwise; a case is no such one
        return
    assert yaml_text(node) == expected


@pytest.mark.parametrize("case", ["cavern", "dam", "braced-pit", "shaft", "tunnel-3d"])
def test_a_case_is_read_as_it_was_written(case):
    found = parse_yaml((ROOT / "cases" / case / "case.yaml").read_text(), "case.yaml").data
    text = yaml_text(found)
    assert parse_yaml(text, "case.yaml").data == found

"""YAML with its traps closed."""

import pytest

from geoident.errors import InputError
from geoident.io.text import yaml_reader
from geoident.io.text.text_file import decode
from geoident.io.text.yaml_reader import parse_yaml


def parse(content, file):
    return parse_yaml(decode(content, file), file)


def refused(content):
    with pytest.raises(InputError) as caught:
        parse(content if isinstance(content, bytes) else content.encode(), "case.yaml")
    return caught.value.faults


def test_scalars_stay_as_written():
    text = "{a: 1e9, b: no, c: 012, d: 1:30, e: '', f: , g: ~, h: 2026-01-01, i: 'null'}"
    assert parse(text.encode(), "x").data == {
        "a": "1e9",
        "b": "no",
        "c": "012",
        "d": "1:30",
        "e": "",
        "f": None,
        "g": None,
        "h": "2026-01-01",
        "i": "null",
    }


def test_positions_of_keys_and_values_count_from_one():
    document = parse(b"a:\n  b: [x, yy]\n", "x")
    assert document.keys[("a", "b")] == (2, 3)
    assert document.values[("a", "b", 1)] == (2, 10)


def test_byte_order_mark_and_windows_lines_are_fine():
    document = parse("\ufeffa: ä\r\nb: 2\r\n".encode(), "x")
    assert document.data == {"a": "ä", "b": "2"}
    assert document.keys[("b",)] == (2, 1)


@pytest.mark.parametrize(
    ("content", "code", "place"),
    [
        ("", "empty", (0, 0)),
        ("# nothing\n", "empty", (0, 0)),
        ("a: 1\nb: 2\na: 3\n", "duplicate-key", (3, 1)),
        ("a: &x 1\nb: 2\n", "alias", (1, 4)),
        ("a: 1\n---\nb: 2\n", "several-documents", (2, 1)),
        ("a: !!python/object:os.system x\n", "tag", (1, 4)),
        ("? [a]\n: 1\n", "bad-key", (1, 3)),
        ("a: 1\n\tb: 2\n", "yaml-syntax", None),
        ("a: [1, 2\n", "yaml-syntax", None),
        ("a: b: c\n", "yaml-syntax", (1, 5)),
        (b"a: 1\nb: \xe9\n", "not-text", (2, 4)),
        (b"a: \x00\n", "not-text", (1, 4)),
        (b"\xff\xfea\x00", "not-text", (1, 1)),
        (b"\x89PNG\r\n\x1a\n", "not-text", (1, 1)),
        ("[" * 200_000, "too-deep", None),
        ("{a: " * 200_000, "too-deep", None),
    ],
)
def test_traps_are_refused_where_they_stand(content, code, place):
    faults = refused(content)
    assert faults[0].code == code, faults
    if place:
        assert (faults[0].location.line, faults[0].location.column) == place


def test_a_file_of_too_many_points_says_what_to_do(monkeypatch):
    monkeypatch.setattr(yaml_reader, "_MAX_NODES", 1000)
    points = "\n".join(f"  P{k}: [{k} m, 0 m]" for k in range(400))
    (fault,) = refused(f"points:\n{points}\n")
    assert fault.message == "the file is too large for a case"
    assert "Take a part of the points" in fault.hint


def test_a_tab_is_named():
    assert "not tabs" in refused("a:\n\t- b\n")[0].hint


@pytest.mark.parametrize(
    ("above", "below"),
    [
        ("parameters: {}", "E: 1"),
        ("supports: FILL_IN", "left: x"),
        ("supports: FILL_IN # a word", "# a remark\n  left: x"),
        ("stages: FILL_IN", "- {name: a}"),
    ],
)
def test_a_value_that_was_left_above_the_lines_that_replace_it_is_named(above, below):
    hint = refused(f"a: 1\n{above}\n  {below}\n")[0].hint
    name, value = above.split()[:2]
    assert hint.startswith(f"Delete '{value}' after '{name}'")


def test_alias_bombs_are_refused():
    lines = ["a0: &a0 [x, x]"] + [f"a{n}: &a{n} [*a{n - 1}, *a{n - 1}]" for n in range(1, 60)]
    assert {fault.code for fault in refused("\n".join(lines))} == {"alias"}  # or never


def test_duplicate_keys_are_all_found():
    assert [fault.location.line for fault in refused("a: 1\na: 1\nb: 1\nb: 1\n")] == [2, 4]


@pytest.mark.parametrize(
    ("text", "remedy"),
    [
        ("a: 1\nreadings:\n  date_format: %d.%m.%Y\n", "Write 'date_format: DD.MM.YYYY'."),
        ("readings: {date_format: %d/%m/%Y %H:%M}", "Write 'date_format: DD/MM/YYYY hh:mm'."),
        ("title: @home\n", 'Quote it: title: "@home".'),
        ("title: %5 sure # text\n", 'Quote it: title: "%5 sure".'),
    ],
)
def test_a_text_that_begins_with_a_sign_of_yaml_has_its_remedy(text, remedy):
    (fault,) = refused(text)
    assert (fault.code, fault.hint) == ("yaml-syntax", remedy)

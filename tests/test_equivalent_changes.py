"""Changes that mean the same (`mutation/equivalent.toml`): each is of one place in the code."""

from pathlib import Path

import pytest
from mutation.equivalent import Place, Same, listed

import geoident

PACKAGE = Path(geoident.__file__).parent
SOURCE = """\
while a:
    if b:
        break

    x = f(a,
          b)
    if c:
        break
"""


def change(was, beside=""):
    return Same("a.py", was, "continue", "none", beside)


@pytest.mark.parametrize(
    ("was", "beside", "lines"),
    [
        ("break", "", [3, 8]),
        ("break", "if c:", [8]),
        ("break", "x = f(a,", [3]),
        ("x = f(a, b)", "", [5]),
        ("x = f( a, b)", "break", [5]),
        ("x = f(a,", "", [5]),
        ("x = f(a, c)", "", []),
        ("break", "if d:", []),
        ("", "", []),
    ],
)
def test_places_of_a_change(was, beside, lines):
    assert change(was, beside).places(SOURCE) == lines


def test_a_change_is_known_where_it_was_read():
    place = Place("  break", ("if c:", ""))
    assert change("break", "if c:").is_of("a.py", place, " continue")
    assert not change("break", "if b:").is_of("a.py", place, "continue")
    assert not change("break").is_of("b.py", place, "continue")
    assert not change("break").is_of("a.py", place, "return")
    assert Same("a.py", "break", "*", "none").is_of("a.py", place, "return")


def test_every_change_that_is_known_stands_at_one_place():
    found = {one: one.places((PACKAGE / one.file).read_text(encoding="utf-8")) for one in listed()}
    assert len(found) > 50
    assert {one: places for one, places in found.items() if len(places) != 1} == {}


def test_no_change_is_listed_twice():
    kinds = [(one.file, one.was, one.became, one.beside) for one in listed()]
    assert len(kinds) == len(set(kinds))

"""A name means one thing: no class or alias of the package stands for two."""

import re
from collections import defaultdict
from functools import cache
from pathlib import Path

import geoident

PACKAGE = Path(geoident.__file__).parent
TYPE = re.compile(r"_?[A-Z][A-Za-z0-9]*[a-z][A-Za-z0-9]*$")
TOP = re.compile(
    r"^(?:class (?P<of_class>\w+)"
    r"|(?P<alias>\w+): (?:\w+\.)?TypeAlias\b"
    r"|(?P<given>\w+) = (?!None\b|True\b|False\b|lambda\b)[A-Za-z_(])",
    re.MULTILINE,
)
"""Statements at the left margin; to parse the whole package takes seconds."""


def types_of(source):
    """Names of the classes and of the aliases of types at the top of a module."""
    for found in TOP.finditer(source):
        if found["given"] is None:
            yield found["of_class"] or found["alias"]
        elif TYPE.match(found["given"]):
            yield found["given"]


@cache
def homes():
    """Name to the modules in which it is defined."""
    found = defaultdict(list)
    for path in sorted(PACKAGE.rglob("*.py")):
        for name in types_of(path.read_text(encoding="utf-8")):
            found[name].append(path.relative_to(PACKAGE).as_posix())
    return found


def test_types_are_seen():
    source = (
        "class A: ...\nBs = dict[str, int]\nC: TypeAlias = int\nD_E = int\nf = g()\n_Gg = list[A]"
    )
    assert list(types_of(source)) == ["A", "Bs", "C", "_Gg"]
    assert len(homes()) > 200


def test_no_public_type_is_defined_in_two_modules():
    assert {n: m for n, m in homes().items() if len(m) > 1 and not n.startswith("_")} == {}


def test_no_private_type_is_defined_in_three_modules():
    assert {n: m for n, m in homes().items() if len(m) > 2} == {}

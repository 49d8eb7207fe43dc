"""A name means one thing: no class or alias of the package stands for two."""

import ast
import re
from collections import defaultdict
from functools import cache
from pathlib import Path

import geoident

PACKAGE = Path(geoident.__file__).parent
TYPE = re.compile(r"_?[A-Z][A-Za-z0-9]*[a-z][A-Za-z0-9]*$")
ALIASED = (ast.Name, ast.Attribute, ast.Subscript, ast.BinOp, ast.Call)


def types_of(source):
    """Names of the classes and of the aliases of types at the top of a module."""
    for statement in ast.parse(source).body:
        if isinstance(statement, ast.ClassDef):
            yield statement.name
        elif isinstance(statement, ast.Assign) and isinstance(statement.value, ALIASED):
            for target in statement.targets:
                if isinstance(target, ast.Name) and TYPE.match(target.id):
                    yield target.id
        elif isinstance(statement, ast.AnnAssign) and "TypeAlias" in ast.dump(statement.annotation):
            yield ast.unparse(statement.target)


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

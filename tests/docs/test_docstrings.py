"""Docstrings say what a reader needs: shapes of arrays, arguments, errors.

Held for every public function, method and class constructor of the package (constructors are
described by their class, dataclasses by their fields): one that takes or returns arrays says their
shapes, in `Args` that of every array, and one that raises has `Raises`. Exempt are

    commands      their docstring is the help on the screen, where options have help of their own
    operators     of numbers that carry derivatives, and what else Python calls by a special name
    overriding    methods with the arguments of a method of the same name that says all, in a base
                  class or a protocol of the package
"""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

import geoident

PACKAGE = Path(geoident.__file__).parent

ARRAYS = re.compile(
    r"\b(Floats|Ints|Bools|Integers|NDArray|ndarray|csr_array|csc_array|coo_array|Index)\b"
)
TERM = r"(?:\.{2,3}|[A-Za-z_][\w']*|\d+)(?:(?: ?[-+*/^] ?| )[\w']+)*"
SHAPE = re.compile(rf"\((?:{TERM},|{TERM}(?:, {TERM})+|\.\.\.)\)")


@dataclass(frozen=True)
class Routine:
    """A public function, method or constructor with the docstring that describes it."""

    place: str
    name: str
    arguments: tuple[str, ...]
    arrays: tuple[str, ...]
    annotations: str
    raises: tuple[str, ...]
    doc: str
    command: bool

    @property
    def missing(self):
        """What the docstring lacks: shapes, Raises."""
        wanted = {
            "shapes": ARRAYS.search(self.annotations) and not self._says_shapes,
            "Raises": self.raises and "Raises:" not in self.doc,
        }
        return {what for what, lacks in wanted.items() if lacks}

    @property
    def _says_shapes(self):
        """A shape anywhere, and with every argument that is an array where `Args` are given."""
        _, _, given = self.doc.partition("Args:\n")
        entries = [re.search(rf"^    {a}: .*(?:\n {{8}}.*)*", given, re.M) for a in self.arrays]
        bare = [entry for entry in entries if entry and not SHAPE.search(entry[0])]
        return SHAPE.search(self.doc) and not bare


def routines(path):
    """All of a module."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return list(_routines(tree, str(path.relative_to(PACKAGE)), None))


def _routines(body, place, owner):
    for node in body.body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from _routines(node, place, node)
            yield from _dataclass(node, place)
        elif isinstance(node, ast.FunctionDef) and _public(node.name, owner):
            yield _routine(node, place, owner)


def _dataclass(node, place):
    """The constructor that a dataclass has without writing it."""
    if any("dataclass" in ast.unparse(d) for d in node.decorator_list):
        written = [f.annotation for f in node.body if isinstance(f, ast.AnnAssign)]
        yield Routine(
            place=f"{place}:{node.lineno} {node.name}",
            name=node.name,
            arguments=(),
            arrays=(),
            annotations=" ".join(ast.unparse(a) for a in written),
            raises=(),
            doc=ast.get_docstring(node) or "",
            command=False,
        )


def _public(name, owner):
    return not name.startswith("_") or (name in ("__init__", "__call__") and owner is not None)


def _routine(node, place, owner):
    arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    arguments = [a for a in arguments if a.arg not in ("self", "cls")]
    written = [a.annotation for a in arguments] + [node.returns]
    described = owner if node.name == "__init__" else node
    prefix = f"{owner.name}." if owner else ""
    return Routine(
        place=f"{place}:{node.lineno} {prefix}{node.name}",
        name=node.name,
        arguments=tuple(a.arg for a in arguments),
        arrays=tuple(a.arg for a in arguments if a.annotation and _is_array(a.annotation)),
        annotations=" ".join(ast.unparse(a) for a in written if a is not None),
        raises=tuple(_own_raises(node, frozenset())),
        doc=ast.get_docstring(described) or "",
        command=any(_of_command(d) for d in node.decorator_list),
    )


def _is_array(annotation):
    return re.match(rf"{ARRAYS.pattern}(?: \| None)?$", ast.unparse(annotation)) is not None


def _own_raises(node, caught):
    """Names of what is raised here, not what is caught and raised again."""
    below = [*getattr(node, "body", ()), *getattr(node, "handlers", ())]
    below += [*getattr(node, "orelse", ()), *getattr(node, "finalbody", ())]
    for child in (*below, *getattr(node, "cases", ())):
        if isinstance(child, ast.FunctionDef | ast.ClassDef):  # none is in those
            continue
        if isinstance(child, ast.Raise) and child.exc is not None:
            raised = child.exc.func if isinstance(child.exc, ast.Call) else child.exc
            name = ast.unparse(raised)
            if name not in caught and name != "AssertionError":
                yield name
        own = {child.name} if isinstance(child, ast.ExceptHandler) and child.name else set()
        yield from _own_raises(child, caught | own)


def _of_command(decorator):
    name = ast.unparse(decorator)
    return name.startswith(("click.", "options.", "takes", "job_options"))


@cache
def everything():
    """All routines of the package."""
    return [r for path in sorted(PACKAGE.rglob("*.py")) for r in routines(path)]


@cache
def told_elsewhere():
    """Name and arguments of the methods that say all: what overrides them need not."""
    return {
        (r.name, r.arguments)
        for r in everything()
        if "." in r.place.split()[1] and r.arguments and r.name != "__init__" and not r.missing
    }


def lacking(r):
    """What a routine has to say and does not."""
    if r.command or (r.name, r.arguments) in told_elsewhere():
        return set()
    return r.missing


@pytest.mark.parametrize("what", ["shapes", "Raises"])
def test_docstrings_say(what):
    assert [r.place for r in everything() if what in lacking(r)] == []


@pytest.mark.parametrize(
    ("source", "missing"),
    [
        ('def f(x: Floats) -> float:\n    """Of x."""', {"shapes"}),
        ('def f(x: Floats) -> float:\n    """Of x (n,)."""', set()),
        ('def f(x: Floats) -> Floats:\n    """Of x (n_dofs, 1 + n + k)."""', set()),
        ('def f(x: Floats) -> float:\n    """Of a number (or an array)."""', {"shapes"}),
        ('def f(a: int) -> int:\n    """Half."""\n    raise ValueError("odd")', {"Raises"}),
        ('def f() -> None:\n    """Of it."""\n    try:\n        g()\n    except E as e:\n'
         "        raise e", set()),
        ('def _f(a: Floats, b: Floats, c: Floats) -> None:\n    """Private."""', None),
        ('def f(x: Floats, y: Floats) -> None:\n    """Of it.\n\n    Args:\n        x: (n,).\n'
         '        y: the same.\n    """', {"shapes"}),
        ('@dataclass\nclass A:\n    """Of x."""\n\n    x: Floats', {"shapes"}),
        ('@dataclass\nclass A:\n    """Of x (n,)."""\n\n    x: Floats', set()),
        ('class A:\n    """Of x."""\n\n    def __init__(self, x: Floats) -> None: ...', {"shapes"}),
    ],
)  # fmt: skip
def test_what_a_docstring_lacks(source, missing):
    found = list(_routines(ast.parse(source), "module.py", None))
    assert [r.missing for r in found] == ([] if missing is None else [missing])

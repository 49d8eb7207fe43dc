"""The tests that can see a change: those that reach its lines, near and quick ones first."""

from __future__ import annotations

import ast
import json
import re
from dataclasses import dataclass
from pathlib import Path

from coverage import CoverageData
from reached import DATA, SECONDS

QUICK = 1.0
"""Seconds up to which a test of the same room goes before those of others."""


class Selection:
    """Tests by the lines that they reach.

    Args:
        folder: where the plugin `reached` has left its files.
        tree: root of the tree in which the tests ran.
    """

    def __init__(self, folder: Path, tree: Path) -> None:
        self.seconds: dict[str, float] = json.loads((folder / SECONDS).read_text())
        self._tree = tree
        self._data = CoverageData(str(folder / DATA))
        self._data.read()
        self._sources: dict[str, _Source] = {}

    def tests(self, module: str, line: int) -> list[str]:
        """The tests that reach a line of a module, those of its room first, then the quick ones.

        What runs when the module is imported (constants, heads of functions and classes) runs in
        whatever test imports it first. It is seen by the tests that reach the functions where its
        name stands, or else by those that reach any function of the module.
        """
        found = self._reaching(module, line)
        if not found:
            name = _name(self._source(module).tree, line)
            found = self._naming(name) if name else set()
        if not found:
            found = set().union(*self._source(module).tests.values())
        near = (f"{module}::", module.replace("geoident/", "tests/", 1).rpartition("/")[0] + "/")

        def order(test: str) -> tuple[bool, float, str]:
            quick = test.startswith(near) and self.seconds[test] < QUICK
            return not quick, self.seconds[test], test

        return sorted(found, key=order)

    def _source(self, module: str) -> _Source:
        if module not in self._sources:
            path = (self._tree / module).resolve()
            text = path.read_text()
            tree = ast.parse(text)
            called = _called(tree)
            tests = {
                line: {name for name in names if name in self.seconds}
                for line, names in self._data.contexts_by_lineno(str(path)).items()
                if line in called
            }
            self._sources[module] = _Source(text.splitlines(), tree, called, tests)
        return self._sources[module]

    def _reaching(self, module: str, line: int) -> set[str]:
        """Tests that reach the statement of a line inside a function, or the head of a long one."""
        source = self._source(module)
        if line not in source.called:
            return set()
        if source.tests.get(line):
            return source.tests[line]
        first, last = _statement(source.tree, line)
        return set().union(*(source.tests.get(number, ()) for number in range(first, last + 1)))

    def _naming(self, name: str) -> set[str]:
        """Tests that reach a line inside a function where a name stands."""
        word = re.compile(rf"\b{name}\b")
        found: set[str] = set()
        for path in sorted((self._tree / "geoident").rglob("*.py")):
            if word.search(path.read_text()):
                module = str(path.relative_to(self._tree))
                for number, text in enumerate(self._source(module).lines, 1):
                    if word.search(text):
                        found |= self._reaching(module, number)
        return found


@dataclass(frozen=True)
class _Source:
    """A module: its lines, its tree, the lines inside functions and the tests that reach those."""

    lines: list[str]
    tree: ast.Module
    called: set[int]
    tests: dict[int, set[str]]


def _called(tree: ast.Module) -> set[int]:
    """Lines inside functions: they run when the function is called."""
    return {
        line
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
        for line in range(node.body[0].lineno, (node.end_lineno or node.lineno) + 1)
    }


def _name(tree: ast.Module, line: int) -> str:
    """The constant, function or class that a line outside functions makes; empty for none."""
    found = ""
    for node in ast.walk(tree):
        decorators = getattr(node, "decorator_list", [])
        first = min([getattr(node, "lineno", 0), *(one.lineno for one in decorators)])
        if not first <= line <= (getattr(node, "end_lineno", None) or 0):
            continue
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found = node.name
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            found = node.targets[0].id
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            found = node.target.id
    return found


def _statement(tree: ast.Module, line: int) -> tuple[int, int]:
    """First and last line of the innermost statement around a line; of a compound one, its head."""
    first, last = line, line
    body: list[ast.stmt] = list(tree.body)
    while around := [one for one in body if one.lineno <= line <= (one.end_lineno or one.lineno)]:
        statement = around[0]
        first, last = statement.lineno, statement.end_lineno or statement.lineno
        body = [one for part in ast.iter_child_nodes(statement) for one in _statements(part)]
        later = [one.lineno for one in body if one.lineno > line]
        if later and not any(one.lineno <= line for one in body):
            last = min(later) - 1
    return first, last


def _statements(node: ast.AST) -> list[ast.stmt]:
    """A statement itself, or those inside a handler or a case."""
    if isinstance(node, ast.stmt):
        return [node]
    return [one for one in ast.iter_child_nodes(node) if isinstance(one, ast.stmt)]

"""Where the code can be changed, and a sample of the changes with a fixed seed.

A *site* is one place and one kind of change: an operator, a comparison, a number, a truth value, a
`not`, a loop. Every site has the same chance to be drawn, and one of its changes is then drawn; so
a plus sign, which can become many things, does not count more than a number.

The changes are those of cosmic-ray, less those that cannot tell anything:

* operators of bits for those of numbers, and the other way round, `is` for `==`: they end in a
  `TypeError` wherever the line is run; `<` for `==` between texts, which have no order here;
* annotations, stars of signatures, `if TYPE_CHECKING`, protocols: never run, or without effect;
* `frozen`, `slots`, `eq` of data classes, `strict` of `zip`, `abstractmethod`, caches, their sizes:
  promises to the reader and savings, without which every result is the same.

To them come numbers that are scaled (`Scaled`): 1.96 to 1.568, 3.0 to 30.0.
"""

from __future__ import annotations

import ast
import random
import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import parso
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.ast.ast_query import ASTQuery
from cosmic_ray.operators.operator import Operator
from cosmic_ray.plugins import get_operator, operator_names

ARITHMETIC = {"Add", "Sub", "Mul", "Div", "FloorDiv", "Mod", "Pow"}
BITS = {"BitOr", "BitAnd", "BitXor"}
UNSEEN = {"cache", "lru_cache", "cached_property", "abstractmethod"}
PROMISES = {"frozen", "slots", "eq", "order", "kw_only", "strict", "maxsize"}
SCALED = "Scaled"
Position = tuple[int, int]
_OPPOSITE = ("_Eq_NotEq", "_NotEq_Eq", "_Is_IsNot", "_IsNot_Is")
_WIDE = 200
"""Columns that no line has."""


class Scaled(Operator):
    """Scales fractions and thresholds by 0.8 and 10; tolerances and large numbers stay."""

    factors = (0.8, 10.0)

    def mutation_positions(self, node: Any) -> Iterator[tuple[Any, Any]]:
        """Two changes of every number with a point between 0.01 and 1000."""
        number = isinstance(node, parso.python.tree.Number) and re.fullmatch(
            r"\d+\.\d*", node.value
        )
        if number and 0.01 <= float(node.value) <= 1e3:
            for _ in self.factors:
                yield node.start_pos, node.end_pos

    def mutate(self, node: Any, index: int) -> Any:
        """The number times the factor."""
        value = float(node.value) * self.factors[index]
        return parso.python.tree.Number(f"{value!r}", node.start_pos, prefix=node.prefix)

    @classmethod
    def examples(cls) -> tuple[()]:
        """None: cosmic-ray asks for them in its own tests only."""
        return ()


@dataclass(frozen=True)
class Mutant:
    """One change of one file.

    Attributes:
        module: path of the file from the root of the repository.
        operator: name of cosmic-ray's operator, or `SCALED`.
        occurrence: which of the changes that the operator can make in the file.
        line: where it starts, from 1.
        definition: the function or class around it.
    """

    module: str
    operator: str
    occurrence: int
    line: int
    definition: str

    def make(self) -> Operator:
        """The operator that makes it."""
        return Scaled() if self.operator == SCALED else get_operator(self.operator)()


def draw(root: Path, modules: list[str], count: int, seed: int) -> tuple[list[Mutant], int]:
    """`count` mutants of some modules, no two at one site, and the number of all sites."""
    chance = random.Random(seed)
    sites = [changes for module in modules for changes in _sites(root, module)]
    drawn = chance.sample(sites, min(count, len(sites)))
    return [chance.choice(changes) for changes in drawn], len(sites)


def _sites(root: Path, module: str) -> list[list[Mutant]]:
    """The changes of every site of a file."""
    source = (root / module).read_text()
    seen = _Silent()
    seen.visit(ast.parse(source))
    found: dict[tuple[Any, str], list[Mutant]] = defaultdict(list)
    nodes = list(ast_nodes(get_ast(source)))
    for name in [*sorted(operator_names()), SCALED]:
        kind = _kind(name)
        if kind is None:
            continue
        operator = Scaled() if name == SCALED else get_operator(name)()
        positions = (
            (node, start) for node in nodes for start, _ in operator.mutation_positions(node)
        )
        for occurrence, (node, start) in enumerate(positions):
            if start in seen.positions or (kind == "RemoveDecorator" and _unseen(node)):
                continue
            if kind == "comparison" and start in seen.texts and not name.endswith(_OPPOSITE):
                continue
            where = ASTQuery(node).get_definition_name() or ""
            found[start, kind].append(Mutant(module, name, occurrence, start[0], where))
    return [found[key] for key in sorted(found)]


def _kind(operator: str) -> str | None:
    """What sort of site an operator changes; None for one that is left out."""
    name = operator.removeprefix("core/")
    if name in {SCALED, "NumberReplacer"}:
        return "number"
    if name.startswith("ReplaceBinaryOperator_"):
        old, new = name.split("_")[1:]
        sensible = {old, new} <= ARITHMETIC or {old, new} <= BITS
        return "binary" if sensible else None
    if name.startswith("ReplaceComparisonOperator_"):
        old, new = name.split("_")[1:]
        return "comparison" if ("Is" in old) == ("Is" in new) else None
    if name.startswith("ReplaceUnaryOperator_"):
        return "unary" if name.split("_")[1] == "Delete" else None
    return None if name in {"VariableReplacer", "VariableInserter", "NoOp"} else name


def _unseen(node: Any) -> bool:
    return bool(set(re.findall(r"\w+", node.get_code())) & UNSEEN)


class _Silent(ast.NodeVisitor):
    """Collects the positions whose change cannot be seen."""

    def __init__(self) -> None:
        self.positions: set[Position] = set()
        self.texts: set[Position] = set()

    def _hide(self, *nodes: ast.expr | None) -> None:
        for node in nodes:
            if node is not None:
                self.positions |= _covered(node)

    def _cover(self, *span: int) -> None:
        self.positions |= _span(*span)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        before = set(self.positions)
        self._cover(node.lineno, node.col_offset, node.body[0].lineno, node.body[0].col_offset)
        for value in (*node.args.defaults, *node.args.kw_defaults):
            if value is not None:
                self.positions -= _covered(value) - before
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        parts = [node.left, *node.comparators]
        if any(isinstance(part, ast.Constant) and isinstance(part.value, str) for part in parts):
            self.texts |= _covered(node)
        self.generic_visit(node)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        self._hide(node.annotation)
        self.generic_visit(node)

    def visit_keyword(self, node: ast.keyword) -> None:
        if node.arg in PROMISES and isinstance(node.value, ast.Constant):
            self._hide(node.value)
        self.generic_visit(node)

    def visit_If(self, node: ast.If) -> None:
        if isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            self.positions.add((node.lineno, node.col_offset))
            self._hide(node.test)
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if name in {"TypeVar", "lru_cache"}:
            self._hide(node)
        if name == "cast":
            self._hide(node.args[0])
        self.generic_visit(node)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        if any("Protocol" in ast.unparse(base) for base in node.bases):
            self._cover(node.lineno, 0, node.end_lineno or node.lineno, _WIDE)
        self.generic_visit(node)


def _covered(node: ast.expr) -> set[Position]:
    """All positions of an expression."""
    return _span(
        node.lineno, node.col_offset, node.end_lineno or node.lineno, node.end_col_offset or 0
    )


def _span(first: int, start: int, last: int, end: int) -> set[Position]:
    """Positions from one to another, the latter left out."""
    return {
        (line, column)
        for line in range(first, last + 1)
        for column in range(start if line == first else 0, end if line == last else _WIDE)
    }

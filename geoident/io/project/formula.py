"""Formulas of laws: texts such as ``a * exp(b * GSI)`` to trees of terms.

Python's own parser reads them; of what it knows only numbers, names, the operations and the
functions of a law are taken, and nothing is ever executed.
"""

from __future__ import annotations

import ast
import math
import re

from geoident.io.text.wording import Refusal, did_you_mean, shorten
from geoident.model.project.formulas import FUNCTIONS, LawTerm

_LONGEST = 500
_DEEPEST = 40
_OPERATORS: dict[type[ast.operator], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.Pow: "^",
}
_HINT = "Write it such as a * exp(b * GSI): numbers, names, + - * / ^, exp, log, log10, sqrt."


def parse_formula(text: str) -> LawTerm:
    """The tree of a formula.

    >>> parse_formula("a * GSI^2").kind
    '*'

    Raises:
        Refusal: it is none.
    """
    written = shorten(text)
    if not text.strip() or len(text) > _LONGEST:
        raise Refusal("bad-formula", f"'{written}' is not a formula", _HINT)
    try:
        tree = ast.parse(re.sub(r"\^", "**", text.strip()), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        reason = error.msg if isinstance(error, SyntaxError) else "it is too deep"
        raise Refusal("bad-formula", f"'{written}' is not a formula: {reason}", _HINT) from error
    return _term(tree.body, written, 0)


def _term(node: ast.expr, written: str, depth: int) -> LawTerm:
    if depth > _DEEPEST:
        raise Refusal("bad-formula", f"'{written}' is too deep", _HINT)
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            if not math.isfinite(value):
                raise Refusal("bad-formula", f"'{written}': a number is too large", _HINT)
            return LawTerm("number", value=float(value))
        case ast.Name(id=name):
            return LawTerm("name", name=name)
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return _term(operand, written, depth + 1)
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return LawTerm("negative", (_term(operand, written, depth + 1),))
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
            sides = (_term(left, written, depth + 1), _term(right, written, depth + 1))
            return LawTerm(_OPERATORS[type(op)], sides)
        case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]):
            if name not in FUNCTIONS:
                hint = did_you_mean(name, FUNCTIONS, what="Functions")
                raise Refusal("bad-formula", f"'{written}': there is no function '{name}'", hint)
            return LawTerm(name, (_term(argument, written, depth + 1),))
    text = shorten(ast.unparse(node))
    raise Refusal("bad-formula", f"'{written}': '{text}' cannot be part of a law", _HINT)

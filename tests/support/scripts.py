"""Scripts of the documents, looked at without being run."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Iterator

import geoident
from geoident import errors

PUBLIC = {"geoident": geoident._API, "geoident.errors": vars(errors)}
"""Modules that a script may import from, with their names."""


def faults(source: str) -> list[str]:
    """What a script asks of the Python interface that is not there.

    Looked at are the names that it imports from geoident and the arguments of public functions.

    Raises:
        SyntaxError: it is no Python.
    """
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("geoident"):
            known = PUBLIC.get(node.module or "", ())
            names = [alias.name for alias in node.names]
            found += [f"{node.module} has no public {name}" for name in names if name not in known]
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            found += _wrong_arguments(node, node.func.id)
    return found


def _wrong_arguments(call: ast.Call, name: str) -> Iterator[str]:
    function = getattr(geoident, name) if name in geoident._API else None
    if not inspect.isfunction(function):
        return
    keywords = {word.arg: None for word in call.keywords if word.arg is not None}
    try:
        inspect.signature(function).bind(*([None] * len(call.args)), **keywords)
    except TypeError as error:
        yield f"{name}, line {call.lineno}: {error}"

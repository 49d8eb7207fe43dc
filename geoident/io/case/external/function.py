"""Functions of Python that a case names."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from geoident.errors import Fault, InputError, Location
from geoident.io.case.external.surroundings import ModelContext
from geoident.io.external.templates import MAX_BYTES
from geoident.io.text.faults import Faults
from geoident.io.text.text_file import decode, read_bytes
from geoident.model.case import KeyPath


def function_of(text: str, path: KeyPath, around: ModelContext) -> tuple[str, str]:
    """Path of a file and the name of a function in it; what is wrong is noted.

    Args:
        text: ``module:function``.
        path: of the key that says so.
        around: of the model.
    """
    module, _, name = text.rpartition(":")
    file = module if module.endswith(".py") else f"{module.replace('.', '/')}.py"
    before = len(around.faults.found)
    file_path = around.find(file, path)
    if len(around.faults.found) == before:
        _require_name(file_path, name, path, around.faults)
    return file_path, name


def _require_name(file: str, name: str, path: KeyPath, faults: Faults) -> None:
    """A file of Python must be one, and have something of a name; nothing of it is run."""
    try:
        tree = ast.parse(decode(read_bytes(file, limit=MAX_BYTES, what="module"), file))
    except InputError as error:
        faults.extend(error.faults)
        return
    except SyntaxError as error:
        place = Location(file, error.lineno or 1, error.offset or 1)
        faults.extend([Fault("not-python", f"this is not Python: {error.msg}", "", place)])
        return
    names = list(_names(tree))
    if name not in names and "*" not in names:
        hint = faults.did_you_mean(name, names, what="What it has")
        faults.add(path, "no-function", f"{Path(file).name} has no function '{name}'", hint)


def _names(tree: ast.Module) -> Iterator[str]:
    """What a module calls by a name at its top."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            yield node.name
        elif isinstance(node, ast.Assign):
            yield from (target.id for target in node.targets if isinstance(target, ast.Name))
        elif isinstance(node, ast.Import | ast.ImportFrom):
            yield from (alias.asname or alias.name for alias in node.names)
        elif isinstance(node, ast.If | ast.Try):
            yield "*"

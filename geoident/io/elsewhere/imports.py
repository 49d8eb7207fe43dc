"""What a file of Python imports from beside it: part of the model, as the file itself is."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path


def imported_files(path: str) -> tuple[str, ...]:
    """Files beside a file of Python that it imports, and those that these import.

    Nothing is run: an import is seen where it is written as one, or calls `import_module` or
    `__import__` with the name itself. A folder of modules counts with all its files. What a
    function imports otherwise is refused when it is run.

    Args:
        path: of the file; one that is missing or no Python imports nothing.
    """
    folder, found, left = Path(path).parent, dict[str, None](), [Path(path)]
    while left:
        for name in _imports(left.pop()):
            for file in _beside(folder, name):
                if str(file) not in found and str(file) != path:
                    found[str(file)] = None
                    left.append(file)
    return tuple(found)


def _imports(path: Path) -> Iterator[str]:
    """Names of modules and packages, up to the first dot."""
    try:
        tree = ast.parse(path.read_bytes())
    except (OSError, ValueError, SyntaxError, RecursionError, MemoryError):
        return
    for node in ast.walk(tree):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names = [node.module]
        elif isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
            called = getattr(node.func, "attr", getattr(node.func, "id", ""))
            if called in ("import_module", "__import__"):
                names = [str(node.args[0].value)]
        yield from (name.partition(".")[0] for name in names)


def _beside(folder: Path, name: str) -> list[Path]:
    """The files of a module or of a folder of modules; none where a folder has no such.

    A folder needs no ``__init__.py``: then a module of its name goes before it, and both count.
    """
    if not name.isidentifier():
        return []
    module = folder / f"{name}.py"
    return [*([module] if module.is_file() else []), *sorted((folder / name).rglob("*.py"))]

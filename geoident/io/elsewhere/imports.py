"""What a file of Python imports from beside it: part of the model, as the file itself is."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path


def imported_files(path: str) -> tuple[str, ...]:
    """Files beside a file of Python that it imports, and those that these import.

    Only what is written as an import is seen; nothing is run. A package counts with all its files.

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
    except (OSError, ValueError, SyntaxError):
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.partition(".")[0]


def _beside(folder: Path, name: str) -> list[Path]:
    """The files of a module or a package of a folder; none where it has no such."""
    package = folder / name
    if (package / "__init__.py").is_file():
        return sorted(package.rglob("*.py"))
    module = folder / f"{name}.py"
    return [module] if module.is_file() else []

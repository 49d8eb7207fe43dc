"""What a command names, and what a file of Python imports from beside it: parts of the model."""

from __future__ import annotations

import ast
import os
import re
import shlex
from collections.abc import Iterator
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

SCRIPTS = (".py", ".pyw", ".pyc", ".sh", ".bash", ".bat", ".cmd", ".ps1", ".pl", ".rb", ".tcl",
           ".jl", ".R", ".m", ".lua")  # fmt: skip
"""Suffixes of files that are run by a program which is given them."""

_COMPILED = ("", ".exe", ".out", ".x", ".bin")
"""Suffixes of those that are run themselves; where files have no rights, others look like these."""

_MOST = 100_000
"""Bytes of a file without suffix that may be one of Python, as `python3 FILE` runs it."""


def words_of(argument: str) -> tuple[str, ...]:
    """What an argument of a command may name, alone or in an option or a line for a shell.

    Not what such a line writes: ``> FILE``.

    >>> words_of("--deck=a.inp")
    ('--deck=a.inp', '--deck', 'a.inp', 'deck=a.inp')
    >>> "a b.py" in words_of("python3 'a b.py'; ls > log"), "log" in words_of("ls > log")
    (True, False)

    Args:
        argument: of a command.
    """
    names = [argument, *re.split(r"[\s'\";&|<>()=,:@`]+", argument)]
    written = set[str]()
    if argument.startswith("-"):
        names += [argument.partition("=")[2], argument[2:]]  # -fFILE
    with suppress(ValueError):  # no line for a shell
        line = shlex.shlex(argument, posix=True, punctuation_chars=True)
        line.whitespace_split, line.commenters = True, ""
        words = list(line)
        names += [part for word in words for part in (word, word.partition("=")[2])]
        written.update(word for before, word in pairwise(words) if before in (">", ">>", "&>"))
    # no error where there is no such user
    names += [os.path.expanduser(os.path.expandvars(w)) for w in names if w[:1] in ("~", "$")]  # noqa: PTH111
    return tuple(dict.fromkeys(word for word in names if word and word not in written))


def is_program(path: Path) -> bool:
    """Whether a file may be there to be run, and not to be read or written.

    Args:
        path: of the file, or of something else.
    """
    if not path.is_file():
        return False
    return path.suffix in SCRIPTS or (path.suffix in _COMPILED and os.access(path, os.X_OK))


def imported_files(path: str) -> tuple[str, ...]:
    """Files beside a file of Python that it imports, and those that these import.

    Nothing is run: an import is seen where it is written as one, or calls `import_module` or
    `__import__` with the name itself. A folder of modules counts with all its files. What a
    function imports otherwise is refused when it is run.

    Args:
        path: of the file; one that is missing or no Python imports nothing.
    """
    if not _is_python(Path(path)):
        return ()
    folder, imported, left = Path(path).parent, dict[str, None](), [Path(path)]
    while left:
        for name in _imports(left.pop()):
            for file in _beside(folder, name):
                if str(file) not in imported and str(file) != path:
                    imported[str(file)] = None
                    left.append(file)
    return tuple(imported)


def _is_python(path: Path) -> bool:
    """By its suffix, by its first line, or possibly, as a small file without suffix."""
    if not path.is_file():  # a pipe would be waited for
        return False
    if path.suffix in (".py", ".pyw"):
        return True
    try:
        with path.open("rb") as file:
            begins = file.readline(200)
        return (
            b"python" in begins
            if begins[:2] == b"#!"
            else (not path.suffix and path.stat().st_size < _MOST)
        )
    except OSError:
        return False


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

"""A function reads of a case what the case names, so that nothing it depends on changes unseen.

Runs are kept, and trust is remembered, for the state of named files. This is no sandbox: a function
that was trusted may do what it likes. What Python opens, imports and starts is seen; what libraries
open by themselves (HDF5) is not, nor what programs read that the function starts.
"""

from __future__ import annotations

import errno
import json
import os
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.metadata import distributions
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from urllib.request import url2pathname

import geoident
from geoident.io.external.imports import is_program, words_of
from geoident.workflow.executing.environment import path_without_here

_STARTS = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn")
"""Events of programs that are started."""


def _installed() -> tuple[str, ...]:
    """Where Python finds modules, but for the current folder and that of a script."""
    script = getattr(sys.modules.get("__main__"), "__file__", None) or ""
    own = {Path.cwd(), Path(script).resolve().parent}
    paths = (*sys.path, sys.prefix, sys.base_prefix, *_editable())
    folders = [Path(path).resolve() for path in paths if path]
    package = Path(geoident.__file__).resolve().parent
    return tuple(map(str, dict.fromkeys([*(one for one in folders if one not in own), package])))


def _editable() -> Iterator[str]:
    """Folders that are installed where they lie (PEP 610): not all of them are on the path."""
    for installed in distributions(path=path_without_here()):
        with suppress(OSError, ValueError, KeyError, TypeError):
            origin = json.loads(installed.read_text("direct_url.json") or "")
            if origin["dir_info"]["editable"] and origin["url"].startswith("file:"):
                yield url2pathname(urlsplit(origin["url"]).path)


@dataclass(frozen=True)
class Readable:
    """What a function may read.

    Args:
        files: paths that the case names.
        runs: folder of the runs, which lies beside the case; data in it are those of runs.
        since: seconds since 1970; what came to be later was made by runs.
        installed: folders of what is installed.
    """

    files: Sequence[str]
    runs: str
    since: float = field(default_factory=time.time)
    installed: tuple[str, ...] = field(default_factory=_installed)


class Guard:
    """Hears of all that this process opens, imports and starts (`sys.addaudithook`).

    Args:
        path: of the file of the function.
        name: of the function.
        readable: what it may read.
    """

    def __init__(self, path: str, name: str, readable: Readable) -> None:
        self._name, self._readable = name, readable
        self._here = Path(path).resolve().parent
        self._runs = Path(readable.runs).resolve()
        self._installed = tuple(map(Path, readable.installed))
        self._named = {Path(file).resolve() for file in (path, *readable.files)}
        self.refused = ""
        """What was refused first: whatever the function makes of that, it has no answer."""

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Refuse what the case does not name.

        Raises:
            PermissionError: that.
            FileNotFoundError: it was compiled beside a case, where nobody sees what it does.
        """
        if event == "open":
            made = arguments[2] & (os.O_CREAT | os.O_TRUNC)
            if not arguments[2] & os.O_WRONLY and not (arguments[2] & os.O_RDWR and made):
                self._require(arguments[0])
        elif event == "import" and arguments[1] is not None:  # a compiled extension
            self._require(arguments[1], code=True)
        elif event == "import":
            for place in arguments[2] or ():
                self._require(place, code=True)  # an archive of modules, if it is a file
        elif event == "ctypes.dlopen":
            self._require(arguments[0])
        elif event in _STARTS:
            folder = arguments[2] if event == "subprocess.Popen" else None
            self._require_started(event, arguments, os.curdir if folder is None else folder)

    def _require_started(self, event: str, arguments: tuple[Any, ...], folder: Any) -> None:
        """Refuse programs, and those among their arguments, also in lines for a shell."""
        folder = os.fsdecode(folder)
        if event != "os.system":
            self._require(arguments[0], folder)
        line = arguments[0] if event == "os.system" else arguments[1]
        for one in [line] if isinstance(line, str | bytes) else line or ():
            if isinstance(one, str | bytes | os.PathLike):
                for word in words_of(os.fsdecode(one)):
                    if is_program(Path(folder) / word):
                        self._require(word, folder)

    def _require(self, file: Any, folder: str = os.curdir, *, code: bool = False) -> None:
        """Refuse a file of the case that the case does not name, and code from elsewhere."""
        if not isinstance(file, str | bytes | os.PathLike):
            return  # a file that is open
        absolute = Path.cwd() / folder / os.fsdecode(file)
        path, real = absolute.parent.resolve() / absolute.name, absolute.resolve()
        if real in self._named or not real.is_file():
            return
        of_case = [one for one in (self._here, self._runs.parent) if path.is_relative_to(one)]
        # a folder in that of the case may be installed, one that has the case in it is not
        installed = (r for r in self._installed if not _holds_one(r, of_case))
        if any(real.is_relative_to(root) for root in installed):
            return
        if not (code or real.suffix in (".py", ".pyc", ".pyw")):
            # a case may lie in somebody's home: what is hidden there is not of the case
            shown = any("." not in {p[0] for p in path.relative_to(f).parts} for f in of_case)
            if not shown or path.is_relative_to(self._runs):
                return
        if real.stat().st_ctime > self._readable.since:
            return
        if path.parent.name == "__pycache__":
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
        name = path.relative_to(self._here) if self._here in path.parents else path
        message = (
            f"'{self._name}' reads '{name.as_posix()}', which the case does not name: runs would "
            "be kept when it has changed. List it in the case under 'files' of 'model'"
        )
        self.refused = self.refused or message
        raise PermissionError(message)


def _holds_one(root: Path, folders: Iterable[Path]) -> bool:
    return any(folder.is_relative_to(root) for folder in folders)

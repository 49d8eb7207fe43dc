"""A process that calls functions of Python files, so that these can crash or hang alone.

What functions print goes to a file, or nowhere.
"""

from __future__ import annotations

import importlib.util
import os
import pickle
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any

from geoident.forward.external.runs import FailedRun
from geoident.workflow.executing.processes import ChildProcess
from geoident.workflow.programs.guard import Guard, Readable

Call = tuple[str, str, tuple[object, ...], Readable]
"""Path of a file, name of a function in it, arguments, and what it may read: the same in all calls
of a process."""


class FunctionProcess:
    """Such a process, started when it is needed.

    Args:
        limit: seconds after which a call is ended; None for no limit.
        printed: file to which what functions print is added; None for nowhere.
    """

    def __init__(self, limit: float | None, printed: Path | None = None) -> None:
        self._child: ChildProcess[Call, bytes] = ChildProcess(
            pickle.dumps(_caller),
            time_limit=limit,
            retries=0,
            environment={"OMP_NUM_THREADS": "1"},
            printed=printed or Path(os.devnull),
        )

    def call(self, path: str, name: str, arguments: tuple[object, ...], readable: Readable) -> Any:
        """What a function gives, or a `FailedRun`.

        Args:
            path: of its file.
            name: of the function.
            arguments: of the call.
            readable: what it may read of its case.
        """
        answer = self._child.answer(0, (path, name, arguments, readable))
        if answer.value is None:
            why = answer.losses[-1] if answer.losses else "was ended"
            return FailedRun(f"the process of '{name}' {why}")
        try:
            well, value = pickle.loads(answer.value)
        except (ImportError, AttributeError) as error:
            return FailedRun(f"'{name}' gave an object of a class that only its file has: {error}")
        return value if well else FailedRun(value)

    @property
    def ended(self) -> bool:
        """It was ended, and calls nothing any more."""
        return self._child.stopped

    def end(self) -> None:
        """End the process."""
        self._child.kill()
        self._child.close(0.0)


def _caller() -> Callable[[Call], bytes]:
    """What calls functions there; an answer is pickled: whether it went well, and what came out."""
    modules: dict[str, ModuleType] = {}
    guards: dict[str, Guard] = {}
    begun = Path.cwd()

    def call(call_sent: Call) -> bytes:
        path, name, arguments, readable = call_sent
        try:
            if path not in guards:
                os.chdir(begun)
                guards[path] = Guard(path, name, readable)
                sys.addaudithook(guards[path])
            os.chdir((begun / path).parent)  # what it names lies beside it, wherever we began
            if path not in modules:
                files = [str(begun / file) for file in readable.files]
                modules[path] = _loaded(str(begun / path), files)
            answer = pickle.dumps((True, _plain(getattr(modules[path], name)(*arguments))))
        except BaseException as error:  # whatever it is, the run has failed
            answer = pickle.dumps((False, f"{type(error).__name__}: {error}"))
        for refused in filter(None, (guard.refused for guard in guards.values())):
            answer = pickle.dumps((False, refused))
        return answer

    return call


def _loaded(path: str, files: Sequence[str]) -> ModuleType:
    folder = str(Path(path).resolve().parent)
    sys.meta_path.insert(0, _Beside(path, files))
    sys.path.append(folder)
    sys.dont_write_bytecode = True  # it would not be read
    spec = importlib.util.spec_from_file_location(Path(path).stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def _plain(answer: Any) -> Any:
    """Mappings and rows of classes of the file, which nobody else knows, as Python's own."""
    if isinstance(answer, Mapping):
        return {key: _plain(value) for key, value in answer.items()}
    if isinstance(answer, list | tuple):
        return [_plain(value) for value in answer]
    return answer


class _Beside:
    """Finds what a file imports from beside it, as far as the case names that.

    Anything else that lies there comes last: Python's own modules, and those of others, would
    import it in place of what they mean.

    Args:
        path: of the file.
        files: paths that the case names.
    """

    def __init__(self, path: str, files: Sequence[str]) -> None:
        self._folder = str(Path(path).resolve().parent)
        beside = (Path(os.path.relpath(file, Path(path).parent)) for file in files)
        self._names = {file.parts[0].removesuffix(".py") for file in beside}

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The module; None for all others.

        Args:
            fullname: of the module.
            path: where its package is.
            target: the module that is reloaded, if one is.
        """
        if path is not None or fullname not in self._names:
            return None
        return PathFinder.find_spec(fullname, [self._folder], target)

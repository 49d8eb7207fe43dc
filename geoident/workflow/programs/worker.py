"""A process that calls functions of Python files, so that these can crash or hang alone.

It reads pickled requests (path, name, arguments, what may be read) from its input and answers on
its output with pickled pairs: whether it went well, and what came out. What functions print goes to
stderr.
"""

from __future__ import annotations

import importlib.util
import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any

from geoident.forward.external.runs import FailedRun
from geoident.workflow.executing.processes import environment_of_programs, path_without_here
from geoident.workflow.programs.guard import Guard, Readable

_BEGIN = "import sys; sys.path = {!r}; from geoident.workflow.programs.worker import serve; serve()"
"""What such a process begins with. PYTHONPATH would reach programs that functions start, too."""


class Worker:
    """Such a process, started when it is needed.

    Args:
        output: file to which what functions print is added; None for nowhere.
    """

    def __init__(self, output: Path | None = None) -> None:
        self._output = output
        self._process: subprocess.Popen[bytes] | None = None

    def call(
        self,
        path: str,
        name: str,
        arguments: tuple[object, ...],
        readable: Readable,
        limit: float | None,
    ) -> Any:
        """What a function gives, or a `FailedRun`.

        Args:
            path: of its file.
            name: of the function.
            arguments: of the call.
            readable: what it may read of its case; in one process always the same.
            limit: seconds after which the process is ended; None for no limit.
        """
        process = self._started()
        assert process.stdin is not None
        assert process.stdout is not None
        late = threading.Event()

        def end() -> None:
            late.set()
            process.kill()

        timer = threading.Timer(limit, end) if limit is not None else None
        if timer is not None:
            timer.start()
        try:
            pickle.dump((path, name, arguments, readable), process.stdin)
            process.stdin.flush()
            well, found = pickle.load(process.stdout)
        except (OSError, EOFError, pickle.PickleError, ValueError):
            self.end()
            if late.is_set():
                return FailedRun(f"'{name}' took longer than {limit:g} s")
            return FailedRun(f"'{name}' ended its process ({_ending(process.returncode)})")
        except (ImportError, AttributeError) as error:
            self.end()  # who knows where its answer would go on
            return FailedRun(f"'{name}' gave an object of a class that only its file has: {error}")
        finally:
            if timer is not None:
                timer.cancel()
        return found if well else FailedRun(str(found))

    def end(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            for stream in (process.stdin, process.stdout):
                if stream is not None:
                    with suppress(OSError):
                        stream.close()

    def _started(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._process.poll() is not None:
            with Path(self._output or os.devnull).open("ab") as printed:
                self._process = subprocess.Popen(
                    [sys.executable, "-P", "-c", _BEGIN.format(path_without_here())],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=printed,
                    env={**environment_of_programs(), "OMP_NUM_THREADS": "1"},
                    start_new_session=True,  # Ctrl-C reaches us only
                )
        return self._process


def _ending(code: int | None) -> str:
    return f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"


def serve() -> None:
    """Answer requests until there are no more."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    requests, modules = sys.stdin.buffer, dict[str, ModuleType]()
    guards, begun = dict[str, Guard](), Path.cwd()
    while True:
        try:
            path, name, arguments, readable = pickle.load(requests)
        except EOFError:
            return
        try:
            if path not in guards:
                os.chdir(begun)
                guards[path] = Guard(path, name, readable)
                sys.addaudithook(guards[path])
            os.chdir((begun / path).parent)  # what it names lies beside it, wherever we began
            if path not in modules:
                files = [str(begun / file) for file in readable.files]
                modules[path] = _loaded(str(begun / path), files)
            answer = (True, _plain(getattr(modules[path], name)(*arguments)))
            data = pickle.dumps(answer)
        except BaseException as error:  # whatever it is, the run has failed
            data = pickle.dumps((False, f"{type(error).__name__}: {error}"))
        for refused in filter(None, (guard.refused for guard in guards.values())):
            data = pickle.dumps((False, refused))
        answers.write(data)
        answers.flush()


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

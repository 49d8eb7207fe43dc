"""Runs of a program: each in a folder of its own, with files written from templates."""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import stat
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np

from geoident.errors import Fault, InputError, OutputError
from geoident.forward.elsewhere.runs import FailedRun, RunsInTurn
from geoident.io.elsewhere.outputs import NotFound, RunFiles
from geoident.io.elsewhere.templates import (
    CannotBeFilled,
    field_texts,
    filled,
    key_texts,
    last_digit,
)
from geoident.io.text.wording import did_you_mean
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Case
from geoident.model.elsewhere import (
    ConvergenceLaw,
    Elsewhere,
    ExternalProgram,
    FunctionValue,
    JinjaTemplate,
    Output,
    PythonFunction,
    RunTable,
    TemplateField,
    seen_parameters,
)
from geoident.workflow.executing.executor import in_order, usable_cores
from geoident.workflow.executing.threads import WaitingThreads
from geoident.workflow.programs.digest import digest_of
from geoident.workflow.programs.run_log import Made, RunLog
from geoident.workflow.programs.trust import Execution, Permission
from geoident.workflow.programs.worker import Worker

_SHOWN = 3
_COARSE = 1e-6
"""Relative size of the last digit from which on a parameter counts as coarsely written."""
_STDOUT, _STDERR = "stdout.txt", "stderr.txt"


def executable(program: ExternalProgram) -> str | None:
    """Path of the program that a case runs; None where there is none."""
    name = program.command[0]
    if "/" in name or "\\" in name:
        path = Path(program.folder) / name
        return str(path.resolve()) if path.is_file() and os.access(path, os.X_OK) else None
    return shutil.which(name)


def is_beside(program: ExternalProgram) -> bool:
    """Whether the program that a case runs is meant from the folder of the case."""
    name = program.command[0]
    return ("/" in name or "\\" in name) and not Path(name).is_absolute()


def _named(output: Output) -> Output:
    """An output whose function is known by the name of its file: its content counts elsewhere."""
    how = output.how
    if not isinstance(how, FunctionValue):
        return output
    return replace(output, how=replace(how, path=Path(how.path).name))


def executed(given: Elsewhere) -> str:
    """What a model elsewhere runs, in words; of a table, what it has.

    Args:
        given: the model.
    """
    if isinstance(given, ConvergenceLaw):
        also = "" if given.creep is None else " and time"
        return f"convergence law in distance to the face{also} (Sulem, Panet and Guenot 1987)"
    if isinstance(given, RunTable):
        return f"the {len(given)} runs of {given.called}"
    if isinstance(given, PythonFunction):
        also = f" and '{given.jacobian}'" if given.jacobian else ""
        return f"the function '{given.name}'{also} of {Path(given.path).name}"
    first = executable(given) or given.command[0]
    files = dict.fromkeys(Path(file).name for file in (*given.files, *given.code))
    also = f" (with {', '.join(files)})" if files else ""
    return f"`{shlex.join((first, *given.command[1:]))}`{also}"


class ProgramRuns(RunsInTurn):
    """Runs of the program of a case.

    Args:
        case: the case.
        program: of the case.
        folder: of the runs.
        again: runs that failed before are made again.

    Raises:
        InputError: there is no such program.
    """

    has_jacobian = False

    def __init__(
        self, case: Case, program: ExternalProgram, folder: Path, *, again: bool = False
    ) -> None:
        self._workers: SimpleQueue[Worker] = SimpleQueue()
        path = executable(program)
        if path is None:
            raise InputError([_no_program(case, program)])
        self._case, self._program, self._folder = case, program, folder
        self._command = (path, *program.command[1:])
        self._names = tuple(parameter.name for parameter in case.parameters)
        self.seen: Bools = np.array(seen_parameters(program, self._names), dtype=bool)
        self.given: Bools = np.zeros((len(case.stages), len(case.channels)), dtype=bool)
        for output in program.outputs:
            self.given[output.stage, output.channel] = True
        said = [repr([_named(output) for output in program.outputs]), repr(case.stage_names)]
        said += [repr([c.name for c in case.channels]), repr([t.pieces for t in program.templates])]
        # one beside the case is known by its content, wherever the case lies
        first = program.command[0] if is_beside(program) else path
        digest = digest_of([repr((first, *program.command[1:])), *said], program.inputs)
        portable = digest_of([repr(program.command), *said], program.inputs)
        execution = Execution(executed(program), digest, portable)
        self._permission = Permission(execution, self._folder, case.source, "command")
        self._log = RunLog(folder, digest, again=again)
        self._fields: dict[str, list[TemplateField]] = {}
        for template in program.templates:
            for field in template.fields:
                self._fields.setdefault(field.parameter, []).append(field)
        self._failed: dict[str, FailedRun] = {}
        self._asked: set[str] = set()
        self._running: set[subprocess.Popen[bytes]] = set()
        self._lock, self._ended = threading.Lock(), False

    @property
    def notes(self) -> tuple[str, ...]:
        """Runs that failed, and parameters that are written with few digits."""
        found = []
        start = np.array([parameter.start for parameter in self._case.parameters])
        digits = self._digits(start, in_jinja=self._permission.is_given)
        for name, value, quantum in zip(self._names, start, digits, strict=True):
            if abs(quantum) > _COARSE * abs(value) > 0.0:
                found.append(
                    f"the template writes {name} with few digits (its last one is "
                    f"{quantum / abs(value):.0e} of the start): it is known no better than that"
                )
        return (*found, *failed_note(tuple(self._failed.values()), len(self._asked)))

    def written(self, p: Floats) -> Floats:
        """The parameters (n,) with the digits that are written, of several fields the most."""
        result = p.copy()
        for j, name in enumerate(self._names):
            read = [field.read(field.written(p[j])) for field in self._fields.get(name, ())]
            if read:
                result[j] = min(read, key=lambda value: abs(value - p[j]))
        return result

    def quantum(self, p: Floats) -> Floats:
        """(n,) the last digit of each parameter, of several fields the coarsest.

        Raises:
            InputError: that takes to fill a template in Jinja, and the case is not trusted.
        """
        self._trust_jinja()
        return self._digits(p, in_jinja=True)

    def _trust_jinja(self) -> None:
        """What is filled in by Jinja may compute whatever it likes: that is asked for before."""
        if any(isinstance(template, JinjaTemplate) for template in self._program.templates):
            self.require_trust()

    def _digits(self, p: Floats, *, in_jinja: bool) -> Floats:
        """(n,) the same, with those that templates in Jinja show or without."""
        result = 2.3e-16 * np.abs(p)
        for j, name in enumerate(self._names):
            for field in self._fields.get(name, ()):
                result[j] = max(result[j], field.last_digit(p[j]))
            for template in self._program.templates:
                if in_jinja and isinstance(template, JinjaTemplate):
                    result[j] = max(result[j], last_digit(template, self._values(p), name))
        return result

    @property
    def at_once(self) -> int:
        """How many runs are made at a time."""
        return self._program.machine.at_once or usable_cores()

    def each(
        self, points: Sequence[Floats], check: Callable[[], None]
    ) -> Iterator[Floats | FailedRun]:
        """Readings (n_stages, n_channels) in turn, each as it is there; runs go on meanwhile.

        Args:
            points: (n,) where.
            check: see `results`.
        """
        self._trust_jinja()
        asked = [self._texts(p) for p in points]
        new: dict[str, tuple[str, list[list[str]], dict[str, float]]] = {}
        for (key, texts), p in zip(asked, points, strict=True):
            self._asked.add(key)
            if not isinstance(texts, FailedRun) and self._log.find(key) is None:
                new.setdefault(
                    key, (key, texts, dict(zip(self._names, map(float, p), strict=True)))
                )
        if new:
            self.require_trust()
            self._ended = False
        threads = WaitingThreads(self.at_once, self._run, check=check, end=self._end)
        with closing(threads.run(new.values())) as made_now:
            answers = in_order(made_now)
            for key, texts in asked:
                if isinstance(texts, FailedRun):
                    result: Floats | FailedRun = texts
                else:
                    while (made := self._log.find(key)) is None:
                        next(answers)
                    result = made.found
                if isinstance(result, FailedRun):
                    self._failed[key] = result
                yield result

    def jacobian(self, p: Floats, check: Callable[[], None]) -> Floats | FailedRun:
        """Derivatives (n_stages, n_channels, n) at p (n,): a program gives none.

        Args:
            p: (n,) where.
            check: see `results`.
        """
        return FailedRun("a program gives no derivatives")

    def _texts(self, p: Floats) -> tuple[str, list[list[str]] | FailedRun]:
        templates = self._program.templates
        try:
            texts = [field_texts(template, self._values(p)) for template in templates]
        except CannotBeFilled as error:
            return repr(p.tolist()), FailedRun(str(error))
        parts = zip(templates, texts, strict=True)
        return "\n".join(word for part in parts for word in key_texts(*part)), texts

    def _values(self, p: Floats) -> dict[str, float]:
        """Parameters p (n,) by name."""
        return dict(zip(self._names, map(float, p), strict=True))

    def require_trust(self) -> str:
        """Ask whether it may be run, unless that is known.

        Returns:
            `Execution.portable` of it.

        Raises:
            InputError: it may not.
        """
        self._permission.require()
        return self._permission.portable

    def _run(self, item: tuple[str, list[list[str]], Mapping[str, float]]) -> None:
        key, texts, values = item
        if self._ended:
            return
        began = time.monotonic()
        folder = new_folder(self._folder)
        try:
            found = self._made(folder, texts)
        except OSError as error:
            message = f"{folder}: the run cannot be written: {error.strerror or error}"
            raise OutputError(message) from error
        if self._ended:
            shutil.rmtree(folder, ignore_errors=True)
            return
        self._log.add(key, Made(found, time.monotonic() - began), values)
        if not isinstance(found, FailedRun) and not self._program.keep_all:
            shutil.rmtree(folder, ignore_errors=True)

    def _made(self, folder: Path, texts: list[list[str]]) -> Floats | FailedRun:
        program = self._program
        for template, written in zip(program.templates, texts, strict=True):
            target = folder / template.target
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(filled(template, written), encoding="utf-8", newline="")
        for file in program.files:
            copied = Path(shutil.copy(file, folder / Path(file).name))
            copied.chmod(copied.stat().st_mode | stat.S_IWUSR)  # the program may write it anew
        failed = self._computed(folder)
        if failed is not None:
            return FailedRun(failed, str(folder))
        case, result = self._case, np.full(self.given.shape, np.nan)
        files = RunFiles(folder.resolve(), self._called)
        try:
            for output in program.outputs:
                channel, stage = case.channels[output.channel], case.stages[output.stage]
                value = files.number(output, channel.name, stage.name)
                result[output.stage, output.channel] = value
        except NotFound as error:
            return FailedRun(str(error), str(folder))
        return result

    def _computed(self, folder: Path) -> str | None:
        """Run the program in a folder; why that failed, or None."""
        limit = self._program.machine.time_limit
        with (folder / _STDOUT).open("wb") as out, (folder / _STDERR).open("wb") as err:
            try:
                process = subprocess.Popen(
                    self._command,
                    cwd=folder,
                    stdin=subprocess.DEVNULL,
                    stdout=out,
                    stderr=err,
                    env={**os.environ, "TMPDIR": str(folder.resolve())},
                    start_new_session=True,  # so that what it starts ends with it
                )
            except OSError as error:
                return f"the program cannot be started: {error.strerror or error}"
        with self._lock:
            self._running.add(process)
        if self._ended:
            _kill(process)
        try:
            code = process.wait(limit)
        except subprocess.TimeoutExpired:
            _kill(process)
            return f"it took longer than {limit:g} s"
        finally:
            with self._lock:
                self._running.discard(process)
        if code == 0:
            return None
        said = _last_line(folder / _STDERR) or _last_line(folder / _STDOUT)
        ending = f"signal {-code}" if code < 0 else f"exit code {code}"
        return f"{ending}: {said}" if said else ending

    def _called(self, path: str, name: str, folder: str, gauge: str, stage: str) -> Any:
        """What a function that finds a number says, in a process of its own."""
        worker = Worker() if self._workers.empty() else self._workers.get()
        found = worker.call(path, name, (folder, gauge, stage), self._program.machine.time_limit)
        self._workers.put(worker)
        if isinstance(found, FailedRun):
            raise NotFound(found.reason)
        return found

    def _end(self) -> None:
        self._ended = True
        with self._lock:
            running = tuple(self._running)
        for process in running:
            _kill(process)

    def __del__(self) -> None:
        while not self._workers.empty():
            self._workers.get().end()


_FIRST = [""]
"""What names of folders of runs begin with in this process."""


def begin_names(first: str) -> None:
    """Let names of folders of runs begin with something that no other process has.

    Folders of several machines then lie beside each other in one.

    Args:
        first: beginning of the names.
    """
    _FIRST[0] = first


def new_folder(folder: Path) -> Path:
    """A folder that no other run has, below that of all runs: 00001, 00002, ...

    Raises:
        OutputError: it cannot be made.
    """
    first = _FIRST[0]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        names = [path.name.removeprefix(first) for path in folder.iterdir()]
        number = max((int(name) for name in names if name.isdigit()), default=0) + 1
        while True:
            with suppress(FileExistsError):
                place = folder / f"{first}{number:05d}"
                place.mkdir()
                return place
            number += 1
    except OSError as error:
        message = f"{folder}: a folder for a run cannot be made: {error.strerror or error}"
        raise OutputError(message) from error


def failed_note(failed: Sequence[FailedRun], asked: int) -> tuple[str, ...]:
    """That runs have failed, if some have.

    Args:
        failed: they.
        asked: number of all runs.
    """
    if not failed:
        return ()
    shown = "; ".join(str(run) for run in failed[:_SHOWN])
    rest = f"; and {len(failed) - _SHOWN} more" if len(failed) > _SHOWN else ""
    return (
        f"{len(failed)} of {asked} runs failed, and the search went around them: {shown}{rest}",
    )


def _no_program(case: Case, program: ExternalProgram) -> Fault:
    name = program.command[0]
    path: tuple[str | int, ...] = ("model", "command", 0)
    if "/" in name or "\\" in name:
        place = Path(program.folder) / name
        if place.is_file():
            message, hint = f"'{place}' may not be executed", f"chmod +x {shlex.quote(str(place))}"
        else:
            beside = [p.name for p in place.parent.iterdir()] if place.parent.is_dir() else []
            message = f"there is no program '{place}'"
            hint = did_you_mean(place.name, beside, what="Files there")
    else:
        message = f"there is no program '{name}' on the search path (PATH)"
        hint = "Install it, or write its path; one with / is seen from the folder of the case."
        if (Path(program.folder) / name).is_file():
            hint = f"Write './{name}' for the one beside the case."
    return case.source.fault(path, code="no-program", message=message, hint=hint)


def _kill(process: subprocess.Popen[bytes]) -> None:
    """End a process and what it has started."""
    with suppress(OSError):
        if hasattr(os, "killpg"):
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
    process.wait()


def _last_line(file: Path) -> str:
    with suppress(OSError):
        lines = file.read_bytes()[-4000:].decode("utf-8", "replace").split("\n")
        said = [line.strip() for line in lines if line.strip()]
        return said[-1][:200] if said else ""
    return ""

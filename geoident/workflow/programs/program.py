"""Runs of a program: each in a folder of its own, with files written from templates."""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import stat
import subprocess
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from tempfile import mkdtemp
from typing import Any

import numpy as np

from geoident.errors import Fault, InputError, OutputError
from geoident.forward.external.runs import FailedRun
from geoident.io.external.outputs import NotFound, RunFiles
from geoident.io.external.templates import (
    CannotBeFilled,
    field_texts,
    filled,
    key_texts,
    last_digit,
)
from geoident.io.text.wording import did_you_mean
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Case
from geoident.model.external import (
    ConvergenceLaw,
    ExternalProgram,
    ExternalSource,
    FunctionValue,
    InstructedValue,
    JinjaTemplate,
    Output,
    PythonFunction,
    RunTable,
    TemplateField,
    seen_parameters,
)
from geoident.model.in_service import SeasonalModel
from geoident.model.settlement import SETTLEMENT_WORDS, SettlementLaw
from geoident.workflow.executing.executor import SetUp
from geoident.workflow.executing.parcel import relative
from geoident.workflow.programs.digest import (
    ModelFiles,
    executable,
    is_beside,
    model_files,
    names_of,
)
from geoident.workflow.programs.function_process import FunctionProcess
from geoident.workflow.programs.logged_runs import LoggedRuns, RemoteRun, RunItem, run_maker
from geoident.workflow.programs.run_log import new_folder
from geoident.workflow.programs.trust import Execution

_COARSE = 1e-6
"""Relative size of the last digit from which on a parameter counts as coarsely written."""
_SHOWN = 12
"""Files that are named of a model."""
_STDOUT, _STDERR = "stdout.txt", "stderr.txt"


def program_of(source: ExternalProgram | PythonFunction) -> tuple[str, ...]:
    """What must be installed where a model runs: its program, if that does not lie beside the case.

    Args:
        source: the model.
    """
    if isinstance(source, PythonFunction) or is_beside(source) or executable(source) is None:
        return ()
    return (source.command[0],)


def _named(output: Output) -> Output:
    """An output whose function is known by the name of its file: its content counts elsewhere."""
    how = output.how
    if not isinstance(how, FunctionValue):
        return output
    return replace(output, how=replace(how, path=Path(how.path).name))


def executed(source: ExternalSource) -> str:
    """What a model elsewhere runs, in words; of a table, what it has.

    Args:
        source: the model.
    """
    if isinstance(source, ConvergenceLaw):
        also = "" if source.creep is None else " and time"
        return f"convergence law in distance to the face{also} (Sulem, Panet and Guenot 1987)"
    if isinstance(source, SettlementLaw):
        return SETTLEMENT_WORDS[source.curve]
    if isinstance(source, SeasonalModel):
        return f"seasonal model of {', '.join(source.words)}"
    if isinstance(source, RunTable):
        return f"the {len(source)} runs of {source.called}"
    if isinstance(source, PythonFunction):
        also = f" and '{source.jacobian}'" if source.jacobian else ""
        with_files = _with([file for file in source.files if file != source.path])
        return f"the function '{source.name}'{also} of {Path(source.path).name}{with_files}"
    first = executable(source) or source.command[0]
    return f"`{shlex.join((first, *source.command[1:]))}`{_with([*source.files, *source.code])}"


def _with(files: Sequence[str]) -> str:
    names = list(dict.fromkeys(Path(file).name for file in files))
    rest = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return f" (with {', '.join(names[:_SHOWN])}{rest})" if names else ""


class ProgramRuns(LoggedRuns):
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
        self._functions: SimpleQueue[FunctionProcess] = SimpleQueue()
        path = executable(program)
        if path is None:
            raise InputError([_no_program(case, program)])
        self._program = program
        self._command = (path, *program.command[1:])
        names = tuple(parameter.name for parameter in case.parameters)
        self.seen: Bools = np.array(seen_parameters(program, names), dtype=bool)
        self.provided: Bools = np.zeros((len(case.stages), len(case.channels)), dtype=bool)
        for output in program.outputs:
            self.provided[output.stage, output.channel] = True
        files = ModelFiles(model_files(program))
        texts = [repr([_named(output) for output in program.outputs]), repr(case.stage_names)]
        texts += [
            repr([c.name for c in case.channels]),
            repr([(t.target, t.pieces) for t in program.templates]),
        ]
        texts.append(repr(names_of(program, Path(program.folder))))
        # one beside the case is known by its content, wherever the case lies
        first = program.command[0] if is_beside(program) else path
        digest = files.digest([repr((first, *program.command[1:])), *texts], model_files(program))
        portable = files.digest([repr(program.command), *texts], program.inputs)
        execution = Execution(executed(program), digest, portable)
        super().__init__(case, program, folder, files=files, execution=execution, again=again)
        run = set(model_files(program)).difference(program.files)
        in_place = any(file.endswith(".py") for file in run)
        self._compiled = mkdtemp(prefix="geoident-") if in_place else ""
        weakref.finalize(self, shutil.rmtree, self._compiled, ignore_errors=True)
        self._fields: dict[str, list[TemplateField]] = {}
        for template in program.templates:
            for field in template.fields:
                self._fields.setdefault(field.parameter, []).append(field)
        self._running: set[subprocess.Popen[bytes]] = set()

    @property
    def notes(self) -> tuple[str, ...]:
        """Runs that failed, and parameters that are written with few digits."""
        notes = []
        start = np.array([parameter.start for parameter in self._case.parameters])
        digits = self._digits(start, in_jinja=self._permission.is_given)
        for name, value, quantum in zip(self._names, start, digits, strict=True):
            if abs(quantum) > _COARSE * abs(value) > 0.0:
                notes.append(
                    f"the template writes {name} with few digits (its last one is "
                    f"{quantum / abs(value):.0e} of the start): it is known no better than that"
                )
        return (*notes, *super().notes)

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

    def each(
        self, points: Sequence[Floats], check: Callable[[], None]
    ) -> Iterator[Floats | FailedRun]:
        """Readings (n_stages, n_channels) in turn, each as it is there; runs go on meanwhile.

        Args:
            points: (n,) where.
            check: see `ModelRuns.each`.
        """
        self._trust_jinja()
        return self.in_turn([self._item(p) for p in points], check)

    def jacobian(self, p: Floats, check: Callable[[], None]) -> Floats | FailedRun:
        """Derivatives (n_stages, n_channels, n) at p (n,): a program gives none.

        Args:
            p: (n,) where.
            check: see `ModelRuns.each`.
        """
        return FailedRun("a program gives no derivatives")

    def _item(self, p: Floats) -> tuple[str, RunItem | FailedRun]:
        """The run at p (n,): what is written for it; or why it cannot be."""
        templates = self._program.templates
        try:
            texts = [field_texts(template, self._values(p)) for template in templates]
        except CannotBeFilled as error:
            return repr(p.tolist()), FailedRun(str(error))
        parts = zip(templates, texts, strict=True)
        key = "\n".join(word for part in parts for word in key_texts(*part))
        return key, RunItem(key, texts, self._values(p))

    def _values(self, p: Floats) -> dict[str, float]:
        """Parameters p (n,) by name."""
        return dict(zip(self._names, map(float, p), strict=True))

    def portable(self) -> tuple[SetUp[RunItem, RemoteRun], tuple[str, ...], tuple[str, ...]]:
        """What makes runs in another process, files that it needs, and programs."""
        program, programs = self._program, program_of(self._program)
        portable = as_seen_from_here(program)
        moved = dict(zip(program.code, portable.code, strict=True))
        set_up = partial(set_up_program, self._case, portable, relative(str(self._folder)), moved)
        named = tuple(file for file in program.inputs if file not in programs)
        return set_up, named, programs

    def compute(self, item: RunItem) -> Floats | FailedRun:
        """Make a run in a folder of its own: readings (n_stages, n_channels).

        Raises:
            OutputError: the folder cannot be written.
        """
        folder = new_folder(self._folder)
        try:
            result = self._made(folder, item.argument)
        except OSError as error:
            message = f"{folder}: the run cannot be written: {error.strerror or error}"
            raise OutputError(message) from error
        if self._ended or not (isinstance(result, FailedRun) or self._program.keep_all):
            shutil.rmtree(folder, ignore_errors=True)
        return result

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
        case, result = self._case, np.full(self.provided.shape, np.nan)
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
        surroundings = {**os.environ, "TMPDIR": str(folder.resolve())}
        if self._compiled:  # what was compiled beside a script may be of another
            surroundings["PYTHONPYCACHEPREFIX"] = self._compiled
        with (folder / _STDOUT).open("wb") as out, (folder / _STDERR).open("wb") as err:
            try:
                process = subprocess.Popen(
                    self._command,
                    cwd=folder,
                    stdin=subprocess.DEVNULL,
                    stdout=out,
                    stderr=err,
                    env=surroundings,
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
        last = _last_line(folder / _STDERR) or _last_line(folder / _STDOUT)
        ending = f"signal {-code}" if code < 0 else f"exit code {code}"
        return f"{ending}: {last}" if last else ending

    def _called(self, path: str, name: str, folder: str, gauge: str, stage: str) -> Any:
        """What a function that finds a number says, in a process of its own."""
        free = self._functions
        process = FunctionProcess(self._program.machine.time_limit) if free.empty() else free.get()
        value = process.call(path, name, (folder, gauge, stage), self._readable)
        free.put(process)
        if isinstance(value, FailedRun):
            raise NotFound(value.reason)
        return value

    def end_running(self) -> None:
        """End the programs that run."""
        with self._lock:
            running = tuple(self._running)
        for process in running:
            _kill(process)

    def __del__(self) -> None:
        while not self._functions.empty():
            self._functions.get().end()


def set_up_program(
    case: Case, program: ExternalProgram, folder: str, moved: Mapping[str, str]
) -> Callable[[RunItem], RemoteRun]:
    """In a process far away: what makes runs of a program.

    Args:
        case: the case.
        program: of the case.
        folder: of the runs.
        moved: what is run, by its path where the command runs, to its path here.
    """
    first, *arguments = program.command
    for path, moved_to in moved.items():
        if Path(path).is_absolute():
            arguments = [one.replace(path, str(Path(moved_to).resolve())) for one in arguments]
    program = replace(program, command=(first, *arguments))
    return run_maker(ProgramRuns(case, program, Path(folder)), Path(folder))


def as_seen_from_here(program: ExternalProgram) -> ExternalProgram:
    """A program whose files are named as seen from where the command runs.

    Args:
        program: with names as the case has them.
    """

    def portable(output: Output) -> Output:
        how = output.how
        if isinstance(how, FunctionValue | InstructedValue):
            return replace(output, how=replace(how, path=relative(how.path)))
        return output

    return replace(
        program,
        folder=relative(program.folder),
        files=tuple(map(relative, program.files)),
        code=tuple(map(relative, program.code)),
        templates=tuple(replace(one, source=relative(one.source)) for one in program.templates),
        outputs=tuple(map(portable, program.outputs)),
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
    return case.source.fault(path, "no-program", message, hint)


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
        printed = [line.strip() for line in lines if line.strip()]
        return printed[-1][:200] if printed else ""
    return ""

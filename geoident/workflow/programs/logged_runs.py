"""Runs of a program or a function, each made once.

Known ones come from the log, new ones are made in threads here, or in processes on a cluster. A run
on a cluster is a task like any other. The log stays here, and so does the decision whether
the model may be run: what travels is what was decided on.
"""

from __future__ import annotations

import shutil
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from geoident.errors import ExitCode, Interrupted
from geoident.forward.external.runs import FailedRun
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.external import ExternalProgram, PythonFunction
from geoident.workflow.executing.executor import (
    Answered,
    BegunExecutor,
    SetUp,
    in_order,
    usable_cores,
)
from geoident.workflow.executing.parcel import packed
from geoident.workflow.executing.stop import StopRequest
from geoident.workflow.executing.threads import WaitingThreads
from geoident.workflow.executing.worker import STOP
from geoident.workflow.programs.digest import ModelFiles
from geoident.workflow.programs.guard import Readable
from geoident.workflow.programs.run_log import CompletedRun, RunLog
from geoident.workflow.programs.travelling import RunsMade, begin_there, keep_runs, runs_there
from geoident.workflow.programs.trust import Execution, Permission
from geoident.workflow.programs.workplace import OnCluster

_AT_LEAST = 2
"""Runs that a cluster is thought to make at a time before its workers are known."""

_SHOWN = 3
"""Runs that failed of which it is said why."""


@dataclass(frozen=True)
class RunItem:
    """A run that is to be made.

    Args:
        key: in the log.
        argument: what the model is given.
        values: parameters by name, SI.
    """

    key: str
    argument: Any
    values: Mapping[str, float]


@dataclass(frozen=True)
class RemoteRun:
    """A run that was made on another machine.

    Args:
        run: what came of it; None where it was ended before.
        left: what its folder holds, where that is kept.
    """

    run: CompletedRun | None
    left: RunsMade


class LoggedRuns(ABC):
    """Runs of the model of a case.

    Args:
        case: the case.
        model: its program or function.
        folder: of the runs.
        files: that decide what they give.
        execution: what is run.
        again: runs that failed before are made again.
    """

    def __init__(
        self,
        case: Case,
        model: ExternalProgram | PythonFunction,
        folder: Path,
        *,
        files: ModelFiles,
        execution: Execution,
        again: bool,
    ) -> None:
        self._case, self._model, self._folder, self._files = case, model, folder, files
        self._names = tuple(parameter.name for parameter in case.parameters)
        self._log = RunLog(folder, execution.digest, again=again)
        key = "function" if isinstance(model, PythonFunction) else "command"
        self._permission = Permission(execution, folder, case.source, key)
        self._readable = Readable(model.inputs, str(folder))
        self._lock = threading.Lock()
        self._failed: dict[str, FailedRun] = {}
        self._asked: set[str] = set()
        self._ended = False
        self._begin: Callable[[Callable[[], None]], BegunExecutor[RunItem, RemoteRun]] | None = None
        self._there: BegunExecutor[RunItem, RemoteRun] | None = None

    @property
    def is_trusted(self) -> bool:
        """Whether it is known or remembered that it may run; nobody is asked."""
        return self._permission.is_given

    @abstractmethod
    def compute(self, item: RunItem) -> Floats | FailedRun:
        """Make a run, in any thread: readings (n_stages, n_channels), or derivatives (..., n)."""

    @abstractmethod
    def end_running(self) -> None:
        """End the runs that are being made."""

    @abstractmethod
    def portable(self) -> tuple[SetUp[RunItem, RemoteRun], tuple[str, ...], tuple[str, ...]]:
        """What makes them in another process, files that it needs, and programs."""

    @property
    def at_once(self) -> int:
        """How many runs are made at a time."""
        if self._begin is not None:
            return max(_AT_LEAST, 0 if self._there is None else self._there.workers)
        return self._model.machine.at_once or usable_cores()

    @property
    def notes(self) -> tuple[str, ...]:
        """Runs that failed."""
        failed = list(self._failed.values())
        if not failed:
            return ()
        shown = "; ".join(str(run) for run in failed[:_SHOWN])
        rest = f"; and {len(failed) - _SHOWN} more" if len(failed) > _SHOWN else ""
        count = f"{len(failed)} of {len(self._asked)} runs failed"
        return (f"{count}, and the search went around them: {shown}{rest}",)

    def require_trust(self) -> str:
        """Ask whether they may be made, unless that is known.

        Returns:
            `Execution.portable` of the model.

        Raises:
            InputError: they may not.
        """
        self._permission.require()
        return self._permission.portable

    @contextmanager
    def on_cluster(self, cluster: OnCluster, stop: StopRequest) -> Iterator[None]:
        """Meanwhile new runs are made on a cluster.

        Args:
            cluster: begun with the first of them.
            stop: the request to stop.
        """
        set_up, files, programs = self.portable()

        def ask_to_stop() -> None:
            if self._there is not None:
                self._there.ask_to_stop()

        with ExitStack() as held:

            def begin(check: Callable[[], None]) -> BegunExecutor[RunItem, RemoteRun]:
                parcel = packed(files, beside=[self._folder], programs=programs)
                made = cluster.begin(set_up, parcel, check=check)
                return held.enter_context(made)

            self._begin = begin
            try:
                with stop.heard_by(ask_to_stop):
                    yield
            finally:
                self._begin = self._there = None

    def in_turn(
        self, asked: Sequence[tuple[str, RunItem | FailedRun]], check: Callable[[], None]
    ) -> Iterator[Floats | FailedRun]:
        """What runs give (n_stages, n_channels), each as it is there; others go on meanwhile.

        Args:
            asked: keys and items, or why there is no run.
            check: is called every moment; raises to end the runs.

        Raises:
            InputError: the model may not be run.
        """
        new: dict[str, RunItem] = {}
        for key, item in asked:
            if isinstance(item, RunItem) and self._log.find(key) is None:
                new.setdefault(key, item)
        if new:
            self.require_trust()
            self._ended = False
        with closing(self._made_now(list(new.values()), check)) as made_now:
            answers = in_order(made_now)
            for key, item in asked:
                if isinstance(item, FailedRun):
                    result: Floats | FailedRun = item
                else:
                    while (made := self._log.find(key)) is None:
                        if next(answers, None) is None:
                            check()
                            raise Interrupted("Interrupted.", exit_code=ExitCode.TERMINATED)
                    result = made.result
                self._asked.add(key)
                if isinstance(result, FailedRun):
                    self._failed[key] = result
                yield result

    def _made_now(
        self, items: Sequence[RunItem], check: Callable[[], None]
    ) -> Generator[Answered[Any], None, None]:
        """Make runs; the log has each when its answer comes."""
        if self._begin is None or not items:
            threads = WaitingThreads(self.at_once, self._make, check=check, end=self.end)
            with closing(threads.run(items)) as answers:
                yield from answers
            return
        check()
        self._there = self._there or self._begin(check)
        for answer in self._there.run(items):
            item = items[answer.number]
            if answer.value is not None:
                self._keep(item, answer.value)
            elif answer.set_aside:
                failed = CompletedRun(FailedRun(answer.why_set_aside), answer.seconds)
                self._log.add(item.key, failed, item.values)
            yield answer

    def _make(self, item: RunItem) -> None:
        made = self.completed(item)
        if made is not None:
            self._log.add(item.key, made, item.values)

    def _keep(self, item: RunItem, remote: RemoteRun) -> None:
        """Keep a run that was made on another machine.

        Raises:
            OutputError: it cannot be written.
        """
        if remote.run is None:
            return
        result = remote.run.result
        if isinstance(result, FailedRun) and result.folder:
            result = replace(result, folder=str(self._folder / Path(result.folder).name))
        keep_runs(remote.left, self._folder)
        self._log.add(item.key, replace(remote.run, result=result), item.values)

    def completed(self, item: RunItem) -> CompletedRun | None:
        """Make a run; None where runs were ended meanwhile.

        Raises:
            InputError: a file of the model has changed, before it or meanwhile.
            OutputError: the run cannot be written.
        """
        if self._ended:
            return None
        began = time.monotonic()
        self._files.require_unchanged()
        result = self.compute(item)
        self._files.require_unchanged()
        return None if self._ended else CompletedRun(result, time.monotonic() - began)

    def end(self) -> None:
        """End the runs that are being made, and begin no more."""
        self._ended = True
        self.end_running()

    def begin_again(self) -> None:
        """Runs may be made again after they were ended."""
        self._ended = False


def run_maker(runs: LoggedRuns, folder: Path) -> Callable[[RunItem], RemoteRun]:
    """In a process far away: what makes a run, and takes what it leaves.

    Args:
        runs: of the model, there.
        folder: of the runs, there.
    """
    begin_there({})

    def make(item: RunItem) -> RemoteRun:
        runs.begin_again()
        run: CompletedRun | None = None
        with runs_there(folder) as left, suppress(Interrupted):
            threads = WaitingThreads(1, runs.completed, check=STOP.check, end=runs.end)
            (answer,) = threads.run([item])
            run = answer.value
        for name in {Path(file).parts[0] for file in left.files}:
            shutil.rmtree(folder / name, ignore_errors=True)
            (folder / name).mkdir(exist_ok=True)  # so that no other run has its name
        return RemoteRun(run, left)

    return make

"""Runs of a function of Python, each call in a process that may end without us."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from geoident.forward.external.runs import FailedRun
from geoident.io.text.wording import shorten
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Case
from geoident.model.external import PythonFunction
from geoident.workflow.executing.executor import SetUp
from geoident.workflow.executing.parcel import relative
from geoident.workflow.programs.digest import ModelFiles, names_of
from geoident.workflow.programs.function_process import FunctionProcess
from geoident.workflow.programs.logged_runs import LoggedRuns, RemoteRun, RunItem, run_maker
from geoident.workflow.programs.program import executed
from geoident.workflow.programs.trust import Execution


class FunctionRuns(LoggedRuns):
    """Runs of the function of a case.

    Args:
        case: the case.
        function: of the case.
        folder: of the runs.
        again: runs that failed before are made again.
    """

    def __init__(
        self, case: Case, function: PythonFunction, folder: Path, *, again: bool = False
    ) -> None:
        self._free: list[FunctionProcess] = []
        self._busy: set[FunctionProcess] = set()
        self._function = function
        tied = {
            scalar.parameter
            for channel in case.channels
            for scalar in (channel.ratio, channel.offset, channel.drift, channel.drift_per_stage)
            if scalar is not None
        }
        names = [parameter.name for parameter in case.parameters]
        self.seen: Bools = np.array([name not in tied for name in names], dtype=bool)
        self.provided: Bools = np.ones((len(case.stages), len(case.channels)), dtype=bool)
        channels = [channel.name for channel in case.channels]
        texts = [function.name, function.jacobian, repr(case.stage_names), repr(channels)]
        texts.append(repr(names_of(function, Path(function.path).parent)))
        files = ModelFiles(function.inputs)
        digest = files.digest(texts, function.inputs)
        execution = Execution(executed(function), digest, digest)
        super().__init__(case, function, folder, files=files, execution=execution, again=again)

    @property
    def has_jacobian(self) -> bool:
        """Whether the case names a function of derivatives."""
        return bool(self._function.jacobian)

    def written(self, p: Floats) -> Floats:
        """The parameters (n,) with all their digits."""
        return p

    def quantum(self, p: Floats) -> Floats:
        """(n,) one rounding of a double."""
        return np.asarray(2.3e-16 * np.abs(p))  # eps is 2.22e-16

    def each(
        self, points: Sequence[Floats], check: Callable[[], None]
    ) -> Iterator[Floats | FailedRun]:
        """Readings (n_stages, n_channels) in turn, each as it is there; runs go on meanwhile.

        Args:
            points: (n,) where.
            check: see `ModelRuns.each`.
        """
        return self._each(points, self._function.name, check)

    def jacobian(self, p: Floats, check: Callable[[], None]) -> Floats | FailedRun:
        """Derivatives (n_stages, n_channels, n) at p (n,), those by offsets and drifts 0.

        Args:
            p: (n,) where.
            check: see `ModelRuns.each`.
        """
        return next(self._each([p], self._function.jacobian, check))

    def _each(
        self, points: Sequence[Floats], name: str, check: Callable[[], None]
    ) -> Iterator[Floats | FailedRun]:
        asked: list[tuple[str, RunItem | FailedRun]] = []
        for p in points:
            seen = zip(self._names, p, self.seen, strict=True)
            values = {n: float(x) for n, x, s in seen if s}
            key = f"{name} {sorted((n, x.hex()) for n, x in values.items())}"
            asked.append((key, RunItem(key, name, values)))
        return self.in_turn(asked, check)

    def portable(self) -> tuple[SetUp[RunItem, RemoteRun], tuple[str, ...], tuple[str, ...]]:
        """What makes runs in another process, files that it needs, and no program."""
        function = self._function
        portable = replace(
            function, path=relative(function.path), files=tuple(map(relative, function.files))
        )
        set_up = partial(set_up_function, self._case, portable, relative(str(self._folder)))
        return set_up, function.inputs, ()

    def compute(self, item: RunItem) -> Floats | FailedRun:
        """Call the function: readings (n_stages, n_channels), or derivatives (..., n)."""
        with self._lock:
            process = self._free.pop() if self._free else None
            process = process or FunctionProcess(self._function.machine.time_limit, self._printed())
            self._busy.add(process)
        function, name = self._function, item.argument
        values = dict(item.values)
        answer = process.call(function.path, name, (values,), self._readable)
        with self._lock:
            self._busy.discard(process)
            if not process.ended:
                self._free.append(process)
        if isinstance(answer, FailedRun):
            return answer
        return self._derivatives(answer) if name == function.jacobian else self._table(answer)

    def _printed(self) -> Path | None:
        """The file that takes what the function prints; None where there can be none."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            return None
        return self._folder / "printed.txt"

    def _table(self, answer: Any) -> Floats | FailedRun:
        """Readings (n_stages, n_channels) of what the function gave."""
        stages, channels = self.provided.shape
        if isinstance(answer, Mapping):
            answer = self._of_mapping(answer)
            if isinstance(answer, FailedRun):
                return answer
        try:
            table = np.asarray(answer, dtype=np.float64)
        except (TypeError, ValueError):
            return FailedRun(f"the function gave no numbers: {shorten(repr(answer))}")
        if table.shape == (channels,) and stages == 1:
            table = table[:, None]
        if table.shape != (channels, stages):
            shape = " x ".join(map(str, table.shape)) or "one number"
            return FailedRun(
                f"the function gave {shape}; gauges x stages, {channels} x {stages}, is expected"
            )
        return self._finite(table.T)

    def _of_mapping(self, answer: Mapping[Any, Any]) -> list[list[Any]] | FailedRun:
        stages = [stage.name for stage in self._case.stages]
        rows = []
        for channel in self._case.channels:
            if channel.name not in answer:
                return FailedRun(f"the function gave no reading of '{channel.name}'")
            row = answer[channel.name]
            if isinstance(row, Mapping):
                missing = [stage for stage in stages if stage not in row]
                if missing:
                    return FailedRun(
                        f"the function gave no reading of '{channel.name}' at '{missing[0]}'"
                    )
                row = [row[stage] for stage in stages]
            rows.append(list(np.ravel(row)))
        return rows

    def _finite(self, table: Floats) -> Floats | FailedRun:
        wrong = np.argwhere(~np.isfinite(table))
        if not len(wrong):
            return np.ascontiguousarray(table)
        stage, channel = wrong[0][:2].tolist()
        names = self._case.channels[channel].name, self._case.stages[stage].name
        value = float(table[tuple(wrong[0])])
        return FailedRun(f"the function gave {value} for '{names[0]}' at '{names[1]}'")

    def _derivatives(self, answer: Any) -> Floats | FailedRun:
        """(n_stages, n_channels, n) of what the function of derivatives gave."""
        stages, channels = self.provided.shape
        wanted = (channels, stages, int(self.seen.sum()))
        try:
            table = np.asarray(answer, dtype=np.float64)
        except (TypeError, ValueError):
            return FailedRun(f"the derivatives are no numbers: {shorten(repr(answer))}")
        if stages == 1 and table.shape == (channels, wanted[2]):
            table = table[:, None, :]
        if table.shape != wanted:
            shape, expected = (" x ".join(map(str, one)) for one in (table.shape, wanted))
            return FailedRun(
                f"the derivatives are {shape}; gauges x stages x parameters, {expected}, is "
                "expected"
            )
        derivatives = self._finite(table.swapaxes(0, 1))
        if isinstance(derivatives, FailedRun):
            return derivatives
        result = np.zeros((stages, channels, len(self._names)))
        result[..., self.seen] = derivatives
        return result

    def end_running(self) -> None:
        """End the calls that are made."""
        with self._lock:
            busy = tuple(self._busy)
        for process in busy:
            process.end()

    def __del__(self) -> None:
        for process in self._free:
            process.end()


def set_up_function(
    case: Case, function: PythonFunction, folder: str
) -> Callable[[RunItem], RemoteRun]:
    """In a process far away: what calls a function.

    Args:
        case: the case.
        function: of the case.
        folder: of the runs.
    """
    return run_maker(FunctionRuns(case, function, Path(folder)), Path(folder))

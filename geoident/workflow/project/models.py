"""The models of all sections, asked at once through an executor, and never twice for the same."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import TracebackType

import numpy as np

from geoident.errors import ExitCode, InputError, Interrupted, ModelError
from geoident.forward.observed import ObservedModel
from geoident.model.arrays import Floats
from geoident.model.project.project import Project
from geoident.model.results.costs import NO_COST, Counts
from geoident.workflow.executing.executor import Answered, BegunExecutor, usable_cores
from geoident.workflow.executing.parcel import packed, relative
from geoident.workflow.executing.processes import LocalProcesses
from geoident.workflow.programs.workplace import OnCluster
from geoident.workflow.project.sections import (
    EVALUATE,
    PREPARE,
    SHARPEN,
    SHOWN,
    STEPS,
    PreparedSection,
    SectionAnswer,
    SectionsInProcess,
    SectionSources,
    SectionTask,
    set_up_sections,
)
from geoident.workflow.running.control import Control
from geoident.workflow.running.evaluation_log import Log
from geoident.workflow.running.jobs import Inputs
from geoident.workflow.running.run_table import placed
from geoident.workflow.running.workers import runs_on_cluster


class OneProcess:
    """Computes the tasks here, one after the other; new runs of programs on a cluster, if given.

    Args:
        sources: of the sections.
        control: of the command.
    """

    def __init__(self, sources: SectionSources, control: Control) -> None:
        self._begun = ExitStack()

        def begin(model: ObservedModel) -> None:
            self._begun.enter_context(runs_on_cluster(model, control))

        self._answer = SectionsInProcess(sources, control.stop, begin)
        self._stop = control.stop

    def __enter__(self) -> OneProcess:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End what runs programs elsewhere."""
        self._begun.__exit__(kind, error, trace)

    def ask_to_stop(self) -> None:
        """Nothing runs beside who asks."""

    def run(self, tasks: Iterable[SectionTask]) -> Iterator[Answered[SectionAnswer]]:
        """The answers in the order of the tasks."""
        for number, task in enumerate(tasks):
            self._stop.check()
            yield Answered(number, self._answer(task))


SectionExecutor = OneProcess | BegunExecutor[SectionTask, SectionAnswer]
"""What computes tasks of sections; a context."""


def section_executor(
    sources: SectionSources, inputs: Sequence[Inputs], control: Control, *, jobs: int | None
) -> SectionExecutor:
    """What computes the sections: workers of a cluster, processes of this machine, or this one.

    Sections that run programs share one log of runs, which is kept here: their runs alone travel.

    Args:
        sources: of the sections.
        inputs: the case of each.
        control: of the command.
        jobs: number of processes; None for the cores there are.
    """
    elsewhere = any(one.case.elsewhere is not None for one in inputs)
    if control.cluster is not None and not elsewhere:
        return _on(control.cluster, sources, inputs, control)
    count = min(jobs or usable_cores(), len(sources.sections))
    formulas = all(one.loaded.mesh_path is None for one in inputs)  # sooner than a process starts
    if elsewhere or formulas or count == 1:
        return OneProcess(sources, control)
    return LocalProcesses[SectionTask, SectionAnswer](count, partial(set_up_sections, sources))


def _on(
    cluster: OnCluster, sources: SectionSources, inputs: Sequence[Inputs], control: Control
) -> BegunExecutor[SectionTask, SectionAnswer]:
    """Workers of a cluster, to which all files of the cases travel.

    Own fits of sections leave their checkpoints there, in folders that go with the workers.
    """
    files = tuple(dict.fromkeys(path for one in inputs for path in one.files))
    portable = replace(
        sources,
        sections=tuple(replace(one, case=relative(one.case)) for one in sources.sections),
        checkpoint=Path(sources.checkpoint.name),
    )
    return cluster.begin(
        partial(set_up_sections, portable), packed(files), check=control.stop.check
    )


class SectionAnswers:
    """All sections of a project as `geoident.identify.hierarchical` asks them.

    What was evaluated is kept in a log, from which an interrupted run goes on.

    Args:
        executor: computes the tasks.
        log: of evaluations.
        control: is told of the progress; stops the run.
        project: with the sections.
    """

    def __init__(
        self, executor: SectionExecutor, log: Log, control: Control, project: Project
    ) -> None:
        self._executor, self._log, self._control = executor, log, control
        self._project = project
        self._names = tuple(section.name for section in project.sections)
        self._known: dict[tuple[str, int, bytes], tuple[Floats, Floats]] = {}
        self._counts = NO_COST

    @property
    def counts(self) -> Counts:
        """Costs so far."""
        return self._counts

    def prepared(self) -> tuple[PreparedSection, ...]:
        """All sections after their own fits.

        Raises:
            InputError, ModelError: the first section that cannot be set up or fitted says why.
        """
        numbers = range(len(self._names))
        prepared: dict[int, PreparedSection] = {}

        def take(number: int, answer: SectionAnswer) -> None:
            if isinstance(answer.error, InputError):
                section = self._project.sections[number]
                raise InputError(placed(fault, section) for fault in answer.error.faults)
            if answer.error is not None:
                raise answer.error
            assert answer.prepared is not None
            prepared[number] = answer.prepared
            words = f"{len(prepared)} of {len(self._names)} sections fitted one by one"
            self._control.monitor.part(words, len(prepared) / len(self._names))

        self._run([SectionTask(n, PREPARE) for n in numbers], take)
        return tuple(prepared[n] for n in numbers)

    def evaluate(self, points: Mapping[int, Floats]) -> Mapping[int, tuple[Floats, Floats]]:
        """Readings (g,) of some sections and their exact Jacobians (g, n).

        Raises:
            ModelError: one of them has no solution.
        """
        answers = self._answers(list(points.items()), EVALUATE)
        missing = [n for n, one in zip(points, answers, strict=True) if one is None]
        if missing:
            named = ", ".join(self._names[n] for n in missing)
            raise ModelError(f"The model has no solution for {named}.")
        return {n: one for n, one in zip(points, answers, strict=True) if one is not None}

    def sharpen(self, points: Mapping[int, Floats]) -> bool:
        """Make Jacobians that are differences better at points (n,); whether any were not exact."""
        order, sharper = list(points.items()), []

        def take(number: int, answer: SectionAnswer) -> None:
            if answer.sharper:
                sharper.append(order[number])

        self._run([SectionTask(n, SHARPEN, p) for n, p in order], take)
        self._computed(sharper, EVALUATE)
        return bool(sharper)

    def shown(self, points: Sequence[tuple[int, Floats]]) -> list[tuple[Floats, Floats] | None]:
        """All readings (g,) that are shown, with Jacobians (g, n); None without a solution.

        Args:
            points: numbers of sections and their parameters (n,), SI.
        """
        return self._answers(points, SHOWN)

    def steps(self, n: int, p: Floats) -> tuple[Floats, Floats]:
        """Steps and floors (g, n_states) of the model error of all readings that are shown.

        Args:
            n: number of the section.
            p: (n,) its parameters, SI, at which it has a solution.
        """
        (answer,) = self._answers([(n, p)], STEPS)
        if answer is None:
            raise ModelError(f"The model has no solution for {self._names[n]}.")
        return answer

    def _answers(
        self, points: Sequence[tuple[int, Floats]], what: str
    ) -> list[tuple[Floats, Floats] | None]:
        """Readings (g,) and Jacobians (g, n) at points; None where there is no solution.

        Args:
            points: numbers of sections and their parameters (n,), SI.
            what: `EVALUATE`, `SHOWN` or `STEPS`.
        """
        left = []
        for n, p in points:
            if (key := (what, n, p.tobytes())) in self._known:
                continue
            if (kept := self._log.find(f"{what} {n}", p)) is not None:
                self._known[key] = np.asarray(kept["v"]), np.asarray(kept["J"])
            else:
                left.append((n, p))
        self._computed(left, what)
        return [self._known.get((what, n, p.tobytes())) for n, p in points]

    def _computed(self, points: Sequence[tuple[int, Floats]], what: str) -> None:
        """Have answers computed, and keep those that there are."""

        def take(number: int, answer: SectionAnswer) -> None:
            section, p = points[number]
            if answer.error is None:
                self._known[what, section, p.tobytes()] = answer.v, answer.J
                self._log.add(f"{what} {section}", p, {"v": answer.v, "J": answer.J})
            elif not isinstance(answer.error, ModelError):
                raise answer.error

        self._run([SectionTask(n, what, p) for n, p in points], take)

    def _run(
        self, tasks: Sequence[SectionTask], take: Callable[[int, SectionAnswer], None]
    ) -> None:
        """Have tasks computed; `take` is given their numbers and answers.

        Raises:
            Interrupted: a stop was asked for.
            ModelError: a process was lost over one again and again.
        """
        if not tasks:
            return
        self._control.stop.check()
        for answer in self._executor.run(tasks):
            self._control.stop.check()
            if answer.value is None:
                if answer.stopped:
                    raise Interrupted("Interrupted.", exit_code=ExitCode.TERMINATED)
                name = self._names[tasks[answer.number].number]
                why = answer.losses[-1] if answer.losses else "gave no answer"
                raise ModelError(
                    f"{name}: its process was lost {len(answer.losses)} times; the last one {why}."
                )
            self._counts = self._counts + answer.value.counts
            take(answer.number, answer.value)


class ChosenSections:
    """Some of the sections, numbered from 0, as the search for these asks them.

    Args:
        models: of all.
        numbers: of those that are chosen.
    """

    def __init__(self, models: SectionAnswers, numbers: Sequence[int]) -> None:
        self._models, self._numbers = models, tuple(numbers)

    @property
    def counts(self) -> Counts:
        """Costs so far, of all."""
        return self._models.counts

    def evaluate(self, points: Mapping[int, Floats]) -> Mapping[int, tuple[Floats, Floats]]:
        """Readings (g,) of some sections and their exact Jacobians (g, n)."""
        answers = self._models.evaluate({self._numbers[k]: p for k, p in points.items()})
        return {k: answers[self._numbers[k]] for k in points}

    def sharpen(self, points: Mapping[int, Floats]) -> bool:
        """Make Jacobians that are differences better at points (n,); whether any were not exact."""
        return self._models.sharpen({self._numbers[k]: p for k, p in points.items()})

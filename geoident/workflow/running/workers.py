"""Processes that have the model of a command, and work on parts of its search (`ahead`).

A model travels by what it consists of, case and mesh, and is built once in each process: no file is
read again, which might be another one meanwhile, and none need be there. What comes back are
evaluations as the log of a run keeps them, with what each has cost; so the search itself, its
counts and its checkpoint are those of a run without processes.
"""

from __future__ import annotations

import os
from collections.abc import Generator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from math import inf
from types import TracebackType
from typing import Self

from geoident.fem.solvers import pick_solver
from geoident.forward.external.program import ProgramModel
from geoident.forward.model import StagedModel, staged_model
from geoident.forward.observed import ObservedModel
from geoident.forward.openings.model import OpeningModel, opening_model
from geoident.identify.problem.ahead import ReadingsAt, SearchTask
from geoident.model.case import Case
from geoident.model.mesh import Mesh
from geoident.workflow.executing.executor import Answered, BegunExecutor, SetUp, usable_cores
from geoident.workflow.executing.processes import LocalProcesses
from geoident.workflow.programs.logged_runs import LoggedRuns
from geoident.workflow.running.control import Control
from geoident.workflow.running.cost import estimate_cost
from geoident.workflow.running.evaluation_log import Recording

WORTH = 10.0
"""Seconds that evaluations must take together, by an estimate, for processes to be started for them
that nobody has asked for: each takes a second or two to begin."""

_DESCENT = 6
"""Evaluations of a part that is no list of points, about."""

_AT_LEAST = 2
"""Parts of a search that a cluster is thought to work on at a time before its workers are known."""

_MEMORY = 0.7
"""Part of the memory of the machine that processes may take which nobody has asked for."""


@dataclass(frozen=True)
class ModelParts:
    """What a model consists of: all that another process needs.

    Args:
        case: of the model.
        mesh: that it was given; None for a closed form.
        solver: name of the sparse solver, or ``auto``.
    """

    case: Case
    mesh: Mesh | None
    solver: str

    @classmethod
    def of(cls, model: ObservedModel, case: Case, solver: str) -> ModelParts | None:
        """Those of a model; None where it cannot be built elsewhere.

        Args:
            model: of the case.
            case: as it was given, without modes of fields.
            solver: name of the sparse solver, or ``auto``.
        """
        if isinstance(model, StagedModel):
            return cls(case, model.on_mesh.given or model.mesh, solver)
        return cls(case, None, solver) if isinstance(model, OpeningModel) else None

    def build(self) -> StagedModel | OpeningModel:
        """The model; the same errors as where it was built first."""
        if self.mesh is None:
            return opening_model(self.case)
        return staged_model(self.mesh, self.case, solver=pick_solver(self.solver))


@dataclass(frozen=True)
class SearchPartTask:
    """A part of a search for another process.

    Args:
        search: the part.
        pairs: channel and stage of the readings of the response.
        times: when each was read.
        seconds: for which it may take, or None.
    """

    search: SearchTask
    pairs: tuple[tuple[str, str], ...]
    times: tuple[float | None, ...]
    seconds: float | None


class ModelWorkers:
    """Processes that have the model of a command; a context, at whose end none is left.

    They are on this machine, or on a cluster. None is started before there is something to do.

    Args:
        set_up: builds the model in a process, and gives what evaluates parts of a search with it.
        control: of the command; says how many processes there may be, or on which cluster.
        model: in this process, which tells what an evaluation costs.
        solver: name of the sparse solver, or ``auto``.
    """

    def __init__(
        self,
        set_up: SetUp[SearchPartTask, Recording],
        control: Control,
        model: ObservedModel,
        solver: str,
    ) -> None:
        self._set_up, self._control, self._model, self._solver = set_up, control, model, solver
        self._executor: BegunExecutor[SearchPartTask, Recording] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        executor, self._executor = self._executor, None
        if executor is not None:
            executor.__exit__(kind, error, trace)

    def at_once(self, tasks: Sequence[SearchTask] = ()) -> int:
        """How many processes work on parts of a search; 1 for this one alone.

        Args:
            tasks: the parts; none for as many as there may be.
        """
        if self._control.cluster is not None:  # begun with the first parts, not by this question
            return max(_AT_LEAST, 0 if self._executor is None else self._executor.workers)
        if self._control.jobs is not None:
            return self._control.jobs
        evaluations = sum(
            len(task.points) if isinstance(task, ReadingsAt) else _DESCENT for task in tasks
        )
        return worthwhile_processes(self._model, self._solver, evaluations if tasks else inf)

    def evaluate_ahead(
        self,
        tasks: Sequence[SearchTask],
        pairs: Sequence[tuple[str, str]],
        times: Sequence[float | None],
    ) -> Generator[Answered[Recording], None, None]:
        """What parts of a search have evaluated, as it comes, in any order.

        Args:
            tasks: the parts, of which the first begin first.
            pairs: channel and stage of the readings of the response.
            times: when each was read.
        """
        control = self._control
        sent = (
            SearchPartTask(task, tuple(pairs), tuple(times), control.remaining()) for task in tasks
        )
        if self._executor is None:
            if control.cluster is not None:
                self._executor = control.cluster.begin(self._set_up).__enter__()
            else:
                self._executor = LocalProcesses(self.at_once(tasks), self._set_up).__enter__()
        with control.stop.heard_by(self._executor.ask_to_stop):
            yield from self._executor.run(sent)

    @property
    def stopping(self) -> bool:
        """Whether a stop was wished."""
        return self._control.stop.exit_code is not None


def worthwhile_processes(model: ObservedModel, solver: str, evaluations: float) -> int:
    """How many processes save time, for the cores and the memory that there are.

    Args:
        model: of a case.
        solver: name of the sparse solver, or ``auto``.
        evaluations: that there will be, about.
    """
    if not isinstance(model, StagedModel):
        return 1
    cost = estimate_cost(model, solver=solver, rough=True)
    if evaluations * cost.seconds < WORTH:
        return 1
    return max(1, min(usable_cores(), int(_MEMORY * _memory() / cost.memory)))


def runs_on_cluster(model: ObservedModel, control: Control) -> AbstractContextManager[None]:
    """Meanwhile new runs of a model elsewhere are made on the cluster of a command, if it has one.

    Args:
        model: of a case.
        control: of the command.
    """
    runs = model.runs if isinstance(model, ProgramModel) else None
    if control.cluster is None or not isinstance(runs, LoggedRuns):
        return nullcontext()
    return runs.on_cluster(control.cluster, control.stop)


def _memory() -> float:
    """Bytes of memory of this machine."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):  # not on every system
        return 8e9

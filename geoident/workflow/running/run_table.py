"""The way of a run, from a row of a run table to its result.

A row (`model.run.Run`) is a case and what is put in place of its values: a variation of a campaign,
a section of a project; a single case is a row whose settings stand on the command line.

    file to rows     `io.campaign`, `io.project`, both by `io.schema.run_file`: settings, and where
                     each is written; `campaign.sampling` expands samplings
    row to case      `jobs.load_inputs`; `read_each` here says what is wrong where it is written
    case to job      `jobs.plan_fit` and others, `campaign.plan`, `project.plan`: a hash of all that
                     the result depends on, and what stands in its place
    job to result    `fit`, `scan`, `backtest`, `project.run`; `estimating.finished` has the log
                     that an interrupted run goes on from, and keeps results of earlier input
    many at a time   `executing.executor.Executor`: a row whose process is lost is begun again, goes
                     on from its log, and is set aside when it has cost several processes
    once more        the same command passes over what is done: a case by the hash in its result, a
                     run of a campaign by that in the journal (`io.result.campaign.RunJournal`)

Not rows: the fits of a backtest, of a leave-one-out and of several starts change no case. They are
searches in one model that is set up, each begun where another ended. The models of a ladder are
cases of their own, one after the other, since each begins where the simpler ones ended.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TypeVar

from geoident.errors import Fault, InputError
from geoident.io.text.faults import OVERRIDES, shortened
from geoident.io.text.overrides import parse_path
from geoident.model.case import format_path
from geoident.model.run import Run

AnyRun = TypeVar("AnyRun", bound=Run)
R = TypeVar("R")


def read_each(
    runs: Iterable[AnyRun], read: Callable[[AnyRun], R]
) -> tuple[list[tuple[AnyRun, R]], list[Fault]]:
    """The runs whose cases are right with what is made of them, and the faults of the others.

    Args:
        runs: rows.
        read: makes something of a row, such as its case; raises InputError.
    """
    right: list[tuple[AnyRun, R]] = []
    faults: list[Fault] = []
    for run in runs:
        try:
            right.append((run, read(run)))
        except InputError as error:
            faults += [placed(fault, run) for fault in error.faults]
    return right, faults


def placed(fault: Fault, run: Run) -> Fault:
    """A fault of the case of a run where it is written: at the setting that it comes from, if any.

    Args:
        fault: of the case, with the settings.
        run: with the places of its settings.
    """
    set_here = fault.location.file == OVERRIDES
    for (path, _), place in reversed(list(zip(run.settings, run.places, strict=True))):
        own = format_path(parse_path(path))
        encloses = fault.path and own.startswith((f"{fault.path}.", f"{fault.path}["))
        if encloses or (set_here and fault.path.startswith(own)):
            return replace(fault, location=place)
    return replace(fault, location=run.place) if set_here else fault


def in_order(faults: Iterable[Fault]) -> list[Fault]:
    """Faults of several files, each once, in the order of the files."""
    once = {(fault.code, fault.message, fault.location): fault for fault in faults}
    return shortened(
        sorted(once.values(), key=lambda f: (f.location.file, f.location.line, f.location.column))
    )

"""Rows of a run table: their cases, what is wrong with them and where, and how rows are lost."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TypeVar

from geoident.errors import Fault, InputError
from geoident.io.text.faults import OVERRIDES, shortened
from geoident.io.text.overrides import parse_path
from geoident.model.case import format_path
from geoident.model.run import Run
from geoident.workflow.executing.executor import Answered

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


def lost_words(answer: Answered[R]) -> str:
    """Why a run has no outcome whose processes were lost, again and again."""
    return f"it has cost {len(answer.losses)} processes, and the last one {answer.losses[-1]}"

"""What all calls share: errors that speak Python, progress, packages installed on demand."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import wraps
from importlib import import_module
from typing import Any, ParamSpec, TypeVar

from geoident.errors import Caller, GeoidentError, MissingExtra, UsageError
from geoident.model.results.result import Iteration
from geoident.workflow.programs.workplace import on_cluster
from geoident.workflow.running.control import Control, Monitor

AnyPath = str | os.PathLike[str]
Progress = Callable[[Iteration], None]
"""Is told of every iteration of a search."""

_Given = ParamSpec("_Given")
_Returned = TypeVar("_Returned")


def spoken(function: Callable[_Given, _Returned]) -> Callable[_Given, _Returned]:
    """A function whose errors name arguments (``force=True``), not flags of a command."""

    @wraps(function)
    def speaking(*args: _Given.args, **given: _Given.kwargs) -> _Returned:
        try:
            return function(*args, **given)
        except GeoidentError as error:
            error.tell(Caller.PYTHON)
            # where in geoident it was found, and what it was before, is of no use to who calls
            raise error.with_traceback(None) from None

    return speaking


def needed(package: str, *, extra: str, what: str) -> Any:
    """A package that comes with an extra of the installation.

    Args:
        package: its name.
        extra: of geoident, which brings it.
        what: needs it.

    Raises:
        MissingExtra: it is not installed; says how to install it.
    """
    try:
        return import_module(package)
    except ModuleNotFoundError as error:
        if error.name != package:
            raise
        msg = f'{what} needs {package}: pip install "geoident[{extra}]"'
        raise MissingExtra(msg, name=package) from error


def control(
    progress: Progress | None = None,
    max_time: float | None = None,
    jobs: int | None = 1,
    cluster: AnyPath | None = None,
) -> Control:
    """What a running call reports to and obeys.

    Args:
        progress: is told of every iteration.
        max_time: seconds after which a search ends with what it has.
        jobs: number of processes; None for all cores, where that saves time.
        cluster: address of a scheduler of dask, ``local``, or the path of a cluster file.

    Raises:
        InputError: there is no such cluster.
        MissingExtra: dask is not installed.
        UsageError: there is no such number of processes.
    """
    telling, at_once = _Telling(progress), processes(jobs)
    named = None if cluster is None else os.fspath(cluster)
    place = on_cluster(named, at_once, telling.inform)
    return Control(telling, max_time=max_time, jobs=at_once, cluster=place)


def processes(jobs: int | None) -> int | None:
    """A number of processes that was asked for; None for the cores there are.

    Raises:
        UsageError: it is no number from 1 on.
    """
    if jobs is not None and (isinstance(jobs, bool) or not isinstance(jobs, int) or jobs < 1):
        raise UsageError(f"jobs is {jobs!r}: give a whole number from 1 on, or None for all cores.")
    return jobs


@dataclass(frozen=True)
class _Telling(Monitor):
    """Passes iterations on, and warnings as those of Python."""

    progress: Progress | None = field(repr=False, default=None)

    def step(self, iteration: Iteration) -> None:
        """Pass it on."""
        if self.progress is not None:
            self.progress(iteration)

    def warn(self, message: str) -> None:
        """Warn of it."""
        warnings.warn(message, stacklevel=2)

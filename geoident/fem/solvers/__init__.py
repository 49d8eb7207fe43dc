"""Sparse direct solvers behind one protocol, and the choice among those that are installed."""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version

from geoident.errors import UsageError
from geoident.fem.solvers.direct import Solver, SolverCounts

__all__ = ["AUTO", "SOLVERS", "SolverCounts", "SolverInfo", "pick_solver", "solver_report"]

AUTO = "auto"
"""The name that leaves the choice to `pick_solver`."""

_CLASSES = {
    "cholmod": "CholmodSolver",
    "multifrontal": "MultifrontalSolver",
    "pardiso": "PardisoSolver",
    "splu": "SpluSolver",
}
_PACKAGES = {"cholmod": "cvxopt", "multifrontal": "scipy", "pardiso": "pypardiso", "splu": "scipy"}

SOLVERS = tuple(_CLASSES)
"""Names of the solvers, the best first.

In our elimination order CHOLMOD factorizes as fast as PARDISO or faster, and it gives the same
bits in every run, which several threads of PARDISO do not.
"""


@dataclass(frozen=True)
class SolverInfo:
    """What `geoident doctor` says of a solver.

    Args:
        name: name of the solver.
        available: whether it can be used here.
        version: package and version that it comes from; empty if not installed.
        threads: threads that it may use.
        remedy: how to get it, if it is not available, with the reason.
    """

    name: str
    available: bool
    version: str
    threads: int
    remedy: str = ""


def pick_solver(name: str = AUTO) -> Solver:
    """A new solver with counts of its own.

    Args:
        name: one of `SOLVERS`, or ``auto`` for the first of them that is installed.

    Raises:
        UsageError: there is no solver of that name, or it is not installed.
    """
    if name == AUTO:
        return _first_available()
    if name not in SOLVERS:
        raise UsageError(f"unknown solver {name!r}: choose from {', '.join((AUTO, *SOLVERS))}")
    try:
        return _create(name)
    except (ImportError, OSError) as error:
        raise UsageError(_remedy(name, error)) from error


def solver_report() -> tuple[SolverInfo, ...]:
    """What can be said of every solver, the fastest first."""
    return tuple(_info(name) for name in SOLVERS)


def _first_available() -> Solver:
    for name in SOLVERS[:-1]:
        try:
            return _create(name)
        except (ImportError, OSError):  # not installed, or its shared library does not load
            continue
    return _create(SOLVERS[-1])


def _create(name: str) -> Solver:
    module = import_module(f"geoident.fem.solvers.{name}")
    solver: Solver = getattr(module, _CLASSES[name])()
    return solver


def _remedy(name: str, error: Exception) -> str:
    install = f'pip install "geoident[{name}]"'
    return f"the solver {name!r} is not installed ({error}); install it with: {install}"


def _info(name: str) -> SolverInfo:
    try:
        _create(name)
    except (ImportError, OSError) as error:
        return SolverInfo(name, False, "", 0, _remedy(name, error))
    return SolverInfo(name, True, _package(name), _threads(name))


def _package(name: str) -> str:
    package = _PACKAGES[name]
    try:
        return f"{package} {version(package)}"
    except PackageNotFoundError:
        return package


def _threads(name: str) -> int:
    """Threads that the environment grants; only MKL's solver has use for more than one."""
    if name != "pardiso":
        return 1
    for variable in ("MKL_NUM_THREADS", "OMP_NUM_THREADS"):
        if os.environ.get(variable, "").isdecimal():
            return max(1, int(os.environ[variable]))
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

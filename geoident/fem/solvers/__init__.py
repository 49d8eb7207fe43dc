"""Sparse solvers behind one protocol, and the choice among those that are installed."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version

from geoident.errors import UsageError
from geoident.fem.solvers.auto import AutoSolver
from geoident.fem.solvers.direct import Solver, SolverCounts
from geoident.fem.solvers.threads import granted_threads

__all__ = [
    "AUTO",
    "BEYOND",
    "DIRECT",
    "SOLVERS",
    "SolverCounts",
    "SolverInfo",
    "pick_solver",
    "picked",
    "solver_report",
]

AUTO = "auto"
"""The name that leaves the choice to `pick_solver`."""

DIRECT = ("pardiso", "cholmod", "splu")
"""Solvers that factorize, the fastest first; the last is always there."""

BEYOND = "iterative"
"""The solver where a factor would take too much time or memory."""

SOLVERS = (*DIRECT, BEYOND)
"""Names of the solvers."""

_CLASSES = {"pardiso": "PardisoSolver", "cholmod": "CholmodSolver", "splu": "SpluSolver"}
_PACKAGES = {"cholmod": "cvxopt", "pardiso": "pypardiso"}


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
        name: one of `SOLVERS`, or ``auto`` for the choice by what each matrix takes.

    Raises:
        UsageError: there is no solver of that name, or it is not installed.
    """
    if name == AUTO:
        counts = SolverCounts()
        return AutoSolver(_create(picked(), counts), _create(BEYOND, counts))
    if name not in SOLVERS:
        raise UsageError(f"unknown solver {name!r}: choose from {', '.join((AUTO, *SOLVERS))}")
    try:
        return _create(name)
    except (ImportError, OSError) as error:
        raise UsageError(_remedy(name, error)) from error


def solver_report() -> tuple[SolverInfo, ...]:
    """What can be said of every solver."""
    return tuple(_info(name) for name in SOLVERS)


def picked() -> str:
    """Name of the solver with which ``auto`` factorizes: the fastest that is installed."""
    for name in DIRECT[:-1]:
        try:
            _create(name)
        except (ImportError, OSError):  # not installed, or its shared library does not load
            continue
        return name
    return DIRECT[-1]


def _create(name: str, counts: SolverCounts | None = None) -> Solver:
    counts = SolverCounts() if counts is None else counts
    module = import_module(f"geoident.fem.solvers.{name}")
    if name == BEYOND:
        iterative: Solver = module.IterativeSolver(partial(_create, picked()), counts)
        return iterative
    direct: Solver = getattr(module, _CLASSES[name])(counts)
    return direct


def _remedy(name: str, error: Exception) -> str:
    install = f'pip install "geoident[{name}]"'
    return f"the solver {name!r} is not installed ({error}); install it with: {install}"


def _info(name: str) -> SolverInfo:
    try:
        _create(name)
    except (ImportError, OSError) as error:
        return SolverInfo(name, False, "", 0, _remedy(name, error))
    package = _PACKAGES.get(name, "scipy")
    with suppress(PackageNotFoundError):
        package = f"{package} {version(package)}"
    # CHOLMOD and SuperLU have use for one thread only.
    threads = granted_threads("MKL_NUM_THREADS") if name == "pardiso" else 1
    return SolverInfo(name, True, package, threads)

"""Sparse solvers behind one protocol, and the choice among those that are installed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from importlib import import_module

from geoident.errors import UsageError
from geoident.fem.solvers.auto import LARGE_WORK, NOTHING, AutoSolver, FactorSize, is_beyond
from geoident.fem.solvers.direct import Solver, SolverCounts
from geoident.fem.solvers.threads import granted_threads

__all__ = [
    "AUTO",
    "BEYOND",
    "LARGE",
    "SMALL",
    "SOLVERS",
    "SolverCounts",
    "SolverInfo",
    "pick_solver",
    "picked",
    "solver_report",
]

AUTO = "auto"
"""The name that leaves the choice to `pick_solver`."""

_CLASSES = {
    "cholmod": "CholmodSolver",
    "iterative": "IterativeSolver",
    "multifrontal": "MultifrontalSolver",
    "pardiso": "PardisoSolver",
    "splu": "SpluSolver",
}
_PACKAGES = {"cholmod": "cvxopt", "pardiso": "pypardiso"}

SOLVERS = tuple(_CLASSES)
"""Names of the solvers.

In our elimination order CHOLMOD factorizes small matrices faster than PARDISO, and it gives the
same bits in every run, which several threads of PARDISO do not. Large matrices, and stages that
have most of their ground in common, are for our own solver.
"""

LARGE = "multifrontal"
"""The solver of large matrices, and of small ones where neither of `SMALL` is installed."""

BEYOND = "iterative"
"""The solver where a factor would take too much time or memory."""

SMALL = ("cholmod", "pardiso")
"""Solvers of small matrices, the best first."""


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
        name: one of `SOLVERS`, or ``auto`` for the choice by the work that a matrix takes.

    Raises:
        UsageError: there is no solver of that name, or it is not installed.
    """
    if name == AUTO:
        small = picked()
        return AutoSolver(*(partial(_create, kind) for kind in (small, LARGE, BEYOND)))
    if name not in SOLVERS:
        raise UsageError(f"unknown solver {name!r}: choose from {', '.join((AUTO, *SOLVERS))}")
    try:
        return _create(name)
    except (ImportError, OSError) as error:
        raise UsageError(_remedy(name, error)) from error


def solver_report() -> tuple[SolverInfo, ...]:
    """What can be said of every solver."""
    return tuple(_info(name) for name in SOLVERS)


def picked(size: FactorSize = NOTHING) -> str:
    """Name of the solver that ``auto`` takes.

    Args:
        size: of the matrix.
    """
    if is_beyond(size):
        return BEYOND
    if size.lasting or size.work >= LARGE_WORK:
        return LARGE
    for name in SMALL:
        try:
            _create(name)
        except (ImportError, OSError):  # not installed, or its shared library does not load
            continue
        return name
    return LARGE


def _create(name: str, counts: SolverCounts | None = None) -> Solver:
    module = import_module(f"geoident.fem.solvers.{name}")
    solver: Solver = getattr(module, _CLASSES[name])(counts)
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
    from importlib.metadata import PackageNotFoundError, version  # noqa: PLC0415 - for reports

    package = _PACKAGES.get(name, "scipy")
    try:
        return f"{package} {version(package)}"
    except PackageNotFoundError:
        return package


def _threads(name: str) -> int:
    """Threads that the environment grants; CHOLMOD and SuperLU have use for one only."""
    if name == "pardiso":
        return granted_threads("MKL_NUM_THREADS")
    return granted_threads("OPENBLAS_NUM_THREADS") if name in (LARGE, BEYOND) else 1

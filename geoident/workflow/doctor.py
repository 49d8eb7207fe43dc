"""``geoident doctor``: what this installation has, and how to make it better."""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass

from geoident.fem.solvers import SolverInfo, pick_solver, solver_report
from geoident.workflow.provenance import versions

THREAD_VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")


@dataclass(frozen=True)
class Diagnosis:
    """What was found.

    Args:
        versions: of geoident, Python and the libraries.
        platform: the system.
        cores: that may be used.
        threads: variables of the environment that limit the threads.
        solvers: the sparse solvers, the fastest first.
        picked: name of the solver that ``auto`` takes.
        remedies: sentences on what to do, the most useful first.
    """

    versions: dict[str, str]
    platform: str
    cores: int
    threads: dict[str, str]
    solvers: tuple[SolverInfo, ...]
    picked: str
    remedies: tuple[str, ...]


def diagnose() -> Diagnosis:
    """Look at the installation."""
    solvers, picked = solver_report(), pick_solver().name
    return Diagnosis(
        versions=versions(),
        platform=platform.platform(),
        cores=_cores(),
        threads={name: os.environ[name] for name in THREAD_VARIABLES if name in os.environ},
        solvers=solvers,
        picked=picked,
        remedies=_remedies(solvers, picked),
    )


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _remedies(solvers: tuple[SolverInfo, ...], picked: str) -> tuple[str, ...]:
    """Remedies for the solvers that would be faster than the one that is taken."""
    names = [solver.name for solver in solvers]
    faster = solvers[: names.index(picked)] if picked in names else ()
    return tuple(solver.remedy for solver in faster if solver.remedy)

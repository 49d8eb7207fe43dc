"""``geoident doctor``: what this installation has, and how to make it better."""

from __future__ import annotations

import math
import os
import platform
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

from geoident.fem.solvers import BEYOND, DIRECT, SolverInfo, picked, solver_report
from geoident.processors import memory_limit, processors
from geoident.workflow.executing.versions import versions

EXTRAS = {
    "report": ("matplotlib", "figures and pages"),
    "ags": ("python-ags4", "readings from AGS4 files"),
    "full-space": ("casadi", "complementarity in full space"),
    "global": ("pyscipopt", "proven bounds of the misfit"),
    "notebook": ("pandas", "data frames in Python"),
    "ensemble": ("iterative_ensemble_smoother", "method ensemble-smoother"),
}
"""Extra of the installation: the package that it brings, and what for."""

THREAD_VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")


@dataclass(frozen=True)
class Extra:
    """A part that is installed on demand.

    Args:
        name: of the extra.
        package: that it brings.
        use: what it is for.
        version: of the package; empty if it is not installed.
        remedy: how to install it.
    """

    name: str
    package: str
    use: str
    version: str
    remedy: str


@dataclass(frozen=True)
class Diagnosis:
    """What was found.

    Args:
        versions: of geoident, Python and the libraries.
        platform: the system.
        cores: that may be used.
        threads: variables of the environment that limit the threads.
        solvers: the sparse solvers.
        picked: name of the solver with which ``auto`` factorizes.
        picked_beyond: of the one that it takes where a factor would take too much time or memory.
        memory: bytes that a process may take, None if the system does not say.
        remedies: sentences on what to do, the most useful first.
        extras: parts that are installed on demand.
    """

    versions: dict[str, str]
    platform: str
    cores: int
    threads: dict[str, str]
    solvers: tuple[SolverInfo, ...]
    picked: str
    remedies: tuple[str, ...]
    extras: tuple[Extra, ...] = ()
    picked_beyond: str = BEYOND
    memory: float | None = None


def diagnose() -> Diagnosis:
    """Look at the installation."""
    solvers, taken, limit = solver_report(), picked(), memory_limit()
    return Diagnosis(
        versions=versions(),
        platform=platform.platform(),
        cores=processors(),
        threads={name: os.environ[name] for name in THREAD_VARIABLES if name in os.environ},
        solvers=solvers,
        picked=taken,
        remedies=_remedies(solvers, taken),
        extras=tuple(_extra(name, *what) for name, what in EXTRAS.items()),
        memory=limit if math.isfinite(limit) else None,
    )


def _extra(name: str, package: str, use: str) -> Extra:
    try:
        installed = version(package)
    except PackageNotFoundError:
        installed = ""
    return Extra(name, package, use, installed, f'pip install "geoident[{name}]"')


def _remedies(solvers: tuple[SolverInfo, ...], picked: str) -> tuple[str, ...]:
    """The remedy for the fastest solver, if it is not the one taken."""
    best = next(iter(DIRECT))
    return tuple(s.remedy for s in solvers if s.name == best != picked and s.remedy)

"""Sparse solvers: `pick_solver` gives one, by its name or by what a matrix takes.

The choice depends on the problem and on what is installed, never on the memory that happens to be
free: so a case takes the same way on every computer with the same solvers.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version

import scipy.sparse as sp

from geoident.errors import UsageError
from geoident.fem.solvers.direct import LowerPattern, SolverCounts, SymbolicFactorization
from geoident.fem.solvers.factor_cost import FactorCost, factor_cost
from geoident.fem.solvers.iterative import IterativeFactorization
from geoident.fem.solvers.kept_solutions import KeptSolutions, SolutionStore
from geoident.fem.solvers.levels import Analyse
from geoident.fem.solvers.quasi_definite import Prepare, QuasiDefinite
from geoident.fem.solvers.splu import SpluIndefinite
from geoident.fem.solvers.threads import granted_threads
from geoident.model.arrays import Floats, Ints

AUTO = "auto"
"""The name that leaves the choice to `pick_solver`."""

DIRECT = {
    "pardiso": ("PardisoFactorization", "pypardiso"),
    "cholmod": ("CholmodFactorization", "cvxopt"),
    "splu": ("SpluFactorization", "scipy"),
}
"""Solvers that factorize, the fastest first: class and package. The last is always there."""

BEYOND = "iterative"
"""The solver where a factor would take too much time or memory."""

INDEFINITE = {"pardiso": "PardisoIndefinite", "splu": "SpluIndefinite"}
"""Of them, those for quasi-definite matrices, with their classes; the last is always there."""

SOLVERS = (*DIRECT, BEYOND)
"""Names of the solvers."""

SMALL = 3_000
"""Unknowns up to which a matrix is always factorized: levels would save nothing."""

COUNTED = 50_000
"""Unknowns below which a factor is always the better way: its cost is not counted."""

ITERATED = 16 * 7 * 8 * 4.0
"""Operations of conjugate gradients for each entry of the lower triangle.

16 steps with 7 products each for 8 right-hand sides, each entry used twice.
"""

DENSE = 50.0
"""Operations on dense matrices, on two cores, in a third of the time of one of those products.

Iterations are preferred only where they are three times as fast: a factor answers
further right-hand sides sooner, and to the last digit.
"""

MOST_ENTRIES = 400_000_000
"""Entries of a factor that is made without being asked for: with them it takes some 3.5 GB."""


class Solver:
    """Prepares matrices for their solution, by a factorization or by conjugate gradients.

    Args:
        name: as users write it, such as ``cholmod``.
        direct: factorizes, and counts where it is told.
        iterates: whether to solve matrices of a pattern, with places, by conjugate gradients.
        indefinite: factorizes quasi-definite matrices.

    Attributes:
        counts: what has been done so far.
    """

    def __init__(
        self,
        name: str,
        direct: Analyse,
        iterates: Callable[[LowerPattern], bool],
        indefinite: Prepare = SpluIndefinite,
    ) -> None:
        self.name, self.counts = name, SolverCounts()
        self._indefinite = indefinite
        self._direct, self._iterates, self._kept = direct, iterates, KeptSolutions()

    def analyse(self, pattern: LowerPattern) -> SymbolicFactorization:
        """Prepare for matrices of this pattern, with at least one unknown; counts one analysis."""
        if pattern.places is not None and self._iterates(pattern):
            return IterativeFactorization(pattern, self.counts, self._direct, self._kept)
        return self._direct(pattern, self.counts)

    def quasi_definite(
        self,
        constant: sp.csr_array,
        growing: sp.csr_array,
        *,
        signs: Floats,
        order: Ints,
        changing: sp.csr_array | None = None,
    ) -> QuasiDefinite:
        """Quasi-definite matrices A_0 + h A_1 of one pattern; counts one analysis.

        Args:
            constant: A_0 (n, n).
            growing: A_1 (n, n).
            signs: (n,) of the diagonal, 1 or -1.
            order: (n,) of elimination.
            changing: (n, n) where entries may change beside theirs; None for nowhere.
        """
        return QuasiDefinite(
            constant,
            growing,
            signs=signs,
            order=order,
            prepare=self._indefinite,
            counts=self.counts,
            changing=changing,
        )

    def keep_solutions(self, store: SolutionStore | None) -> None:
        """Look up solutions by conjugate gradients in a store first, and put there what takes long.

        Args:
            store: where; None for no longer.
        """
        self._kept.store = store


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
        return _solver(name, picked(), _iterates_better)
    if name == BEYOND:
        return _solver(name, picked(), lambda pattern: pattern.n > SMALL)
    if name not in DIRECT:
        raise UsageError(f"unknown solver {name!r}: choose from {', '.join((AUTO, *SOLVERS))}")
    try:
        return _solver(name, name, lambda _: False)
    except (ImportError, OSError) as error:
        raise UsageError(_remedy(name, error)) from error


def _solver(name: str, by: str, iterates: Callable[[LowerPattern], bool]) -> Solver:
    """A solver of a name that factorizes by another one."""
    indefinite = by if by in INDEFINITE else "splu"
    prepare: Prepare = getattr(
        import_module(f"geoident.fem.solvers.{indefinite}"), INDEFINITE[indefinite]
    )
    return Solver(name, _direct(by), iterates, prepare)


def picked() -> str:
    """Name of the solver with which ``auto`` factorizes: the fastest that is installed."""
    for name in DIRECT:
        with suppress(ImportError, OSError):  # not installed, or its shared library does not load
            _direct(name)
            return name
    raise AssertionError("scipy is always installed")


def solver_report() -> tuple[SolverInfo, ...]:
    """What can be said of every solver."""
    return tuple(_info(name) for name in SOLVERS)


def is_beyond(cost: FactorCost, nonzeros: float) -> bool:
    """Whether a matrix is better solved by conjugate gradients than factorized.

    Args:
        cost: of a factorization.
        nonzeros: entries of its lower triangle.
    """
    return cost.flops > DENSE * ITERATED * nonzeros or cost.entries > MOST_ENTRIES


def _iterates_better(pattern: LowerPattern) -> bool:
    if pattern.places is None or pattern.n < COUNTED:
        return False
    return is_beyond(factor_cost(pattern, pattern.places.node), len(pattern.indices))


def _direct(name: str) -> Analyse:
    """The class of a solver that factorizes.

    Raises:
        ImportError: its package is not installed.
        OSError: it is there and does not load.
    """
    module = import_module(f"geoident.fem.solvers.{name}")
    module.load()
    factorization: Analyse = getattr(module, DIRECT[name][0])
    return factorization


def _remedy(name: str, error: Exception) -> str:
    install = f'pip install "geoident[{name}]"'
    return f"the solver {name!r} is not installed ({error}); install it with: {install}"


def _info(name: str) -> SolverInfo:
    try:
        pick_solver(name)
    except UsageError as error:
        return SolverInfo(name, False, "", 0, str(error))
    package = DIRECT.get(name, DIRECT["splu"])[1]
    with suppress(PackageNotFoundError):
        package = f"{package} {version(package)}"
    # CHOLMOD and SuperLU have use for one thread only.
    threads = granted_threads("MKL_NUM_THREADS") if name == "pardiso" else 1
    return SolverInfo(name, True, package, threads)

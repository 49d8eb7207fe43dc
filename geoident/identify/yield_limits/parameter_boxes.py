"""What a box of parameters cannot do: bounds without branching, for `global_bound`.

From lam^T s = 0 of all stages, each pair weighted with the work W it stands for, follows with
S = sym(W M) (positive semidefinite: the energy of the stresses that plastic strains leave)

    lam^T S lam + lam^T W q <= 0 ,    q the smallest s_0 + S_p p in the box.            (energy)

With S = R^T R let y be the shortest vector for which R^T y + W q >= 0 (a stress field that no
parameters of the box forbid; by Haar and Karman the nearest to the elastic one). Then
lam^T W q >= -(R lam)^T y, and R lam lies in the ball with the diameter [0, y]. A plane whose slack
is positive all over the ball is not reached anywhere in the box: its multiplier is zero. If there
is no such y, some parameters of the box let the ground collapse, and nothing follows.

What is left is relaxed to a linear program: complementarity forgotten, the energy and the
discrepancy below the best known, each by tangents at its solutions (Kelley). Its optimum is a lower
bound of the discrepancy in the box, and its extreme parameters make the box smaller.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.identify.yield_limits.condensed_system import CondensedSystem
from geoident.model.arrays import Bools, Floats, Ints

NEGLIGIBLE = 1e-11
"""Entries of scaled rows below this are left out: solvers work to 1e-6 to 1e-9."""

_RANK = 1e-10
"""Eigenvalues of the energy below this part of the largest count as zero."""

_EDGE_ROUNDS, _BOUND_ROUNDS = 25, 200
"""Turns of tangents for an edge of a box, and for its bound, which is worth more of them."""

_CUT = 1e-5
"""Part of its terms by which a solution must break an inequality to get a tangent."""


@dataclass(frozen=True)
class ParameterBox:
    """A box of scaled parameters and what is known of it.

    Args:
        lower: (n,) of the box.
        upper: (n,).
        bound: lower bound of the discrepancy inside.
        kept: (k,) pairs that may be active.
    """

    lower: Floats
    upper: Floats
    bound: float
    kept: Ints

    @property
    def size(self) -> float:
        """The longest edge."""
        return float(np.max(self.upper - self.lower, initial=0.0))

    def halves(self) -> tuple[ParameterBox, ParameterBox]:
        """The box cut across its longest edge."""
        h = int(np.argmax(self.upper - self.lower))
        middle = 0.5 * (self.lower[h] + self.upper[h])
        below, above = self.upper.copy(), self.lower.copy()
        below[h], above[h] = middle, middle
        return (
            ParameterBox(self.lower, below, self.bound, self.kept),
            ParameterBox(above, self.upper, self.bound, self.kept),
        )


@dataclass(frozen=True)
class EnergyForm:
    """The quadratic form of the energy inequality.

    Args:
        root: R, (r, q).
        carried: T with T R = W M, (q, r).
        exact: (q,) rows for which there is such a T.
        convex: S is positive semidefinite.
    """

    root: Floats
    carried: Floats
    exact: Bools
    convex: bool

    def only(self, kept: Ints) -> EnergyForm:
        """The form in which only the multipliers of the pairs (k,) are not zero."""
        return EnergyForm(self.root[:, kept], self.carried[kept], self.exact[kept], self.convex)


def form_of(weighted: Floats) -> EnergyForm:
    """The form of W M, (q, q)."""
    values, vectors = np.linalg.eigh(0.5 * (weighted + weighted.T))
    top = float(values.max(initial=0.0))
    some = values > _RANK * top
    stretch = np.sqrt(values[some])
    carried = weighted @ vectors[:, some] / stretch
    root = stretch[:, None] * vectors[:, some].T
    off = np.abs(carried @ root - weighted).max(axis=1, initial=0.0)
    exact = off <= 1e-8 * np.abs(weighted).max(initial=0.0)
    convex = bool(values.min(initial=0.0) >= -1e-9 * top)
    return EnergyForm(root, carried, exact, convex)


class EnergyInequality:
    """The energy inequality of a system in one box.

    Args:
        system: the condensed system, those pairs that may be active.
        form: of all pairs of that system, where it is the same for all parameters.
        lower: (n,) of the box.
        upper: (n,).

    Attributes:
        linear: W q, (q,).
        root: R, (r, q).
        convex: without which nothing follows.
    """

    def __init__(
        self, system: CondensedSystem, form: EnergyForm | None, lower: Floats, upper: Floats
    ) -> None:
        by_p = system.slack_by_p
        slack = system.slack + np.minimum(by_p * lower, by_p * upper).sum(axis=1)
        self.linear: Floats = system.work * slack
        if form is None:
            hardened = system.slack_by_lam.copy()
            for h, product in system.products.items():
                hardened += lower[h] * product
            form = form_of(system.work[:, None] * hardened)
        self.form = form
        self.root, self.convex = form.root, form.convex

    def lowest(self) -> Floats:
        """(q,) what W s is at least in the box, by the ball of the module's head."""
        form, nothing = self.form, np.full(len(self.linear), -np.inf)
        if not form.convex or not len(form.root):
            return nothing
        y = shortest(form.root.T, -self.linear)
        if y is None:
            return nothing
        radius = np.linalg.norm(form.carried, axis=1) * np.linalg.norm(y)
        bound = self.linear + 0.5 * (form.carried @ y - radius)
        bound -= 1e-9 * (np.abs(self.linear) + radius)
        return np.where(form.exact, bound, -np.inf)

    def reachable(self) -> Bools:
        """(q,) planes that may be reached in the box."""
        return np.asarray(self.lowest() <= 0.0)


def shortest(G: Floats, h: Floats) -> Floats | None:
    """The shortest y (r,) with G y >= h, or None if there is none (Lawson & Hanson 1974, LDP).

    >>> shortest(np.array([[1.0, 1.0]]), np.array([2.0]))
    array([1., 1.])
    """
    from scipy.optimize import nnls  # noqa: PLC0415  (0.4 s)

    size = float(np.abs(h).max(initial=0.0)) or 1.0
    table = np.vstack([G.T, h[None] / size])
    goal = np.zeros(len(table))
    goal[-1] = 1.0
    try:
        u, rest = nnls(table, goal, maxiter=20 * table.shape[1])
    except RuntimeError:
        return None
    r = table @ u - goal
    if rest < 1e-8 or -r[-1] < 1e-12:
        return None
    return np.asarray(-r[:-1] / r[-1] * size)


def examined(
    system: CondensedSystem, form: EnergyForm | None, box: ParameterBox, best: float
) -> ParameterBox | None:
    """A box without its unreachable planes, smaller and with a better bound; None if it is empty.

    Args:
        system: the whole condensed system.
        form: of its energy, or None where parameters change it.
        box: of its parameters.
        best: the lowest discrepancy known; what is above is of no interest.
    """
    part = system.only(box.kept)
    few = None if form is None else form.only(box.kept)
    energy = EnergyInequality(part, few, box.lower, box.upper)
    reachable = energy.reachable()
    relaxation = _Relaxation(part, energy, box, reachable, best)
    t = len(part.misfit) + relaxation.n + relaxation.q
    x = relaxation.minimum(t, 1.0, rounds=_BOUND_ROUNDS)
    if x is None and relaxation.lp.getDualRay() is not None:
        return None
    bound = box.bound if x is None else max(float(x[t]), box.bound)
    lower, upper = box.lower.copy(), box.upper.copy()
    room = 1e-6 * (upper - lower)  # for what the solver tolerates
    for h in range(len(lower)):
        low, high = relaxation.minimum(h, 1.0), relaxation.minimum(h, -1.0)
        if low is not None and high is not None:
            lower[h] = max(lower[h], low[h] - room[h])
            upper[h] = min(upper[h], high[h] + room[h])
    return ParameterBox(lower, upper, bound, box.kept[reachable])


class _Relaxation:
    """The linear program; columns are p (n), lam (q), the misfits r (g) and t >= sum r^2."""

    def __init__(
        self,
        part: CondensedSystem,
        energy: EnergyInequality,
        box: ParameterBox,
        reachable: Bools,
        best: float,
    ) -> None:
        from pyscipopt import LP  # noqa: PLC0415  (an extra)

        self.energy = energy
        self.n, self.q, g = len(box.lower), part.n_pairs, len(part.misfit)
        self.lp = LP()
        infinity, edge = self.lp.infinity(), np.sqrt(best)
        lower = np.concatenate([box.lower, np.zeros(self.q), np.full(g, -edge), [0.0]])
        most = np.where(reachable, infinity, 0.0)
        upper = np.concatenate([box.upper, most, np.full(g, edge), [best]])
        count = len(lower)
        self.lp.addCols(
            [[] for _ in range(count)], lbs=lower.tolist(), ubs=upper.tolist(), objs=[0.0] * count
        )
        self._minimised: int | None = None
        hardened = part.slack_by_lam.copy()
        for h, product in part.products.items():
            hardened += box.upper[h] * product
        for constant, row in zip(part.slack, np.hstack([part.slack_by_p, hardened]), strict=True):
            self._add(row, -constant, infinity)
        misfits = np.hstack([part.misfit_by_p, part.misfit_by_lam, -np.eye(g)])
        for constant, row in zip(part.misfit, misfits, strict=True):
            self._add(row, -constant, -constant)
        self._add_for_lam(energy.linear, 0.0)

    def minimum(self, column: int, sign: float, *, rounds: int = _EDGE_ROUNDS) -> Floats | None:
        """The solution of the smallest sign times one column; None where there is none."""
        if self._minimised is not None:
            self.lp.chgObj(self._minimised, 0.0)
        self.lp.chgObj(column, sign)
        self._minimised = column
        x: Floats | None = None
        for _ in range(rounds):
            self.lp.solve()
            if not self.lp.isOptimal():
                return None
            x = np.array(self.lp.getPrimal())
            if not self._cut(x):
                break
        return x

    def _cut(self, x: Floats) -> bool:
        """Adds tangents where a solution breaks the energy or the discrepancy; whether it does."""
        n, q, energy = self.n, self.q, self.energy
        lam, r, t = x[n : n + q], x[n + q : -1], x[-1]
        y = energy.root @ lam
        bent, straight = float(y @ y), float(energy.linear @ lam)
        breaks_energy = bent + straight > _CUT * (bent + abs(straight)) + 1e-12
        if energy.convex and breaks_energy:
            at = y * max(min(1.0, -straight / bent), 0.05)  # drawn back to the surface
            self._add_for_lam(energy.linear + 2.0 * energy.root.T @ at, float(at @ at))
        square = float(r @ r)
        breaks_misfit = square > t + _CUT * max(square, 1e-6)
        if breaks_misfit:
            row = np.concatenate([np.zeros(n + q), 2.0 * r, [-1.0]])
            self._add(row, -self.lp.infinity(), square)
        return bool((energy.convex and breaks_energy) or breaks_misfit)

    def _add_for_lam(self, row: Floats, upper: float) -> None:
        size = float(np.abs(row).max(initial=0.0)) or 1.0
        self._add(np.append(np.zeros(self.n), row / size), -self.lp.infinity(), upper / size)

    def _add(self, row: Floats, lower: float, upper: float) -> None:
        entries = [(int(j), float(row[j])) for j in np.flatnonzero(np.abs(row) > NEGLIGIBLE)]
        self.lp.addRow(entries, lhs=float(lower), rhs=float(upper))

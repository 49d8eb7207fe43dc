"""Newton's method for yielding ground on few factorizations (theory 5.1).

The steps of `equilibrium` need no exact tangent until the end: any direction of descent of the
convex Pi will do, as long as its slope is followed. Three kinds of steps lead there, by what is at
hand:

    far       conjugate gradients on the tangent, preconditioned by the elastic stiffness and cut
              off after a few steps: directions in which the ground flows freely, which make whole
              Newton steps far too long, come last and are left out,
    near      the tangent is factorized, once if all goes well; where its step was far too long, one
              of the first kind comes between,
    at last   conjugate gradients preconditioned by that factor: the pieces of the last steps differ
              little from those for which it was made, and so do those of the derivatives. Where the
              start is near, as it is from one parameter vector of a search to the next, the factor
              of the march before serves, and none is made.

How many steps of conjugate gradients are worth a factorization is counted on the pattern. Residuals
are brought as far down as in `equilibrium`, so the state is the same; derivatives to `EXACT`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.fem.solvers.conjugate_gradients import Product, conjugate_gradients
from geoident.fem.solvers.direct import Factor
from geoident.forward.march.stage_equations import (
    ELASTIC_PARTS,
    FactorsAtHand,
    StageEquations,
    Trial,
)
from geoident.model.arrays import Floats

EXACT = 1e-11
"""Residual, relative, that derivatives are solved to."""

NEAR = 3e-4
"""Out-of-balance force from which on the tangent is worth a factorization."""

MOST_FAR = 20
"""Steps on the elastic factor at most."""

_ROUGH, _FINE = 0.1, 1e-3
"""Residuals, relative, of steps far from equilibrium: at most, and at least where they are long."""

_FAIR = 0.2
"""Residual, relative, that a step which was not brought as far as wanted leaves at most."""

_GUESS_STEPS = 3


@dataclass
class Directions:
    """The steps of one solution, made of what is at hand.

    Args:
        equations: of the stage.
        at_hand: its factors.
        balanced: out-of-balance force, relative, that counts as equilibrium.
    """

    equations: StageEquations
    at_hand: FactorsAtHand
    balanced: float
    far_steps: int = 0
    own: bool = False
    """The last factor was made on the way."""
    failed: bool = False
    """The factor of another march is too far off."""
    cut: bool = False
    """The last direction was cut off: no Newton step."""

    def guess(self) -> Floats:
        """(n_dofs,) the displacement step if nothing yielded any more."""
        rest = self.equations.at(0.0 * self.equations.forces)
        product = self._product(rest)
        found = conjugate_gradients(
            product,
            rest.residual[:, None],
            self.at_hand.elastic().solve,
            tolerance=_ROUGH,
            most=_GUESS_STEPS,
        )
        return self.equations.spread(found.x[:, 0])

    def at(self, trial: Trial, least: int) -> tuple[Floats, int]:
        """A direction of descent (n,), and the level of `ELASTIC_PARTS` that it needed.

        Args:
            trial: where from.
            least: level at least.
        """
        near = trial.error <= NEAR
        product = self._product(trial)
        self.cut = False
        if not least and (self.own or (near and not self.failed)):
            found = self._on_last(product, trial)
            if found is not None:
                return found, 0
            self.failed = True
        if (least or not (self.own or near)) and self.far_steps < MOST_FAR:
            self.far_steps += 1
            self.cut = True
            return self._on_elastic(product, trial), 0
        factor, level = self.equations.factor(trial, least=least)
        self.own = True
        return factor.solve(trial.residual[:, None])[:, 0], level

    def solve(self, trial: Trial, rhs: Floats) -> Floats:
        """Solutions (n, k) with the exact tangent."""
        last = self.at_hand.last()
        found = None if last is None else self.solved_on(last, trial, rhs, self.at_hand.most)
        return self.equations.factor(trial)[0].solve(rhs) if found is None else found

    def solved_on(self, factor: Factor, trial: Trial, rhs: Floats, most: int) -> Floats | None:
        """The same on a factor of a tangent near by; None where a number of steps is not enough.

        Args:
            factor: of that tangent.
            trial: where the tangent is wanted.
            rhs: (n, k) right-hand sides.
            most: steps of conjugate gradients at most.
        """
        found = conjugate_gradients(
            self._product(trial), rhs, factor.solve, tolerance=EXACT, most=most
        )
        return found.x if found.reached else None

    def step_on(self, factor: Factor, trial: Trial, most: int, level: int) -> Floats | None:
        """The step (n,) to equilibrium on a factor of a tangent near by, as far as it is wanted.

        Args:
            factor: of that tangent.
            trial: where from.
            most: iterations of conjugate gradients at most.
            level: of `ELASTIC_PARTS` in the tangent.

        Returns:
            None where more than `_FAIR` of the residual is left.
        """
        product, rhs = self._product(trial, level), trial.residual[:, None]
        found = conjugate_gradients(
            product, rhs, factor.solve, tolerance=self._wanted(trial), most=most
        )
        if found.reached:
            return found.x[:, 0]
        left = np.linalg.norm(rhs - product(found.x)) / np.linalg.norm(rhs)
        return found.x[:, 0] if left <= _FAIR else None

    def _product(self, trial: Trial, level: int = 0) -> Product:
        points, change = self.equations.changes(trial)
        return self.at_hand.product(points, (1.0 - ELASTIC_PARTS[level]) * change)

    def _on_last(self, product: Product, trial: Trial) -> Floats | None:
        """The direction on the last factor; None if that is too far off."""
        last = self.at_hand.last()
        if last is None:
            return None
        return self._iterated(product, trial, last, self._wanted(trial), whole=True)

    def _on_elastic(self, product: Product, trial: Trial) -> Floats:
        """A direction on the elastic factor, cut off."""
        wanted = min(_ROUGH, max(self._wanted(trial), _FINE))
        found = self._iterated(product, trial, self.at_hand.elastic(), wanted, whole=False)
        assert found is not None
        return found

    def _iterated(
        self, product: Product, trial: Trial, factor: Factor, wanted: float, *, whole: bool
    ) -> Floats | None:
        found = conjugate_gradients(
            product,
            trial.residual[:, None],
            factor.solve,
            tolerance=wanted,
            most=self.at_hand.most,
        )
        return found.x[:, 0] if found.reached or not whole else None

    def _wanted(self, trial: Trial) -> float:
        """The residual of a step, relative: what is left of the nonlinearity is no less."""
        least, most = 0.1 * self.balanced / trial.error, float(trial.error ** (2.0 / 3.0))
        return max(least, min(_ROUGH, most))


class SecantSteps:
    """Steps on one factor, corrected by what the steps before have found.

    The inverse that is thought of is that of the factor, changed so that it explains the changes of
    the residual along earlier steps (L-BFGS: Matthies & Strang 1979, Int. J. Numer. Methods Eng.
    14, 1613-1626; Nocedal 1980, Math. Comput. 35, 773-782).

    Args:
        factor: of a tangent near by.
    """

    def __init__(self, factor: Factor) -> None:
        self._factor = factor
        self._known: list[tuple[Floats, Floats, float]] = []  # d, change of the residual, product

    def direction(self, residual: Floats) -> Floats:
        """The step (n,) for a residual (n,)."""
        left, weights = residual.copy(), []
        for d, fall, work in reversed(self._known):
            weights.append(float(d @ left) / work)
            left -= weights[-1] * fall
        step = self._factor.solve(left[:, None])[:, 0]
        for (d, fall, work), weight in zip(self._known, reversed(weights), strict=True):
            step += (weight - float(fall @ step) / work) * d
        return step

    def learn(self, d: Floats, fall: Floats) -> None:
        """Count a step (n,) that was made, by which the residual fell by (n,)."""
        work = float(d @ fall)
        if work > 0.0:
            self._known.append((d, fall, work))

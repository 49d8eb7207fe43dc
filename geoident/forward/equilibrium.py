"""Equilibrium of one stage with yielding points: a semismooth Newton method (theory 5).

The displacements du of a stage minimise

    Pi(du) = sum_i V_i w(sigma_old + E C du)_i  -  f^T du ,

where w is half the square of the elastic trial stress less that of its distance to the yield
surface, in the norm of E^-1. Pi is convex and once differentiable; with the projection P

    r = -grad Pi = f - C^T V P(sigma_old + E C du) = 0 .

Newton's method takes the consistent tangent K_T = C^T V T E C as derivative of P. Polyhedra make P
piecewise linear, so it ends, exactly, once the pieces are found; along each step the slope of Pi
is followed to near its zero, which makes it converge from everywhere. Where K_T is singular, a
little of the elastic stiffness is left in it.

Flow that is not associated has no potential; there the norm of r is lowered instead.

A load beyond collapse has no minimum: Pi falls without end along a mechanism d. That is found
by the slope of Pi far out along the steps (the kinematic theorem of limit analysis): if it is
still falling there, d dissipates less than the loads give, and no equilibrium exists.

Cost: one factorization for every step, one for the derivatives if the last was made elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from geoident.fem.plastic.law import Projection, YieldLaw
from geoident.fem.solvers.protocol import Factor, NotPositiveDefinite
from geoident.model.arrays import Floats, Ints

BALANCED = 1e-11
"""Out-of-balance force, relative to the forces at work, that counts as equilibrium."""

ROUNDING = 1e-8
"""The same where no step lowers it any more."""

MOST_STEPS = 60
"""Newton steps at most; a stage rarely takes more than fifteen."""

PATIENCE = 12
"""Steps after which flow without potential is given up if the error has not come down by half."""

FAR_OUT = 1e6
"""Where along a step its mechanism alone decides, in steps."""

_LEFT = (1e-10, 1e-7, 1e-5, 1e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0)
"""Parts of the elastic stiffness left in a tangent, by level."""

_STIFFER = 6
"""Level from which a tangent whose step was too long is made stiffer."""

Index = Ints | slice


class Operators(Protocol):
    """C and C^T V: `geoident.fem.compatibility.StrainPoints`, or a frame's."""

    @property
    def n_points(self) -> int:
        """Number m of strain points."""

    def strain(self, u: Floats) -> Floats:
        """Strains (s, m, ...) of displacements (n_dofs, ...)."""

    def forces(self, stress: Floats, volume: Floats) -> Floats:
        """Nodal forces (n_dofs, ...) of stresses (s, m, ...) with weights (m,)."""


class Tangents(Protocol):
    """Makes factors of stiffness matrices."""

    def __call__(self, points: Ints, change: Floats, *, symmetric: bool) -> Factor:
        """Factor of the elastic K plus changes (q, s, s) of V E at some points (q,)."""


@dataclass(frozen=True)
class Ground:
    """The strain points of one material.

    Args:
        name: of the material.
        points: which they are.
        elasticity: E, (s, s).
        law: its yield law, or None.
        hardened: (y, m) multipliers of earlier stages at these points, or None.
    """

    name: str
    points: Index
    elasticity: Floats
    law: YieldLaw | None = None
    hardened: Floats | None = None


class NoEquilibrium(ArithmeticError):
    """The loads of a stage cannot be carried, or no equilibrium was found.

    Args:
        mechanism: (n_dofs,) how the ground moves, or None.
        proven: the mechanism proves that there is no equilibrium.
    """

    def __init__(self, mechanism: Floats | None, *, proven: bool) -> None:
        self.mechanism = mechanism
        self.proven = proven
        super().__init__("no equilibrium")


@dataclass(frozen=True)
class Trial:
    """Displacements and what they make.

    Args:
        du: (n_dofs,) displacement step.
        stress: (s, m) projected stress.
        projections: of every ground, None where it does not yield.
        residual: (n,) r at the unknowns.
        scale: largest force at work, N.
    """

    du: Floats
    stress: Floats
    projections: tuple[Projection | None, ...]
    residual: Floats
    scale: float

    @cached_property
    def error(self) -> float:
        """Largest out-of-balance force relative to the forces at work."""
        worst = float(np.abs(self.residual).max(initial=0.0))
        return worst / self.scale if self.scale > 0 else worst


@dataclass(frozen=True)
class Balance:
    """Equilibrium at the end of a stage.

    Args:
        trial: displacements, stresses, projections.
        steps: Newton steps taken.
        factor: of the tangent before the last step, or None if none was made.
        made_at: where it was made.
    """

    trial: Trial
    steps: int
    factor: Factor | None
    made_at: Trial | None


class StageEquations:
    """The nonlinear equations of one stage.

    Args:
        operators: C and C^T V.
        volume: (m,) V, zero at absent points.
        dofs: (n,) degrees of freedom that are unknown.
        grounds: materials with their points.
        stress: (s, m) stress before, of all points.
        forces: (n_dofs,) f.
        tangents: makes factors.
        members: nodal forces (n_dofs,) of linings and bolts at a displacement step, or None.
    """

    def __init__(
        self,
        operators: Operators,
        *,
        volume: Floats,
        dofs: Ints,
        grounds: Sequence[Ground],
        stress: Floats,
        forces: Floats,
        tangents: Tangents,
        members: Callable[[Floats], Floats] | None = None,
    ) -> None:
        self.operators = operators
        self.volume = volume
        self.dofs = dofs
        self.grounds = tuple(grounds)
        self.stress = stress
        self.forces = forces
        self._tangents = tangents
        self._members = members
        laws = [ground.law for ground in grounds if ground.law is not None]
        self.associated = all(law.associated for law in laws)

    def under(self, forces: Floats) -> StageEquations:
        """The same ground under other forces (n_dofs,)."""
        return StageEquations(
            self.operators, volume=self.volume, dofs=self.dofs, grounds=self.grounds,
            stress=self.stress, forces=forces, tangents=self._tangents, members=self._members,
        )  # fmt: skip

    def before(self) -> Floats:
        """(n_dofs,) forces that hold what is borne before the stage."""
        internal = self.operators.forces(self.stress, self.volume)
        return internal if self._members is None else internal + self._members(0.0 * internal)

    @cached_property
    def _at_work(self) -> float:
        """Largest force that is given or borne before, N.

        Signs at random keep the forces of an element from cancelling those of the next, so that
        stress in equilibrium with itself counts.
        """
        signs = np.random.default_rng(0).choice([-1.0, 1.0], self.stress.shape)
        alone = self.operators.forces(self.stress * signs, self.volume)
        return max(float(np.abs(f).max(initial=0.0)) for f in (self.forces, self.before(), alone))

    def at(self, du: Floats) -> Trial:
        """Stresses and residual at a displacement step (n_dofs,)."""
        stress = self.stress.copy()
        strain = self.operators.strain(du)
        projections = [self._respond(ground, stress, strain) for ground in self.grounds]
        internal = self.operators.forces(stress, self.volume)
        if self._members is not None:
            internal = internal + self._members(du)
        scale = max(np.abs(internal).max(initial=0.0), self._at_work)
        rest = (self.forces - internal)[self.dofs]
        return Trial(du, stress, tuple(projections), rest, float(scale))

    def _respond(self, ground: Ground, stress: Floats, strain: Floats) -> Projection | None:
        """Stress of one material, in place."""
        mine = ground.points
        trial = stress[:, mine] + ground.elasticity @ strain[:, mine]
        if ground.law is None:
            stress[:, mine] = trial
            return None
        try:
            projection = ground.law.project(trial, ground.hardened)
        except ArithmeticError as error:  # flow that is not associated may lead nowhere
            raise NoEquilibrium(None, proven=False) from error
        stress[:, mine] = projection.stress
        return projection

    def factor(self, trial: Trial, *, least: int = 0) -> tuple[Factor, int]:
        """Factor of the consistent tangent, and which of `_LEFT` it needed, from a first."""
        points, change = self.changes(trial)
        for level in range(least, len(_LEFT)):
            part = (1.0 - _LEFT[level]) * change
            try:
                return self._tangents(points, part, symmetric=self.associated), level
            except NotPositiveDefinite:
                if level == len(_LEFT) - 1 or not len(points):
                    raise
        raise AssertionError

    def changes(self, trial: Trial) -> tuple[Ints, Floats]:
        """Points (q,) that yield, ascending, and (T E - E) V (q, s, s) there."""
        points, changes = [np.empty(0, dtype=np.int64)], []
        s = self.stress.shape[0]
        for ground, projection in zip(self.grounds, trial.projections, strict=True):
            if projection is None or not len(projection.yielded):
                continue
            mine = numbers(ground.points, self.operators.n_points)[projection.yielded]
            points.append(mine)
            tangent = (projection.reduction - np.eye(s)) @ ground.elasticity
            changes.append(tangent * self.volume[mine][:, None, None])
        joined = np.concatenate(points)
        if not changes:
            return joined, np.empty((0, s, s))
        order = np.argsort(joined, kind="stable")
        return joined[order], np.concatenate(changes)[order]

    def spread(self, free: Floats) -> Floats:
        """(n_dofs,) displacements of values (n,) at the unknowns."""
        full = np.zeros(self.forces.shape[0])
        full[self.dofs] = free
        return full


def numbers(index: Index, n: int) -> Ints:
    """A slice or an array of numbers as numbers."""
    return np.arange(n)[index] if isinstance(index, slice) else index


def solve(equations: StageEquations, guesses: Iterable[Floats]) -> Balance:
    """The equilibrium of a stage.

    Args:
        equations: of the stage.
        guesses: (n_dofs,) displacement steps; the one with the smallest residual is the start.

    Raises:
        NoEquilibrium: see there.
        NotPositiveDefinite: the elastic stiffness itself is singular.
    """
    trial = min((equations.at(guess) for guess in guesses), key=lambda t: t.error)
    search = follow_slope if equations.associated else _along_norm
    factor: Factor | None = None
    made_at: Trial | None = None
    least, reached = 0, (0, np.inf)
    for step in range(MOST_STEPS):
        if trial.error <= BALANCED:
            return Balance(trial, step, factor, made_at)
        if trial.error < 0.5 * reached[1]:
            reached = step, trial.error
        if not equations.associated and step - reached[0] > PATIENCE:
            break
        factor, level = equations.factor(trial, least=least)
        made_at = trial if level == 0 else None
        d = equations.spread(factor.solve(trial.residual[:, None])[:, 0])
        following, share = search(equations, trial, d)
        if following.error >= trial.error and trial.error <= ROUNDING:
            return Balance(trial, step + 1, factor, made_at)
        if step > 2 and equations.associated and share == 1.0:
            _refuse_mechanism(equations, following, d)
        least = _next_level(least, share)
        trial = following
    raise NoEquilibrium(trial.du, proven=False)


def _next_level(level: int, share: float) -> int:
    """How much of the elastic stiffness the next tangent keeps, after a share of a step."""
    if share < 0.3:
        return min(max(level + 1, _STIFFER), len(_LEFT) - 2)
    if share < 0.9:
        return level
    return level - 1 if level > _STIFFER else 0


def follow_slope(equations: StageEquations, trial: Trial, d: Floats) -> tuple[Trial, float]:
    """Follows a step to near the zero of the slope of Pi, which is monotone.

    A full step on which Pi still falls at its end, or has hardly risen, is taken as it is.
    """
    free = d[equations.dofs]
    slope = float(trial.residual @ free)
    following = equations.at(trial.du + d)
    found = float(following.residual @ free)
    if found >= -0.3 * slope:
        return following, 1.0
    low, s_low, high, s_high = 0.0, slope, 1.0, found
    share = 1.0
    for _ in range(40):
        share = (low * s_high - high * s_low) / (s_high - s_low)
        share = float(np.clip(share, low + 0.02 * (high - low), high - 0.02 * (high - low)))
        following = equations.at(trial.du + share * d)
        found = float(following.residual @ free)
        if abs(found) <= 0.3 * slope:
            break
        if found > 0.0:
            low, s_low, s_high = share, found, 0.5 * s_high
        else:
            high, s_high, s_low = share, found, 0.5 * s_low
    return following, share


def _along_norm(equations: StageEquations, trial: Trial, d: Floats) -> tuple[Trial, float]:
    """Halves a step until the residual is smaller."""
    before = float(np.linalg.norm(trial.residual))
    share, best = 1.0, None
    while share > 1e-3:
        following = equations.at(trial.du + share * d)
        if np.linalg.norm(following.residual) < (1.0 - 1e-4 * share) * before:
            return following, share
        if best is None or following.error < best[0].error:
            best = following, share
        share *= 0.5
    assert best is not None
    return best


def _refuse_mechanism(equations: StageEquations, trial: Trial, d: Floats) -> None:
    """Raise where Pi falls without end along a step."""
    far = equations.at(trial.du + FAR_OUT * d)
    free = d[equations.dofs]
    power = float(np.abs(equations.forces[equations.dofs] * free).sum())
    if float(far.residual @ free) > 1e-6 * power:
        raise NoEquilibrium(d, proven=True)


def flowing(equations: StageEquations, trial: Trial) -> list[tuple[Ground, Projection, Ints]]:
    """Materials that yield somewhere, with the numbers of the strain points that do."""
    n = equations.operators.n_points
    return [
        (ground, projection, numbers(ground.points, n)[projection.yielded])
        for ground, projection in zip(equations.grounds, trial.projections, strict=True)
        if projection is not None and len(projection.yielded)
    ]

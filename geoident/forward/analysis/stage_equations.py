"""The nonlinear equations of one stage with yielding points, on arrays (theory 5.4).

They need strain points, weights, grounds (`constitutive`) and a way to factorize; a mesh or a frame
gives them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
import scipy.sparse.linalg as spla

from geoident.fem.patches import Patch
from geoident.fem.solvers.direct import Factor, NotPositiveDefinite
from geoident.fem.yielding.domain import NoReturn
from geoident.forward.analysis.constitutive import MaterialPoints, PlasticResponse
from geoident.model.arrays import Bools, Floats, Ints

ELASTIC_PARTS = (1e-10, 1e-7, 1e-3, 1.0)
"""Parts of the elastic stiffness that are left in a tangent: the first that makes it definite."""

_SAME_TANGENT = 1e-7
"""Relative difference of two tangents that give derivatives alike to seven digits."""

_SAME_GENERAL_TANGENT = 1e-11
"""The same of non-associated flow: eigenvalues may be a ten thousandth of the elastic ones."""

_SOLVED = 1e-9
"""Relative residual at which a solution by the consistent tangent is exact enough."""

_MOST_ITERATIONS = 200
"""Of GMRES, where some of the elastic stiffness is left in the factor; a handful are usual."""


class Operators(Protocol):
    """C and C^T V: `geoident.fem.kinematics.StrainPoints`, or a frame's."""

    @property
    def n_points(self) -> int:
        """Number m of strain points."""

    def strain(self, u: Floats) -> Floats:
        """Strains (s, m, ...) of displacements (n_dofs, ...)."""

    def forces(self, stress: Floats, volume: Floats) -> Floats:
        """Nodal forces (n_dofs, ...) of stresses (s, m, ...) with weights (m,)."""


class TangentSolver(Protocol):
    """Factorizes stiffness matrices."""

    def factorize(self, points: Ints, change: Floats, *, symmetric: bool) -> Factor:
        """Factor of the elastic K plus changes at some points.

        Args:
            points: (q,) strain points, ascending.
            change: (q, s, s) changes of V E there.
            symmetric: whether they are symmetric matrices.
        """


class Patches(Protocol):
    """Parts of the ground whose equations are solved by themselves."""

    def around(self, unknowns: Ints, most: int) -> Patch | None:
        """The patch around unknowns (w,); None where more than a number of them would move."""

    def solver(self, patch: Patch) -> TangentSolver:
        """What factorizes the stiffness of a patch."""


class SingularTangent(ArithmeticError):
    """The consistent tangent is singular: the displacements have no derivatives."""


class NoEquilibrium(ArithmeticError):
    """The loads of a stage cannot be carried, or no equilibrium was found.

    Args:
        mechanism: (n_dofs,) how the ground moves, or None.
        proven: whether it moves without end under this load: no doubt is left.
        diffuse: with non-associated flow the last equilibrium on the path of viscous grounds;
            None where there is none.
        runs_away: whether displacements grow like 1 / mu along that path, as beyond a limit load.
    """

    def __init__(
        self,
        mechanism: Floats | None,
        *,
        proven: bool = False,
        diffuse: Balance | None = None,
        runs_away: bool = False,
    ) -> None:
        self.mechanism = mechanism
        self.proven = proven
        self.diffuse = diffuse
        self.runs_away = runs_away
        super().__init__("no equilibrium")


@dataclass(frozen=True, eq=False)
class Iterate:
    """Displacements of a Newton step, with the returned stress and the residual that they leave.

    Args:
        du: (n_dofs,) displacement step.
        stress: (s, m) projected stress.
        responses: of every material, None where it never yields.
        residual: (n,) r at the unknowns.
        scale: largest force at work, N.
    """

    du: Floats
    stress: Floats
    responses: tuple[PlasticResponse | None, ...]
    residual: Floats
    scale: float

    @cached_property
    def imbalance(self) -> float:
        """Largest out-of-balance force relative to the forces at work."""
        worst = float(np.abs(self.residual).max(initial=0.0))
        return worst / self.scale if self.scale > 0 else worst

    @property
    def flowing(self) -> list[PlasticResponse]:
        """What yields somewhere."""
        return [
            response for response in self.responses if response is not None and response.points.size
        ]

    def yielded(self) -> Bools:
        """(m,) strain points with a positive multiplier."""
        result = np.zeros(self.stress.shape[1], dtype=bool)
        for response in self.flowing:
            result[response.points] = (response.projection.multipliers > 0.0).any(axis=1)
        return result


@dataclass(frozen=True, eq=False)
class Tangent:
    """A consistent tangent K_T and its factor.

    Args:
        factor: of K_T.
        points: (q,) strain points that yield, ascending.
        change: (q, s, s) what they add to V E.
        consistent: whether it is all but 1e-10 of K_T; else more of the elastic stiffness is left.
    """

    factor: Factor
    points: Ints
    change: Floats
    consistent: bool

    def solve(self, rest: Floats) -> Floats:
        """K_T^-1 r (n,) of one residual."""
        return self.factor.solve(rest[:, None])[:, 0]


@dataclass(frozen=True, eq=False)
class BalancedStep:
    """An equilibrium of viscous ground of whose overstress a multiple of a field is taken off.

    Args:
        iterate: at the viscosity, before that is taken off.
        viscosity: mu.
        multiple: t.
        field: o' (s, m), Pa; None of the first one, where nothing is taken off.
    """

    iterate: Iterate
    viscosity: float
    multiple: float = 0.0
    field: Floats | None = None

    @cached_property
    def overstress(self) -> Floats:
        """The trial stress less the stress on the yield surface, o (s, m), Pa."""
        overstress = np.zeros_like(self.iterate.stress)
        for response in self.iterate.responses:
            if response is not None and not response.ground.of_structure:
                projection = response.projection
                overstress[:, response.ground.points] = projection.trial - projection.stress
        return overstress

    @property
    def left(self) -> Floats:
        """(s, m) o - t o', Pa."""
        if self.field is None:
            return self.overstress
        return np.asarray(self.overstress - self.multiple * self.field)

    @property
    def end(self) -> Iterate:
        """The iterate with the stress that is in equilibrium with the loads."""
        if self.field is None:
            return self.iterate
        taken = self.viscosity * self.multiple * self.field
        return replace(self.iterate, stress=self.iterate.stress - taken)


@dataclass(frozen=True)
class Balance:
    """Where Newton's method ended: equilibrium at the end of a stage, if it converged.

    Args:
        end: the last iterate.
        tangent: that of the last step, or None if none was made.
        converged: whether the forces are in balance.
        viscosity: part of the overstress that is kept (`viscous_path`).
        residual: part of the change of load that stress beyond the yield surface carries.
        short: part by which displacements may be off those without viscosity.
        steps: the solutions that led here where overstress was balanced (`balanced_overstress`).
    """

    end: Iterate
    tangent: Tangent | None = None
    converged: bool = True
    viscosity: float = 0.0
    residual: float = 0.0
    short: float = 0.0
    steps: tuple[BalancedStep, ...] = ()


@dataclass(frozen=True, eq=False)
class StageEquations:
    """The nonlinear equations of one stage.

    Args:
        operators: C and C^T V.
        volume: (m,) V, zero at absent points.
        dofs: (n,) degrees of freedom that are unknown.
        grounds: materials with their points.
        stress: (s, m) stress before, of all points.
        trial: (s, m) with what comes back as open interfaces close: what strains add to.
        forces: (n_dofs,) f.
        solver: factorizes tangents.
        linear: nodal forces (n_dofs,) beside those of stresses at a displacement step: of linings
            and bolts, and of water; None for none.
        viscosity: part of the overstress s* - P(s*) that is kept (`viscous_path`).
        patches: parts that can be solved by themselves; None for none.
        n_turns: how many of the unknowns, the last ones, are rotations of members that yield.
        n_pressures: how many, before these, are pressures of water.
        balanced_turns: rotations in equilibrium with what comes before them, from a first guess;
            None where nothing turns. They are asked for where there is no potential, whose
            minimum needs no such help.
    """

    operators: Operators
    volume: Floats
    dofs: Ints
    grounds: Sequence[MaterialPoints]
    stress: Floats
    trial: Floats
    forces: Floats
    solver: TangentSolver
    linear: Callable[[Floats], Floats] | None = None
    viscosity: float = 0.0
    patches: Patches | None = None
    n_turns: int = 0
    n_pressures: int = 0
    balanced_turns: Callable[[Floats, Floats], Floats] | None = None

    @cached_property
    def associated(self) -> bool:
        """Whether the plastic strains of all materials follow the normals, so that Pi exists."""
        return all(ground.associated for ground in self.grounds)

    @cached_property
    def structures_flow_aside(self) -> bool:
        """Whether plastic strains of some structure, an interface, do not follow the normals."""
        return any(one.of_structure and not one.associated for one in self.grounds)

    @cached_property
    def ground_flows_aside(self) -> bool:
        """Whether plastic strains of some ground do not follow the normals."""
        return any(not (one.of_structure or one.associated) for one in self.grounds)

    @cached_property
    def of_ground(self) -> Bools:
        """(m,) points of the ground, not of structures."""
        result = np.ones(len(self.volume), dtype=bool)
        for ground in self.grounds:
            if ground.of_structure:
                result[ground.points] = False
        return result

    def largest_strain(self, du: Floats) -> Floats:
        """(m,) largest component of the strain at each point, or rotation of a part of a beam.

        Of interfaces and grouted bars it is the motion between both sides, m.
        """
        strain = np.abs(self.operators.strain(du))
        for ground in self.grounds:
            if ground.bends:
                strain[1:, ground.points] *= self.volume[ground.points]
        return np.asarray(strain.max(axis=0))

    def under(self, forces: Floats) -> StageEquations:
        """The same ground under other forces (n_dofs,)."""
        return replace(self, forces=forces)

    def with_associated_flow(self) -> StageEquations:
        """The same of ground whose plastic strains follow the normals."""
        return replace(self, grounds=[ground.with_associated_flow() for ground in self.grounds])

    def viscous(self, part: float) -> StageEquations:
        """The same of a ground that keeps a part of its overstress."""
        return replace(self, viscosity=part) if part != self.viscosity else self

    def on_patch(self, patch: Patch, solver: TangentSolver, du: Floats) -> StageEquations:
        """Those of a patch, where all else stays; its displacements are those of its own.

        Args:
            patch: which unknowns move.
            solver: factorizes their tangents.
            du: (n_dofs,) displacement step of all else.
        """
        n = self.operators.n_points
        parts = (ground.restrict(patch.points, n) for ground in self.grounds)
        linear: Callable[[Floats], Floats] | None = None
        if self.linear is not None:
            of_all = self.linear

            def linear(own: Floats) -> Floats:
                moved = du.copy()
                moved[patch.dofs] = own
                return of_all(moved)[patch.dofs]

        return StageEquations(
            patch,
            volume=self.volume[patch.points],
            dofs=patch.places,
            grounds=[part for part in parts if part is not None],
            stress=np.ascontiguousarray(self.stress[:, patch.points]),
            trial=np.ascontiguousarray(self.trial[:, patch.points]),
            forces=self.forces[patch.dofs],
            solver=solver,
            linear=linear,
        )

    def carried_forces(self) -> Floats:
        """(n_dofs,) forces that hold what is carried into the stage."""
        internal = self.operators.forces(self.stress, self.volume)
        return internal if self.linear is None else internal + self.linear(0.0 * internal)

    @cached_property
    def _at_work(self) -> float:
        """Largest force that is given or carried, N.

        Signs at random keep the forces of an element from cancelling those of the next, so that
        stress in equilibrium with itself counts.
        """
        signs = np.random.default_rng(0).choice([-1.0, 1.0], self.stress.shape)
        alone = self.operators.forces(self.stress * signs, self.volume)
        return max(
            float(np.abs(f).max(initial=0.0)) for f in (self.forces, self.carried_forces(), alone)
        )

    def at(self, du: Floats) -> Iterate:
        """Stresses and residual at a displacement step (n_dofs,).

        Raises:
            NoEquilibrium: non-associated flow leads back to no stress.
        """
        if self.balanced_turns is not None and not self.associated:
            u, turns = np.split(du, [len(du) - self.n_turns])
            du = np.concatenate([u, self.balanced_turns(u, turns)])
        stress, strain = self.trial.copy(), self.operators.strain(du)
        try:
            responses = [
                one.integrate_stress(stress, strain, self.viscosity) for one in self.grounds
            ]
        except NoReturn as error:
            raise NoEquilibrium(None) from error
        internal = self.operators.forces(stress, self.volume)
        if self.linear is not None:
            internal = internal + self.linear(du)
        scale = max(np.abs(internal).max(initial=0.0), self._at_work)
        return Iterate(
            du, stress, tuple(responses), (self.forces - internal)[self.dofs], float(scale)
        )

    def elastic_forces(self, free: Floats) -> Floats:
        """K x (n,) of displacements x (n,) of the unknowns where nothing yields, N."""
        du = self.spread(free)
        strain, stress = self.operators.strain(du), np.zeros_like(self.stress)
        for ground in self.grounds:
            stress[:, ground.points] = ground.elasticity.stress(strain[:, ground.points])
        forces = self.operators.forces(stress, self.volume)
        if self.linear is not None:
            forces = forces + self.linear(du) - self.linear(0.0 * du)
        return np.asarray(forces[self.dofs])

    def distance(self, iterate: Iterate) -> float:
        """How far displacements are from equilibrium, to compare them: Pi, or else the residual.

        Pi counts all stresses, the residual the worst node: of two guesses the one of lower Pi
        takes fewer steps, by a third near the solution. With water Pi is known only where the
        pressures are those that follow from the displacements.
        """
        if not self.associated or self.n_pressures:
            return iterate.imbalance
        strain = self.operators.strain(iterate.du)
        Pi = -float(self.forces @ iterate.du)
        if self.linear is not None:
            ends = self.linear(0.0 * iterate.du) + self.linear(iterate.du)
            Pi += 0.5 * float(ends @ iterate.du)
        for ground, response in zip(self.grounds, iterate.responses, strict=True):
            points = ground.points
            stress = self.trial[:, points] + 0.5 * ground.elasticity.stress(strain[:, points])
            Pi += float(self.volume[points] @ (stress * strain[:, points]).sum(axis=0))
            if response is not None:
                Pi -= float(self.volume[response.points] @ response.projection.reserve)
        return Pi

    def tangent(self, iterate: Iterate, *, least: float = 0.0) -> Tangent:
        """The consistent tangent, factorized; with a part of the elastic one if need be.

        With non-associated flow pivots need not be positive, and nothing of the elastic stiffness
        is left at first: eigenvalues may be so small that it would be seen in derivatives.

        Args:
            iterate: displacements and plastic response.
            least: part of the elastic stiffness that is left at least.

        Raises:
            NotPositiveDefinite: the elastic stiffness itself is singular.
        """
        points, change = self._changes(iterate)
        parts = ELASTIC_PARTS if self.associated else (0.0, *ELASTIC_PARTS[1:])
        for part in (part for part in parts if part >= least):
            try:
                left = np.full(len(points), part)
                if part == parts[0]:  # structures are so much stiffer that it would be seen
                    left[~self.of_ground[points]] = 0.0
                factor = self.solver.factorize(
                    points, (1.0 - left)[:, None, None] * change, symmetric=self.associated
                )
            except NotPositiveDefinite:
                if part == parts[-1] or not len(points):
                    raise
            else:
                return Tangent(factor, points, change, consistent=part == parts[0])
        raise AssertionError

    def solve_consistently(self, tangent: Tangent, rest: Floats) -> Floats:
        """K_T^-1 r (n, k) of residuals (n, k), also where elastic stiffness is left in the factor.

        Then the factor is only the preconditioner of GMRES.

        Raises:
            SingularTangent: K_T is singular, and r is not in its range.
        """
        solution = tangent.factor.solve(rest)
        if tangent.consistent:
            return solution
        n = len(self.dofs)
        stiffness = spla.LinearOperator((n, n), lambda x: self._tangent_forces(tangent, x.ravel()))
        inverse = spla.LinearOperator((n, n), lambda r: tangent.solve(r.ravel()))
        for k, r in enumerate(rest.T):
            if not r.any():
                continue
            solution[:, k], left = spla.gmres(
                stiffness, r, solution[:, k], M=inverse, rtol=0.1 * _SOLVED,
                restart=_MOST_ITERATIONS, maxiter=1,
            )  # fmt: skip
            error = np.linalg.norm(r - stiffness.matvec(solution[:, k]))
            if left and error > _SOLVED * np.linalg.norm(r):
                raise SingularTangent
        return solution

    def _tangent_forces(self, tangent: Tangent, free: Floats) -> Floats:
        """K_T x (n,) of displacements x (n,) of the unknowns, N."""
        strain = self.operators.strain(self.spread(free))[:, tangent.points]
        stress = np.zeros_like(self.stress)
        stress[:, tangent.points] = np.einsum("qst,tq->sq", tangent.change, strain)
        change = self.operators.forces(stress, np.ones_like(self.volume))[self.dofs]
        return np.asarray(self.elastic_forces(free) + change)

    def length(self, free: Floats) -> float:
        """Of values (n,) at the unknowns: of displacements, not of pressures and rotations."""
        return float(np.sqrt(self.along(free, free)))

    def along(self, free: Floats, other: Floats) -> float:
        """Product of values (n,) at the unknowns with others, of the same."""
        n = len(free) - self.n_pressures - self.n_turns
        return float(free[:n] @ other[:n])

    def serves(self, tangent: Tangent, iterate: Iterate) -> bool:
        """Whether a tangent is that at another iterate: on the same pieces of the projection."""
        points, change = self._changes(iterate)
        if not (tangent.consistent and np.array_equal(points, tangent.points)):
            return False
        same = _SAME_TANGENT if self.associated else _SAME_GENERAL_TANGENT
        most = same * np.abs(change).max(initial=0.0)
        return bool(np.abs(change - tangent.change).max(initial=0.0) <= most)

    def _changes(self, iterate: Iterate) -> tuple[Ints, Floats]:
        """Points (q,) that yield, ascending, and (T E - E) V (q, s, s) there."""
        s = self.stress.shape[0]
        points, changes = [np.empty(0, dtype=np.int64)], [np.empty((0, s, s))]
        for response in iterate.flowing:
            points.append(response.points)
            changes.append(response.tangent_change * self.volume[response.points][:, None, None])
        joined = np.concatenate(points)
        order = np.argsort(joined, kind="stable")
        return joined[order], np.concatenate(changes)[order]

    def localising(self, iterate: Iterate) -> float:
        """The part of the strain points that yield at which shear may go into a band."""
        localising = [
            response.may_localise()
            for response in iterate.flowing
            if not response.ground.of_structure
        ]
        return float(np.concatenate(localising).mean()) if localising else 0.0

    def spread(self, free: Floats) -> Floats:
        """(n_dofs,) displacements of values (n,) at the unknowns."""
        full = np.zeros(self.forces.shape[0])
        full[self.dofs] = free
        return full

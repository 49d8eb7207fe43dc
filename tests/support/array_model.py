"""A model whose equations are `EquationArrays`: frames, plates, anything without meshes and cases.

It solves its stages with the program's own core (`forward.equilibrium`, `PolyhedralLaw`) and offers
what the complementarity methods need of a model.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from geoident.errors import CollapseError
from geoident.fem.elasticity import UniformModuli
from geoident.fem.yielding.plane_laws import PolyhedralLaw
from geoident.fem.yielding.planes import YieldPlanes
from geoident.forward.analysis.constitutive import MaterialPoints
from geoident.forward.analysis.equilibrium import Balance, solve
from geoident.forward.analysis.stage_equations import NoEquilibrium, StageEquations
from geoident.forward.equation_arrays import Affine, EquationArrays, LoadStage, PointLaw, bilinear
from geoident.model.arrays import Floats, Ints
from geoident.model.dual import Dual
from geoident.model.response import BilinearSystem
from geoident.model.results.costs import Counts
from geoident.model.yielding import Activity


@dataclass
class Operators:
    """C and C^T V of all point sets of a system side by side, component by component."""

    compatibility: sp.csr_array
    n_points: int

    def strain(self, u: Floats) -> Floats:
        return np.asarray(self.compatibility @ u).reshape(-1, self.n_points, *u.shape[1:])

    def forces(self, stress: Floats, volume: Floats) -> Floats:
        weighted = stress * volume.reshape((1, -1) + (1,) * (stress.ndim - 2))
        return np.asarray(self.compatibility.T @ weighted.reshape(-1, *stress.shape[2:]))


@dataclass
class DenseFactor:
    factor: spla.SuperLU

    def solve(self, rhs: Floats) -> Floats:
        return np.asarray(self.factor.solve(rhs))


@dataclass
class _Borne:
    """Stress (s, M, 1 + n) and multipliers (set to (y, m, 1 + n)) with their derivatives."""

    stress: Floats
    lam: dict[int, Floats]

    def copy(self) -> _Borne:
        return _Borne(self.stress.copy(), {s: lam.copy() for s, lam in self.lam.items()})


@dataclass
class ArrayModel:
    """Response, YieldSystem and ComplementaritySystem of a system of arrays."""

    staged: EquationArrays
    ratio: float = 0.0
    counts: Counts = field(default_factory=Counts)

    def __post_init__(self) -> None:
        sets = self.staged.sets
        self.s = sets[0].n_strain
        assert all(points.n_strain == self.s for points in sets)
        blocks = [p.compatibility.tocsr() for p in sets]
        by_component = [
            blocks[k][c * p.n_points : (c + 1) * p.n_points]
            for c in range(self.s)
            for k, p in enumerate(sets)
        ]
        count = sum(p.n_points for p in sets)
        self.operators = Operators(sp.vstack(by_component).tocsr(), count)
        ends = np.cumsum([0, *(p.n_points for p in sets)])
        self.places = [slice(int(a), int(b)) for a, b in pairwise(ends)]
        self.volume = np.concatenate([p.volume for p in sets])

    @property
    def names(self) -> tuple[str, ...]:
        return self.staged.names

    def system(self) -> BilinearSystem:
        return bilinear(self.staged, np.ones(len(self.names)))

    def system_obstacle(self) -> str | None:
        return None

    def admissible(self, p: Floats) -> str | None:
        return None

    def yields(self) -> bool:
        return True

    def readings(self, p: Floats) -> Floats:
        return self.evaluate(p)[0]

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        self.counts = replace(self.counts, evaluations=self.counts.evaluations + 1)
        table = np.zeros((self.staged.rows.shape[0], 1 + len(self.names)))
        for number, (du, _, _) in enumerate(self.analysis(p)):
            table += self.staged.active[number][:, None] * (self.staged.rows @ du)
        table[:, 0] += self.staged.offset.at(p)
        table[:, 1:] += self.staged.offset.slopes
        return table[:, 0], table[:, 1:]

    def analysis(self, p: Floats) -> list[tuple[Floats, _Borne, dict[int, Floats]]]:
        """Steps of displacements with derivatives, what is borne, multipliers of the stage."""
        done: list[tuple[Floats, _Borne, dict[int, Floats]]] = []
        for stage in self.staged.stages:
            borne = self._virgin(p) if stage.base < 0 else done[stage.base][1].copy()
            for s in stage.fresh:
                borne.stress[:, self.places[s]] = 0.0
                borne.lam.pop(s, None)
            done.append(self._stage(stage, p, borne))
        return done

    def activity(self, p: Floats) -> Activity:
        pairs = [
            (s, law, a)
            for s, law in sorted({x for stage in self.staged.stages for x in stage.laws.items()})
            for a in range(self.staged.laws[law].n_planes)
        ]
        points = np.zeros((len(pairs), len(self.staged.stages)), dtype=np.int64)
        reached = np.full(len(pairs), -np.inf)
        distances, slopes = np.zeros(len(pairs)), np.zeros((len(pairs), len(self.names)))
        for j, (_, borne, steps) in enumerate(self.analysis(p)):
            for r, (s, law, a) in enumerate(pairs):
                law_ = self.staged.laws[law]
                distances[r] = law_.distances.at(p)[a]
                slopes[r] = law_.distances.slopes[a]
                if self.staged.stages[j].laws.get(s) == law:
                    points[r, j] = int((steps[s][a] > 0.0).sum())
                    stress = law_.normals[a] @ borne.stress[:, self.places[s], 0]
                    reached[r] = max(reached[r], stress.max())
        names = tuple(f"{self.staged.sets[s].name}: plane {a + 1}" for s, _, a in pairs)
        stages = tuple(stage.name for stage in self.staged.stages)
        return Activity(names, stages, points, np.zeros_like(points), distances, reached, slopes)

    def _virgin(self, p: Floats) -> _Borne:
        stress = np.zeros((self.s, self.operators.n_points, 1 + len(self.names)))
        for place, points in zip(self.places, self.staged.sets, strict=True):
            stress[:, place, 0] = points.initial.at(p)
            stress[:, place, 1:] = points.initial.slopes
        return _Borne(stress, {})

    def _stage(
        self, stage: LoadStage, p: Floats, borne: _Borne
    ) -> tuple[Floats, _Borne, dict[int, Floats]]:
        n = len(self.names)
        present = np.zeros(self.operators.n_points)
        for s in stage.laws:
            present[self.places[s]] = 1.0
        borne.stress *= present[:, None]
        for s, law in stage.laws.items():
            shape = (self.staged.laws[law].n_planes, self.staged.sets[s].n_points, 1 + n)
            if borne.lam.get(s, np.empty(0)).shape != shape:
                borne.lam[s] = np.zeros(shape)
        equations = self._equations(stage, p, borne, self.volume * present)
        try:
            balance = solve(equations, [np.zeros(self.staged.n_dofs)])
        except NoEquilibrium as error:
            msg = f"at stage '{stage.name}' the loads cannot be carried"
            raise CollapseError(msg, stage=stage.name, fraction=np.nan) from error
        return self._differentiated(stage, p, borne, equations, balance)

    def _equations(
        self, stage: LoadStage, p: Floats, borne: _Borne, volume: Floats
    ) -> StageEquations:
        grounds = []
        for s, law in stage.laws.items():
            given = self.staged.laws[law]
            E = given.elasticity.at(p)
            yielding = None
            if given.n_planes:
                moduli = _dual(given.elasticity, p)
                yielding = PolyhedralLaw(moduli, self._planes(given, moduli, p))
            hardened = borne.lam[s][..., 0]
            grounds.append(
                MaterialPoints(str(s), self.places[s], UniformModuli(E), yielding, hardened)
            )
        stiffness = self._stiffness(grounds, volume)[stage.dofs][:, stage.dofs]

        def tangents(points: Ints, change: Floats, *, symmetric: bool) -> DenseFactor:
            rows = (np.arange(self.s)[:, None] * self.operators.n_points + points).T
            C = self.operators.compatibility[:, stage.dofs]
            more = sum(
                (C[r].T @ (c @ C[r].toarray()) for r, c in zip(rows, change, strict=True)),
                np.zeros(stiffness.shape),
            )
            return DenseFactor(spla.splu(sp.csc_array(stiffness + more)))

        begun = np.ascontiguousarray(borne.stress[..., 0])
        return StageEquations(
            self.operators,
            volume=volume,
            dofs=stage.dofs,
            grounds=grounds,
            stress=begun,
            trial=begun,
            forces=stage.forces.at(p),
            solver=SimpleNamespace(factorize=tangents),
        )

    def _planes(self, law: PointLaw, E: Dual, p: Floats) -> YieldPlanes:
        H = _dual(law.hardening, p)
        if self.ratio:
            own = np.einsum("yi,ijc,yj->yc", law.normals, E.columns, law.normals)
            H = H + Dual(self.ratio * own) * np.eye(law.n_planes)
        normals = Dual.constant(law.normals, len(p))
        return YieldPlanes(
            normals, _dual(law.distances, p), hardening=H if H.columns.any() else None
        )

    def _stiffness(self, grounds: list[MaterialPoints], volume: Floats) -> Floats:
        E = np.zeros((self.s, self.s, self.operators.n_points))
        for ground in grounds:
            first = np.zeros(1, dtype=np.int64)
            E[:, :, ground.points] = ground.elasticity.matrices(first)[0][..., None]
        moduli = sp.block_array(
            [[sp.diags_array(E[a, b] * volume) for b in range(self.s)] for a in range(self.s)]
        )
        C = self.operators.compatibility
        return np.asarray((C.T @ moduli @ C).toarray())

    def _differentiated(
        self, stage: LoadStage, p: Floats, borne: _Borne, equations: StageEquations, found: Balance
    ) -> tuple[Floats, _Borne, dict[int, Floats]]:
        trial, n = found.end, len(self.names)
        strain = self.operators.strain(trial.du)
        slopes = borne.stress[..., 1:].copy()
        dlam = {s: np.zeros_like(borne.lam[s]) for s in stage.laws}
        flowing = []
        for (s, law), ground, flow in zip(
            stage.laws.items(), equations.grounds, trial.responses, strict=True
        ):
            given, mine = self.staged.laws[law], np.arange(self.operators.n_points)[ground.points]
            slopes[:, mine] += np.einsum("abh,bm->amh", given.elasticity.slopes, strain[:, mine])
            if flow is not None and flow.points.size:
                projection, where = flow.projection, flow.points
                before = borne.lam[s][:, projection.yielded, 1:]
                slopes[:, where], more = projection.derivatives(
                    slopes[:, where], before, of_law=True
                )
                dlam[s][:, projection.yielded, 0] = projection.multipliers.T
                dlam[s][:, projection.yielded, 1:] += more
                flowing.append((s, projection, where))
        rest = stage.forces.slopes - self.operators.forces(slopes, equations.volume)
        du = np.zeros((len(trial.du), 1 + n))
        du[:, 0] = trial.du
        factor = equations.tangent(trial).factor
        du[stage.dofs, 1:] = factor.solve(rest[stage.dofs])
        more = self.operators.strain(du[:, 1:])
        for ground in equations.grounds:
            more[:, ground.points] = ground.elasticity.stress(more[:, ground.points])
        for s, projection, where in flowing:
            more[:, where], extra = projection.derivatives(more[:, where], of_law=False)
            dlam[s][:, projection.yielded, 1:] += extra
        stress = np.concatenate([trial.stress[..., None], slopes + more], axis=2)
        lam = {s: borne.lam[s] + dlam[s] for s in stage.laws}
        kept = {s: old for s, old in borne.lam.items() if s not in lam}
        return du, _Borne(stress, kept | lam), {s: step[..., 0] for s, step in dlam.items()}


def _dual(array: Affine, p: Floats) -> Dual:
    """An affine array at parameters (n,), with its derivatives."""
    return Dual(np.concatenate([array.at(p)[..., None], array.slopes], axis=-1))


def solved_at_once(system: BilinearSystem, p: Floats) -> Floats:
    """Readings (g,) at p (n,), SI, of one linear system of all stages in which nothing yields."""
    vector, matrix = system.equations.at(p)
    found = np.zeros(matrix.shape[1])
    moving = np.setdiff1d(np.arange(len(found)), system.multipliers)
    found[moving] = spla.spsolve(matrix.tocsc()[:, moving], -vector)
    vector, matrix = system.readings.at(p)
    return np.asarray(vector + matrix @ found)

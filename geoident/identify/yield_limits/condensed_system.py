"""The condensed complementarity system (theory 5): displacements eliminated, dense.

With the elastic moduli given, everything is linear in the parameters p and the multipliers lam of
all stages, one after the other:

    s = s_0 + S_p p + M lam + h(p, lam) >= 0     lam >= 0     s^T lam = 0
    v = v_0 + V_p p + V_lam lam

s is the slack k + H lam - N^T sigma of every plane at every present point; M = -N^T Z N + H, lower
block triangular by stages, holds the influence of every multiplier on every plane. Hardening that
is itself a parameter adds h, the only product. All is scaled: slacks, multipliers and parameters
by their sizes, so that all numbers are of the order of one; readings in standard deviations.

One factorization a stage, as many columns as there are pairs: for small systems only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.identify.problem.problem import Problem
from geoident.identify.yield_limits.elastic_march import ElasticStep, elastic_march, readings_of
from geoident.model.arrays import Floats, Ints
from geoident.model.equations import StagedSystem


@dataclass(frozen=True)
class Influence:
    """The condensed system, scaled. q pairs, n parameters, g readings.

    Args:
        slack: s at p = 0, lam = 0, (q,).
        slack_by_p: (q, n).
        slack_by_lam: (q, q).
        misfit: (v - v*) / sd at p = 0, lam = 0, and the priors' rows, (g,).
        misfit_by_p: (g, n).
        misfit_by_lam: (g, q).
        products: parameter to (q, q): h = sum_h p_h (products[h] lam).
        lower: (n,) bounds of the scaled parameters.
        upper: (n,).
        reference: (n,) p in SI = reference times scaled p.
        work: (q,) what scaled s times scaled lam stand for, times the volume: J, to one scale.
        multiplier_size: (q,) lam = this times the scaled one.
    """

    slack: Floats
    slack_by_p: Floats
    slack_by_lam: Floats
    misfit: Floats
    misfit_by_p: Floats
    misfit_by_lam: Floats
    products: dict[int, Floats]
    lower: Floats
    upper: Floats
    reference: Floats
    work: Floats
    multiplier_size: Floats

    @property
    def n_pairs(self) -> int:
        """Number q of complementarities."""
        return int(self.slack.shape[0])

    def only(self, kept: Ints) -> Influence:
        """The system in which only the pairs (k,) may be active: other multipliers are zero."""
        square = np.ix_(kept, kept)
        return Influence(
            self.slack[kept],
            self.slack_by_p[kept],
            self.slack_by_lam[square],
            self.misfit,
            self.misfit_by_p,
            self.misfit_by_lam[:, kept],
            {h: product[square] for h, product in self.products.items()},
            self.lower,
            self.upper,
            self.reference,
            self.work[kept],
            self.multiplier_size[kept],
        )


def influence(problem: Problem, system: StagedSystem) -> Influence:
    """Condense the equations of a model.

    Args:
        problem: readings and parameters with finite bounds.
        system: its equations, with moduli that no parameter moves.
    """
    return _Condenser(problem, system).influence()


@dataclass(frozen=True)
class _Planes:
    """The pairs of one point set in one stage: y planes at m points, plane by plane."""

    stage: int
    points: int
    law: int
    first: int
    count: int


class _Condenser:
    def __init__(self, problem: Problem, system: StagedSystem) -> None:
        self.problem, self.system = problem, system
        self.n = len(system.names)
        self.lower = np.array([q.lower for q in problem.parameters])
        self.upper = np.array([q.upper for q in problem.parameters])
        self.reference = np.maximum(np.maximum(abs(self.lower), abs(self.upper)), 1e-300)
        self.E = [law.elasticity.constant for law in system.laws]
        self.pairs: list[_Planes] = []
        first = 0
        for j, stage in enumerate(system.stages):
            for s, law in stage.laws.items():
                count = system.laws[law].n_planes * system.sets[s].n_points
                self.pairs.append(_Planes(j, s, law, first, count))
                first += count
        self.q = first

    def influence(self) -> Influence:
        steps = self.march()
        size = self.stress_sizes(steps)
        table = np.zeros((self.q, 1 + self.n + self.q))
        lam_size, slack_size = np.ones(self.q), np.ones(self.q)
        products: dict[int, Floats] = {}
        for pair in self.pairs:
            law, rows = self.system.laws[pair.law], slice(pair.first, pair.first + pair.count)
            table[rows] = self.slack(pair, steps[pair.stage])
            slack_size[rows] = size[pair.points]
            moduli = np.einsum("yi,ij,yj->y", law.normals, self.E[pair.law], law.normals)
            m = self.system.sets[pair.points].n_points
            lam_size[rows] = np.repeat(size[pair.points] / moduli, m)
        self.add_hardening(table, products)
        by_lam = table[:, 1 + self.n :] / slack_size[:, None] * lam_size
        sd, r = self.problem.sd, readings_of(self.system, steps)
        r[:, 0] += self.system.offset.constant - self.problem.measured
        r[:, 1 : 1 + self.n] += self.system.offset.slopes
        r /= sd[:, None]
        r = np.vstack([r, self.priors()])
        return Influence(
            table[:, 0] / slack_size,
            table[:, 1 : 1 + self.n] / slack_size[:, None] * self.reference,
            by_lam,
            r[:, 0],
            r[:, 1 : 1 + self.n] * self.reference,
            r[:, 1 + self.n :] * lam_size,
            {
                h: product / slack_size[:, None] * lam_size * self.reference[h]
                for h, product in products.items()
            },
            self.lower / self.reference,
            self.upper / self.reference,
            self.reference,
            self.volumes() * lam_size * slack_size,
            lam_size,
        )

    def priors(self) -> Floats:
        """Rows (p - mean) / sd of the normal priors, as misfits."""
        rows = []
        for h, q in enumerate(self.problem.parameters):
            if q.prior is not None:
                row = np.zeros(1 + self.n + self.q)
                row[0], row[1 + h] = -q.prior.mean / q.prior.sd, 1.0 / q.prior.sd
                rows.append(row)
        return np.array(rows).reshape(len(rows), 1 + self.n + self.q)

    def volumes(self) -> Floats:
        """(q,) V of the strain point of every pair."""
        parts = [
            np.tile(self.system.sets[pair.points].volume, self.system.laws[pair.law].n_planes)
            for pair in self.pairs
        ]
        return np.concatenate(parts)

    def march(self) -> list[ElasticStep]:
        """All stages, in the columns 1, p, lam."""
        system, wide = self.system, 1 + self.n + self.q
        initial = {}
        for s, points in enumerate(system.sets):
            stress = np.zeros((points.n_strain, points.n_points, wide))
            stress[..., 0] = points.initial.constant
            stress[..., 1 : 1 + self.n] = points.initial.slopes
            initial[s] = stress
        forces = []
        for stage in system.stages:
            force = np.zeros((system.n_dofs, wide))
            force[:, 0] = stage.forces.constant
            force[:, 1 : 1 + self.n] = stage.forces.slopes
            forces.append(force)
        found = {(pair.stage, pair.points): pair for pair in self.pairs}

        def plastic(stage: int, s: int) -> Floats | None:
            return self.plastic_strain(found[stage, s])

        return list(elastic_march(system, self.E, initial=initial, forces=forces, plastic=plastic))

    def plastic_strain(self, pair: _Planes) -> Floats | None:
        """N lam (s, m, K) of the pairs' own columns."""
        if pair.count == 0:
            return None
        normals, m = self.system.laws[pair.law].normals, self.system.sets[pair.points].n_points
        strain = np.zeros((normals.shape[1], m, 1 + self.n + self.q))
        at = np.arange(m)
        for a, normal in enumerate(normals):
            column = 1 + self.n + pair.first + a * m + at
            strain[:, at, column] = normal[:, None]
        return strain

    def slack(self, pair: _Planes, step: ElasticStep) -> Floats:
        """K - N^T sigma (y m, K)."""
        law, m = self.system.laws[pair.law], self.system.sets[pair.points].n_points
        table = -np.tensordot(law.normals, step.stress[pair.points], axes=1)
        table[..., 0] += law.distances.constant[:, None]
        table[..., 1 : 1 + self.n] += law.distances.slopes[:, None]
        return np.asarray(table.reshape(law.n_planes * m, -1))

    def add_hardening(self, table: Floats, products: dict[int, Floats]) -> None:
        """H times the multipliers of this and all earlier stages of the same history."""
        for pair in self.pairs:
            law, m = self.system.laws[pair.law], self.system.sets[pair.points].n_points
            rows = slice(pair.first, pair.first + pair.count)
            for before in self.history(pair):
                first = 1 + self.n + before.first
                table[rows, first : first + before.count] += np.kron(
                    law.hardening.constant, np.eye(m)
                )
                for h in np.flatnonzero(law.hardening.depends_on):
                    product = products.setdefault(int(h), np.zeros((self.q, self.q)))
                    product[rows, before.first : before.first + before.count] += np.kron(
                        law.hardening.slopes[..., h], np.eye(m)
                    )

    def history(self, pair: _Planes) -> list[_Planes]:
        """The pairs whose multipliers a pair remembers, its own first."""
        found = {(p.stage, p.points): p for p in self.pairs}
        result, stage = [pair], pair.stage
        while pair.points not in self.system.stages[stage].fresh:
            stage = self.system.stages[stage].base
            before = found.get((stage, pair.points))
            if before is None or before.count != pair.count:
                break
            result.append(before)
        return result

    def stress_sizes(self, steps: list[ElasticStep]) -> Floats:
        """(n_sets,) largest elastic stress within the bounds, by its parts, Pa."""
        size = np.zeros(len(self.system.sets))
        weights = np.concatenate([[1.0], self.reference])
        for step in steps:
            for s, stress in step.stress.items():
                largest = (np.abs(stress[..., : 1 + self.n]) @ weights).max(initial=0.0)
                size[s] = max(size[s], float(largest))
        return np.asarray(np.where(size > 0.0, size, size.max(initial=0.0) or 1.0))

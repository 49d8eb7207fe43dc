"""Derivatives of readings by adjoints: the elastic stages backwards (theory 2 and 10.6).

The tangents of `stage` carry one column for every parameter through the stages. The adjoint carries
one for every reading, from the last stage to the first: what costs less is a matter of numbers.

Let a reading depend on the states by ubar_l = dv/du_l and sbar_l = dv/dsigma_l. With b the *adjoint
strain* (dv/dsigma = -V b), the analysis of a stage on its base, backwards, is

    K_l lambda_l = ubar_l - C^T V E_l a_l ,    b_l = a_l + C lambda_l

with a_l the sum over the stages that build on l of their b, zero at points that they take away or
place anew, less sbar_l / V. Then

    dv/dp  +=  lambda_l^T df_l/dp - sum V b_l^T (dE_l/dp eps_l - E_l deps0_l/dp)

and for a mode of a field, dE/dxi_k = D Phi_k, the products V b^T D eps of all stages are added up
at the points and meet the modes once, in one product of two dense matrices.

Where nothing is taken away a is C M, with M the sum of the adjoint displacements w = lambda + M of
the stages that build on this one. So only the difference d = a - C M is carried, and only at the
points that some stage takes away or at which a stress is read:

    K_l w_l = ubar_l - C^T V E_l d_l ,    b_l = C w_l + d_l

At degrees of freedom that are held in a stage and not in a later one lambda is zero and w = M, so
the forces of these M join the right side.

Forces of structures are stresses of further points, with D in place of E. What a partial release
holds of a group, H = f - C^T V sigma, has the adjoint Hbar: it adds C Hbar to a of the state that
the group leaves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from geoident.fem.kinematics import NORMAL_COMPONENTS
from geoident.forward.analysis.analysis import StagedAnalysis
from geoident.forward.analysis.stage import ElasticTrace, FactorCache, LinearRows, StageTask
from geoident.forward.ground.elasticity import ModeSlopes
from geoident.forward.stages import Index, numbers
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import ParameterPoint

_AT_ONCE = 48
"""Readings that are taken back together."""

EachAdjoint = Callable[[int, Ints, Floats], None]
"""Is given a state, the numbers (k,) of readings, and their lambda (n_dofs, k) there."""


@dataclass(frozen=True, eq=False)
class ReadingSeeds:
    """How readings (g) depend on the states.

    Args:
        rows: what the channels (c) that are read see of a state.
        channel: (g,) which of these channels each reading is of.
        stage: (g,) its state.
        zero: (g,) the state of its zero.
        weights: (2, g) how often it counts the state of its stage and that of its zero.
    """

    rows: LinearRows
    channel: Ints
    stage: Ints
    zero: Ints
    weights: Floats

    @property
    def count(self) -> int:
        """Number g."""
        return len(self.stage)

    def at(self, state: int) -> Floats:
        """(g,) weight of a state in every reading."""
        at_stage = self.weights[0] * (self.stage == state)
        return np.asarray(at_stage + self.weights[1] * (self.zero == state))


def reach(bases: Sequence[int], states: Floats) -> Bools:
    """Which readings a state acts on: (n_states, g).

    Args:
        bases: the state on which each state builds.
        states: (n_states, g) weight of every state in every reading.
    """
    acts = states != 0.0
    for state in range(len(bases) - 1, 0, -1):
        acts[bases[state]] |= acts[state]
    return np.asarray(acts)


@dataclass
class _Adjoint:
    """What stages that build on a state leave it, for some readings (k).

    Args:
        M: (n_dofs, k) sum of their adjoint displacements.
        u: (n_read, k) adjoint of the displacements that are read.
        d: (n_strain, n_special, k) adjoint strain beside that of M.
        members: (n_rows, k) the same of structures.
        unreleased: group to Hbar (n_dofs, k).
    """

    M: Floats
    u: Floats
    d: Floats
    members: Floats
    unreleased: dict[int, Floats] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Work:
    """What dsigma/dp of a stage, with du held fixed, adds to derivatives of readings by parameters.

    Args:
        by_field: modes, V D eps (n_strain, q) at all points of their field, and its work on
            displacements (q, n_dofs).
        forces: (n_dofs, n) the nodal forces C^T V dsigma/dp by the parameters that are no modes.
        direct: (n_strain, n_special, n) V dsigma/dp at the special points.
    """

    by_field: list[tuple[ModeSlopes, Floats, sp.csr_array]]
    forces: Floats
    direct: Floats


def _together(places: Ints) -> Index:
    """Ascending places as a slice where they stand together: no copies."""
    first, last = int(places[0]), int(places[-1])
    return slice(first, last + 1) if last - first + 1 == len(places) else places


class AdjointPlan:
    """The way back for some readings: what is the same at all parameter vectors.

    Args:
        analysis: what does not depend on parameters.
        seeds: the readings; of their rows only the places of displacements and stresses count.
        last: number of the last state.
    """

    def __init__(self, analysis: StagedAnalysis, seeds: ReadingSeeds, last: int) -> None:
        self.systems = analysis.systems
        self.states = analysis.sequence.states[: last + 1]
        self.weights = np.array([seeds.at(n) for n in range(len(self.states))])
        acts = reach([state.base for state in self.states], self.weights)
        self.columns = [np.flatnonzero(row) for row in acts]
        points = self.systems.discretization.points
        self.special = np.flatnonzero(self._special_points(seeds.rows))
        self.place = np.full(points.n_points, -1)
        self.place[self.special] = np.arange(len(self.special))
        self.read = np.empty(0, np.int64)
        if seeds.rows.u is not None:
            self.read = np.unique(seeds.rows.u.indices)
        self.strain = points.compatibility(self.special)
        self.forces = sp.csr_array(self.strain.T)

    def _special_points(self, rows: LinearRows) -> Bools:
        """(n_points,) those that some stage takes away or places anew, or whose stress is read."""
        n_points = self.systems.discretization.points.n_points
        special = np.zeros(n_points, dtype=bool)
        for number, state in enumerate(self.states[1:], start=1):
            special |= self.cleared(number) & self.systems[state.base].present
        if rows.stress is not None:
            special[np.unique(rows.stress.indices) % n_points] = True
        return special

    def cleared(self, state: int) -> Bools:
        """(n_points,) strain points that begin a stage without stress."""
        cleared = ~self.systems[state].present
        for group in self.states[state].placed:
            cleared[self.systems.discretization.points_of[group]] = True
        return cleared


class AdjointAnalysis:
    """The way back through the stages of one elastic run.

    Args:
        analysis: what does not depend on parameters.
        plan: what is the same at all parameter vectors.
        traces: of the states 0, 1, ... of the run.
        factors: those of the run.
        point: all n parameters.
        seeds: the readings.
        each: is given the adjoint displacements of every stage.
    """

    def __init__(
        self,
        analysis: StagedAnalysis,
        plan: AdjointPlan,
        traces: Sequence[ElasticTrace],
        factors: FactorCache,
        point: ParameterPoint,
        seeds: ReadingSeeds,
        each: EachAdjoint | None = None,
    ) -> None:
        self._analysis, self._plan, self._each = analysis, plan, each
        self._traces, self._factors = traces, factors
        self._point, self._seeds = point, seeds
        self._point_without_modes = analysis.without_modes(point)
        self._systems = analysis.systems
        self._points = analysis.systems.discretization.points
        self._structures = analysis.systems.structures
        self._fields = {id(one): number for number, one in enumerate(analysis.on_mesh.fields)}
        self._first = 0  # of the readings that are looked at
        self._by_ordinary = np.zeros((seeds.count, len(self._point_without_modes.names)))
        self._by_field: dict[int, Floats] = {}  # (q, count) by field
        self._prepared: dict[int, _Work] = {}
        self._left: dict[int, list[tuple[Ints, _Adjoint]]] = {}

    def jacobian(self) -> Floats:
        """dv/dp (g, n) of the readings, what gauges add by themselves aside.

        Some readings at a time: what is done to them then stays near the processor.
        """
        places = {name: k for k, name in enumerate(self._point.names)}
        result = np.zeros((self._seeds.count, len(places)))
        for first in range(0, self._seeds.count, _AT_ONCE):
            part = result[first : first + _AT_ONCE]
            self._first = first
            self._by_ordinary = np.zeros((len(part), len(self._point_without_modes.names)))
            self._by_field = {
                n: np.zeros((len(field.points), len(part)))
                for n, field in enumerate(self._analysis.on_mesh.fields)
            }
            for state in reversed(range(len(self._traces))):
                reached = self._plan.columns[state]
                ends = np.searchsorted(reached, (first, first + len(part)))
                if ends[0] < ends[1]:
                    self._stage(state, reached[ends[0] : ends[1]] - first)
            part[:, [places[name] for name in self._point_without_modes.names]] = self._by_ordinary
            for n, products in self._by_field.items():
                field = self._analysis.on_mesh.fields[n]
                known = [k for k, name in enumerate(field.names) if name in places]
                modes = field.modes if len(known) == len(field.names) else field.modes[:, known]
                part[:, [places[field.names[k]] for k in known]] -= products.T @ modes
        return result

    def _stage(self, number: int, columns: Ints) -> None:
        """One stage backwards, for some readings (k) of this part."""
        trace = self._traces[number]
        adjoint = self._collect_from_later(number, columns)
        if number == 0:
            adjoint.u[:] = 0.0  # the motion to balance is forgotten
        w = adjoint.M
        if trace.stepped:
            w = self._solved(trace.task, adjoint)
            if self._each is not None:
                self._each(number, self._first + columns, w - adjoint.M)
            self._forces(trace, w, adjoint, columns)
        self._strains(trace, w, adjoint.d, columns)
        member = self._members(trace, w, adjoint, columns)
        if number:
            self._pass_to_base(trace, w, adjoint, member, columns)

    def _collect_from_later(self, number: int, columns: Ints) -> _Adjoint:
        """What a state is left by those that build on it, and by its own readings."""
        k, s, n_dofs = len(columns), self._points.n_strain, self._systems.discretization.n_dofs
        parts = self._left.pop(number, [])
        if len(parts) == 1 and len(parts[0][0]) == k:
            adjoint = parts[0][1]
        else:
            adjoint = _Adjoint(
                np.zeros((n_dofs, k)),
                np.zeros((len(self._plan.read), k)),
                np.zeros((s, len(self._plan.special), k)),
                np.zeros((self._structures.n_rows, k)),
            )
            for later, part in parts:
                at = _together(np.searchsorted(columns, later))
                adjoint.M[:, at] += part.M
                adjoint.u[:, at] += part.u
                adjoint.d[..., at] += part.d
                adjoint.members[:, at] += part.members
                for group, unreleased in part.unreleased.items():
                    adjoint.unreleased.setdefault(group, np.zeros((n_dofs, k)))[:, at] += unreleased

        weights = self._plan.weights[number, self._first + columns]
        seeded = np.flatnonzero(weights)
        if not len(seeded):
            return adjoint
        rows, channels = self._seeds.rows, self._seeds.channel[self._first + columns[seeded]]
        scale = sp.diags_array(weights[seeded])
        if rows.u is not None:
            own = sp.csr_array(scale @ rows.u[channels])[:, self._plan.read]
            adjoint.u[:, seeded] += own.T.toarray()
        if rows.stress is not None:
            stress = sp.csr_array(scale @ rows.stress[channels]).tocoo()
            component, point = np.divmod(stress.col, self._points.n_points)
            place = component, self._plan.place[point], seeded[stress.row]
            np.add.at(adjoint.d, place, -stress.data / self._points.volume[point])
        if rows.members is not None and self._structures.n_rows:
            forces = (scale @ rows.members[channels]).T.toarray()
            adjoint.members[:, seeded] -= forces / self._structures.weight[:, None]
        return adjoint

    def _solved(self, task: StageTask, adjoint: _Adjoint) -> Floats:
        """The adjoint displacements w (n_dofs, k)."""
        structures, dofs = self._structures, task.system.dofs
        rest = -(self._plan.forces @ self._special_stress(task, adjoint.d))
        rest[self._plan.read] += adjoint.u
        if structures.n_rows:
            rest -= structures.nodal_forces(task.rigidities[:, :1] * adjoint.members)
        # at supports that hold now and not later w = M, since lambda is zero
        fixed = task.system.touched.copy()
        fixed[dofs] = False
        let_go = np.where(fixed[:, None], adjoint.M, 0.0) if np.any(adjoint.M[fixed]) else None
        if let_go is not None:
            stress, moduli = self._points.strain(let_go), task.moduli_by_material()
            for material, points in task.system.points_of.items():
                stress[:, points] = moduli[material].stress(stress[:, points])
            rest -= self._points.forces(stress, task.system.volume)
            if structures.n_rows:
                rest -= structures.nodal_forces(task.rigidities[:, :1] * structures.strain(let_go))
        factor = self._factors.factor(task, self._systems)
        right = rest[dofs]
        rest[:] = 0.0
        if factor is not None:
            rest[dofs] = factor.solve(right)
        return rest if let_go is None else rest + let_go

    def _special_stress(self, task: StageTask, d: Floats) -> Floats:
        """V E d (n_strain n_special, k) at the special points, zero where they are absent."""
        stress, moduli = np.zeros_like(d), task.moduli_by_material()
        for material, points in task.system.points_of.items():
            place = self._plan.place[points]
            special = np.flatnonzero(place >= 0)
            if len(special):
                stress[:, place[special]] = (
                    moduli[material].at(special).stress(d[:, place[special]])
                )
        stress *= task.system.volume[self._plan.special][None, :, None]
        return stress.reshape(d.shape[0] * d.shape[1], d.shape[2])

    def _forces(self, trace: ElasticTrace, w: Floats, adjoint: _Adjoint, columns: Ints) -> None:
        """Take lambda = w - M to the parameters of forces, given motions and release."""
        task, dofs, ordinary = trace.task, trace.task.system.dofs, self._point_without_modes
        release = self._analysis.release
        slopes = np.zeros_like(trace.slopes)
        slopes[dofs] = trace.slopes[dofs]
        released = {group: release.part(task.number, group, ordinary) for group in trace.unreleased}
        for group, support in trace.unreleased.items():
            slopes[dofs] -= np.outer(support[dofs], released[group].columns[1:])
        self._by_ordinary[columns] += w.T @ slopes - adjoint.M.T @ slopes
        motion = self._imposed(task.number)
        if motion is not None:
            self._by_ordinary[columns] += adjoint.u.T @ motion[self._plan.read]
        for group in trace.unreleased:
            unreleased = adjoint.unreleased.setdefault(group, np.zeros_like(adjoint.M))
            unreleased[dofs] += (1.0 - float(released[group].value)) * (w[dofs] - adjoint.M[dofs])
            if group in task.state.leaving:
                own = self._analysis.actions.carried(task.state.base, {group}, ordinary)[:, 1:]
                self._by_ordinary[columns] += unreleased.T @ own

    def _imposed(self, number: int) -> Floats | None:
        """Derivatives (n_dofs, n) of the displacement step that supports impose; None for none."""
        motion = self._analysis.motions.change(number, self._point_without_modes)
        return None if motion is None else motion[:, 1:]

    def _strains(self, trace: ElasticTrace, w: Floats, d: Floats, columns: Ints) -> None:
        """Take b = C w + d of a stage to the parameters of its moduli and strains.

        The product V b^T D eps is computed without forming b.
        """
        number, place = trace.task.number, self._plan.place
        if number not in self._prepared:
            self._prepared[number] = self._work_of(trace)
        work = self._prepared[number]
        for modes, change, operator in work.by_field:
            products = operator @ w
            special = place[modes.field.points]
            also = np.flatnonzero(special >= 0)
            products[also] += np.einsum("sq,sqk->qk", change[:, also], d[:, special[also]])
            self._by_field[self._fields[id(modes.field)]][:, _together(columns)] += products
        direct = np.einsum("sqk,sqn->kn", d, work.direct, optimize=True)
        self._by_ordinary[columns] -= w.T @ work.forces + direct

    def _work_of(self, trace: ElasticTrace) -> _Work:
        """For each parameter, the nodal forces C^T V dsigma/dp with du held fixed.

        And the same stress at the special points.
        """
        points, task, ordinary = self._points, trace.task, self._point_without_modes
        volume = task.system.volume
        by_ordinary = np.zeros((points.n_strain, points.n_points, len(ordinary.names)))
        by_field = []
        if trace.in_situ is not None:
            by_ordinary += trace.in_situ
        strain = points.strain(trace.du) if trace.stepped else np.zeros(by_ordinary.shape[:2])
        thermal = self._analysis.thermal.change(task.number, ordinary) if task.number else None
        if thermal is not None:
            strain[:NORMAL_COMPONENTS] -= thermal[:, 0]
        motion = self._imposed(task.number)
        imposed = None if motion is None else points.strain(motion)
        for material, at in task.system.points_of.items():
            moduli = task.ground_moduli.moduli(material, at)
            if imposed is not None:
                by_ordinary[:, at] += moduli.value.stress(imposed[:, at])
            if trace.stepped:
                for name, slope in moduli.slopes.items():
                    if name in ordinary.names:
                        k = ordinary.names.index(name)
                        by_ordinary[:, at, k] += slope.stress(strain[:, at])
                for modes in moduli.modes:
                    # absent points of the field have no work: so no rows need be picked
                    change = np.zeros((points.n_strain, len(modes.field.points)))
                    rows = slice(None) if modes.places is None else modes.places
                    change[:, rows] = modes.moduli.stress(strain[:, at]) * volume[at]
                    operator = self._systems.work(modes.field.points, change)
                    by_field.append((modes, change, operator))
            if thermal is not None:
                normal = np.zeros((points.n_strain, *thermal[at, 1:].shape))
                normal[:NORMAL_COMPONENTS] = thermal[at, 1:]
                by_ordinary[:, at] -= moduli.value.stress(normal)
        special = self._plan.special
        direct = volume[special, None] * by_ordinary[:, special]
        return _Work(by_field, points.forces(by_ordinary, volume), direct)

    def _members(self, trace: ElasticTrace, w: Floats, adjoint: _Adjoint, columns: Ints) -> Floats:
        """The same of structures, for rigidities and given forces; returns B w (n_rows, k)."""
        structures, task = self._structures, trace.task
        if not structures.n_rows:
            return np.zeros((0, w.shape[1]))
        seen = structures.strain(w)
        weighted = structures.weight[:, None] * (seen + adjoint.members)
        slopes = np.zeros((structures.n_rows, len(self._point_without_modes.names)))
        if trace.stepped:
            moduli = structures.moduli(task.state, self._point_without_modes)[:, 1:]
            slopes += moduli * structures.strain(trace.du)[:, None]
        motion = self._imposed(task.number)
        if motion is not None:
            slopes += task.rigidities[:, :1] * structures.strain(motion)
        if task.state.stressed:
            begun = np.zeros((structures.n_rows, self._point_without_modes.n_columns))
            structures.begin(task.state, begun, self._point_without_modes)
            slopes += begun[:, 1:]
        self._by_ordinary[columns] -= weighted.T @ slopes
        return seen

    def _pass_to_base(
        self, trace: ElasticTrace, w: Floats, adjoint: _Adjoint, member: Floats, columns: Ints
    ) -> None:
        """What a stage leaves the state on which it builds."""
        state, special = trace.task.state, self._plan.special
        cleared = self._plan.cleared(trace.task.number)[special]
        d = adjoint.d
        if cleared.any():
            rows = np.concatenate([cleared] * len(d))
            seen = self._plan.strain[np.flatnonzero(rows)] @ w
            d[:, cleared] = -seen.reshape(len(d), -1, w.shape[1])
        gone = self._structures.begins_anew(state)[:, None]
        members = np.where(gone, -member, adjoint.members)
        u = adjoint.u
        u[~trace.task.system.touched[self._plan.read]] = 0.0
        unreleased = {g: h for g, h in adjoint.unreleased.items() if g not in state.leaving}
        for group, support in adjoint.unreleased.items():
            if group in state.leaving:
                index = self._systems.discretization.points_of[group]
                at = self._plan.place[numbers(index, self._points.n_points)]
                d[:, at] += self._points.strain(support)[:, index]
        left = _Adjoint(w, u, d, members, unreleased)
        self._left.setdefault(state.base, []).append((columns, left))

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

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from geoident.forward.actions.thermal import NORMAL_COMPONENTS
from geoident.forward.analysis.analysis import StagedAnalysis
from geoident.forward.analysis.stage import ElasticTrace, HeldFactors, LinearRows, StageTask
from geoident.forward.ground.elasticity import ModeSlopes
from geoident.forward.stages import Index, numbers
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import ParameterPoint

_AT_ONCE = 48
"""Readings that are taken back together."""


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
        here = self.weights[0] * (self.stage == state)
        return np.asarray(here + self.weights[1] * (self.zero == state))


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
        held: group to Hbar (n_dofs, k).
    """

    M: Floats
    u: Floats
    d: Floats
    members: Floats
    held: dict[int, Floats] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Work:
    """The work of V dsigma/dp of a stage at kept displacements, on displacements and strains.

    Args:
        by_field: modes, V D eps (n_strain, q) at all points of their field, and its work on
            displacements (q, n_dofs).
        forces: (n_dofs, n) the same on displacements by the ordinary parameters.
        direct: (n_strain, n_special, n) on strains at the special points.
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
    """

    def __init__(
        self,
        analysis: StagedAnalysis,
        plan: AdjointPlan,
        traces: Sequence[ElasticTrace],
        factors: HeldFactors,
        point: ParameterPoint,
        seeds: ReadingSeeds,
    ) -> None:
        self._analysis, self._plan = analysis, plan
        self._traces, self._factors = traces, factors
        self._point, self._seeds = point, seeds
        self._ordinary = analysis.without_modes(point)
        self._systems = analysis.systems
        self._points = analysis.systems.discretization.points
        self._structures = analysis.systems.structures
        self._fields = {id(one): number for number, one in enumerate(analysis.on_mesh.fields)}
        self._first, self._count = 0, seeds.count  # the readings that are looked at
        self._by_ordinary = np.zeros((self._count, len(self._ordinary.names)))
        self._by_field: dict[int, Floats] = {}  # (q, count) by field
        self._prepared: dict[int, _Work] = {}
        self._left: dict[int, list[tuple[Ints, _Adjoint]]] = {}

    def jacobian(self) -> Floats:
        """dv/dp (g, n) of the readings, what gauges add by themselves aside.

        Some readings at a time: what is done to them then stays near the processor.
        """
        parts = [np.zeros((0, len(self._point.names)))]
        for first in range(0, self._seeds.count, _AT_ONCE):
            self._first, self._count = first, min(_AT_ONCE, self._seeds.count - first)
            self._by_ordinary = np.zeros((self._count, len(self._ordinary.names)))
            self._by_field.clear()
            for state in reversed(range(len(self._traces))):
                if len(self._columns(state)):
                    self._stage(state)
            parts.append(self._gathered())
        return np.vstack(parts)

    def _columns(self, state: int) -> Ints:
        """Which of the readings (k) of this part a state acts on."""
        columns = self._plan.columns[state]
        ends = np.searchsorted(columns, (self._first, self._first + self._count))
        return np.asarray(columns[ends[0] : ends[1]] - self._first)

    def _gathered(self) -> Floats:
        names = {name: k for k, name in enumerate(self._point.names)}
        result = np.zeros((self._count, len(names)))
        result[:, [names[name] for name in self._ordinary.names]] = self._by_ordinary
        for number, products in self._by_field.items():
            one = self._analysis.on_mesh.fields[number]
            known = [k for k, name in enumerate(one.names) if name in names]
            places = [names[one.names[k]] for k in known]
            modes = one.modes if len(known) == len(one.names) else one.modes[:, known]
            result[:, places] -= products.T @ modes
        return result

    def _stage(self, number: int) -> None:
        """One stage backwards."""
        trace, columns = self._traces[number], self._columns(number)
        task = trace.task
        carried = self._arrive(number, columns)
        if number == 0:
            carried.u[:] = 0.0  # the motion to balance is forgotten
        w = carried.M
        if trace.stepped:
            w = self._solved(task, carried)
            # lambda = w - M, at the unknowns
            slopes = self._force_slopes(number)
            self._by_ordinary[columns] += w.T @ slopes - carried.M.T @ slopes
            motion = self._imposed(number)
            if motion is not None:
                self._by_ordinary[columns] += carried.u.T @ motion[self._plan.read]
            if trace.held:
                self._hold(trace, w, carried, columns)
        self._strains(trace, w, carried.d, columns)
        member = self._members(trace, w, carried, columns)
        if number:
            self._leave(trace, w, carried, member, columns)

    def _arrive(self, number: int, columns: Ints) -> _Adjoint:
        """What a state is left by those that build on it, and by its own readings."""
        k, s, n_dofs = len(columns), self._points.n_strain, self._systems.discretization.n_dofs
        n_read = len(self._plan.read)
        n_rows, parts = self._structures.n_rows, self._left.pop(number, [])
        if len(parts) == 1 and len(parts[0][0]) == k:
            adjoint = parts[0][1]
        else:
            adjoint = _Adjoint(
                np.zeros((n_dofs, k)),
                np.zeros((n_read, k)),
                np.zeros((s, len(self._plan.special), k)),
                np.zeros((n_rows, k)),
            )
            for theirs, part in parts:
                at = _together(np.searchsorted(columns, theirs))
                adjoint.M[:, at] += part.M
                adjoint.u[:, at] += part.u
                adjoint.d[..., at] += part.d
                adjoint.members[:, at] += part.members
                for group, held in part.held.items():
                    adjoint.held.setdefault(group, np.zeros((n_dofs, k)))[:, at] += held
        self._add_seeds(number, columns, adjoint)
        return adjoint

    def _add_seeds(self, number: int, columns: Ints, adjoint: _Adjoint) -> None:
        """What readings depend on a state itself."""
        weights = self._plan.weights[number, self._first + columns]
        here = np.flatnonzero(weights)
        if not len(here):
            return
        rows, channels = self._seeds.rows, self._seeds.channel[self._first + columns[here]]
        scale = sp.diags_array(weights[here])
        if rows.u is not None:
            own = sp.csr_array(scale @ rows.u[channels])[:, self._plan.read]
            adjoint.u[:, here] += own.T.toarray()
        if rows.stress is not None:
            stress = sp.csr_array(scale @ rows.stress[channels]).tocoo()
            component, point = np.divmod(stress.col, self._points.n_points)
            place = component, self._plan.place[point], here[stress.row]
            np.add.at(adjoint.d, place, -stress.data / self._points.volume[point])
        if rows.members is not None and self._structures.n_rows:
            forces = (scale @ rows.members[channels]).T.toarray()
            adjoint.members[:, here] -= forces / self._structures.weight[:, None]

    def _solved(self, task: StageTask, carried: _Adjoint) -> Floats:
        """The adjoint displacements w (n_dofs, k)."""
        rest = -(self._plan.forces @ self._special_stress(task, carried.d))
        rest[self._plan.read] += carried.u
        if self._structures.n_rows:
            rest -= self._structures.nodal_forces(task.rigidities[:, :1] * carried.members)
        dofs = task.system.dofs
        later = self._let_go_later(task, carried.M)
        if later is not None:
            rest -= self._forces_of(task, later)
        factor = self._factors.factor(task, self._systems)
        right = rest[dofs]
        rest[:] = 0.0
        if factor is not None:
            rest[dofs] = factor.solve(right)
        return rest if later is None else rest + later

    def _let_go_later(self, task: StageTask, M: Floats) -> Floats | None:
        """Of M (n_dofs, k), what belongs to supports that hold now and not later; None for none.

        There w = M, since lambda is zero.
        """
        held = task.system.touched.copy()
        held[task.system.dofs] = False
        if not np.any(M[held]):
            return None
        return np.where(held[:, None], M, 0.0)

    def _forces_of(self, task: StageTask, u: Floats) -> Floats:
        """Forces (n_dofs, k) of the ground and structures of a stage at displacements."""
        stress = self._points.strain(u)
        for material, points in task.system.points_of.items():
            moduli = task.ground_moduli.moduli(material, points).value
            stress[:, points] = moduli.stress(stress[:, points])
        forces = self._points.forces(stress, task.system.volume)
        if self._structures.n_rows:
            forces += self._structures.nodal_forces(
                task.rigidities[:, :1] * self._structures.strain(u)
            )
        return forces

    def _special_stress(self, task: StageTask, d: Floats) -> Floats:
        """V E d (n_strain n_special, k) at the special points, zero where they are absent."""
        stress = np.zeros_like(d)
        for material, points in task.system.points_of.items():
            place = self._plan.place[points]
            here = np.flatnonzero(place >= 0)
            if len(here):
                moduli = task.ground_moduli.moduli(material, points).value.at(here)
                stress[:, place[here]] = moduli.stress(d[:, place[here]])
        stress *= task.system.volume[self._plan.special][None, :, None]
        return stress.reshape(d.shape[0] * d.shape[1], d.shape[2])

    def _force_slopes(self, number: int) -> Floats:
        """df/dp (n_dofs, n) at the unknowns, of what acts and of released fractions; else zero."""
        trace = self._traces[number]
        forces, dofs = np.zeros_like(trace.slopes), trace.task.system.dofs
        forces[dofs] = trace.slopes[dofs]
        for group, support in trace.held.items():
            fraction = self._analysis.release.part(number, group, self._ordinary).columns[1:]
            forces[dofs] -= np.outer(support[dofs], fraction)
        return forces

    def _imposed(self, number: int) -> Floats | None:
        """Derivatives (n_dofs, n) of the displacement step that supports impose; None for none."""
        motion = self._analysis.motions.change(number, self._ordinary)
        return None if motion is None else motion[:, 1:]

    def _hold(self, trace: ElasticTrace, w: Floats, carried: _Adjoint, columns: Ints) -> None:
        """Adjoints of what is held; where the group leaves at this stage, of what made it."""
        state, dofs = trace.task.state, trace.task.system.dofs
        pull = w[dofs] - carried.M[dofs]
        for group in trace.held:
            part = self._analysis.release.part(trace.task.number, group, self._ordinary)
            fraction = float(part.value)
            held = carried.held.setdefault(group, np.zeros_like(carried.M))
            held[dofs] += (1.0 - fraction) * pull
            if group in state.leaving:
                own = self._analysis.actions.carried(state.base, {group}, self._ordinary)[:, 1:]
                self._by_ordinary[columns] += held.T @ own

    def _strains(self, trace: ElasticTrace, w: Floats, d: Floats, columns: Ints) -> None:
        """Take b = C w + d of a stage to the parameters of its moduli and strains.

        b itself is not made: V b^T D eps is the work of the stress V D eps at w and d.
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
            self._add_products(modes, products, columns)
        direct = np.einsum("sqk,sqn->kn", d, work.direct, optimize=True)
        self._by_ordinary[columns] -= w.T @ work.forces + direct

    def _work_of(self, trace: ElasticTrace) -> _Work:
        """The work of V dsigma/dp at kept displacements."""
        points, task = self._points, trace.task
        volume, ordinary = task.system.volume, self._ordinary
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
        for material, mine in task.system.points_of.items():
            moduli = task.ground_moduli.moduli(material, mine)
            if imposed is not None:
                by_ordinary[:, mine] += moduli.value.stress(imposed[:, mine])
            if trace.stepped:
                for name, slope in moduli.slopes.items():
                    if name in ordinary.names:
                        k = ordinary.names.index(name)
                        by_ordinary[:, mine, k] += slope.stress(strain[:, mine])
                for modes in moduli.modes:
                    # absent points of the field have no work: so no rows need be picked
                    change = np.zeros((points.n_strain, len(modes.field.points)))
                    at = slice(None) if modes.places is None else modes.places
                    change[:, at] = modes.moduli.stress(strain[:, mine]) * volume[mine]
                    operator = self._systems.work(modes.field.points, change)
                    by_field.append((modes, change, operator))
            if thermal is not None:
                normal = np.zeros((points.n_strain, *thermal[mine, 1:].shape))
                normal[:NORMAL_COMPONENTS] = thermal[mine, 1:]
                by_ordinary[:, mine] -= moduli.value.stress(normal)
        at_special = self._plan.special
        direct = volume[at_special, None] * by_ordinary[:, at_special]
        return _Work(by_field, points.forces(by_ordinary, volume), direct)

    def _add_products(self, modes: ModeSlopes, products: Floats, columns: Ints) -> None:
        """Add V b^T D eps (q, k) of a stage at all points of a field."""
        number = self._fields[id(modes.field)]
        if number not in self._by_field:
            self._by_field[number] = np.zeros((len(modes.field.points), self._count))
        self._by_field[number][:, _together(columns)] += products

    def _members(self, trace: ElasticTrace, w: Floats, carried: _Adjoint, columns: Ints) -> Floats:
        """The same of structures, for rigidities and given forces; returns B w (n_rows, k)."""
        structures, task = self._structures, trace.task
        if not structures.n_rows:
            return np.zeros((0, w.shape[1]))
        seen = structures.strain(w)
        weighted = structures.weight[:, None] * (seen + carried.members)
        slopes = np.zeros((structures.n_rows, len(self._ordinary.names)))
        if trace.stepped:
            moduli = structures.moduli(task.state, self._ordinary)[:, 1:]
            slopes += moduli * structures.strain(trace.du)[:, None]
        motion = self._imposed(task.number)
        if motion is not None:
            slopes += task.rigidities[:, :1] * structures.strain(motion)
        if task.state.stressed:
            begun = np.zeros((structures.n_rows, self._ordinary.n_columns))
            structures.begin(task.state, begun, self._ordinary)
            slopes += begun[:, 1:]
        self._by_ordinary[columns] -= weighted.T @ slopes
        return seen

    def _leave(
        self, trace: ElasticTrace, w: Floats, carried: _Adjoint, member: Floats, columns: Ints
    ) -> None:
        """What a stage leaves the state on which it builds."""
        state, special = trace.task.state, self._plan.special
        cleared = self._plan.cleared(trace.task.number)[special]
        d = carried.d
        if cleared.any():
            rows = np.concatenate([cleared] * len(d))
            seen = self._plan.strain[np.flatnonzero(rows)] @ w
            d[:, cleared] = -seen.reshape(len(d), -1, w.shape[1])
        gone = self._structures.begins_anew(state)[:, None]
        members = np.where(gone, -member, carried.members)
        u = carried.u
        u[~trace.task.system.touched[self._plan.read]] = 0.0
        held = {g: h for g, h in carried.held.items() if g not in state.leaving}
        for group, support in carried.held.items():
            if group in state.leaving:
                index = self._systems.discretization.points_of[group]
                at = self._plan.place[numbers(index, self._points.n_points)]
                d[:, at] += self._points.strain(support)[:, index]
        left = _Adjoint(w, u, d, members, held)
        self._left.setdefault(state.base, []).append((columns, left))

"""Derivatives of readings by adjoints: the elastic stages backwards (theory 2 and 10).

The tangents of `stage` carry one column for every parameter through the stages. The adjoint carries
one for every reading, from the last stage to the first: what costs less is a matter of numbers.

Let a reading depend on the states by ubar_l = dv/du_l and sbar_l = dv/dsigma_l. With b the *adjoint
strain* (dv/dsigma = -V b), the march of a stage on its base, backwards, is

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

Forces of structures are stresses of further points, with D in place of E. What a partial release
holds of a group, H = f - C^T V sigma, has the adjoint Hbar: it adds C Hbar to a of the state that
the group leaves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from geoident.forward.actions.thermal import NORMAL_COMPONENTS
from geoident.forward.gauges.observable import LinearRows
from geoident.forward.march.march import March
from geoident.forward.march.stage import ElasticTrace, LastFactor, StageTask, factorize
from geoident.forward.stages import Index, numbers
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import ParameterPoint

_TOGETHER = 4_000_000
"""Adjoint strains held at once, in numbers."""


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
        u: (n_dofs, k) adjoint of the displacements.
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
class _Weighted:
    """Derivatives of stress at kept displacements, times V.

    Args:
        by_ordinary: (n_strain, n_points, n) by parameters.
        by_field: number of a field, its points that are there, their places among those of the
            field, and (n_strain, q) by the logarithm of its constant.
    """

    by_ordinary: Floats
    by_field: list[tuple[int, Index, Ints | slice, Floats]]


class AdjointMarch:
    """The way back through the stages of one elastic run.

    Args:
        march: what does not depend on parameters.
        traces: of the states 0, 1, ... of the run.
        factors: those of the run.
        point: all n parameters.
        seeds: the readings.
    """

    def __init__(
        self,
        march: March,
        traces: Sequence[ElasticTrace],
        factors: LastFactor,
        point: ParameterPoint,
        seeds: ReadingSeeds,
    ) -> None:
        self._march, self._traces, self._factors = march, traces, factors
        self._point, self._seeds = point, seeds
        self._ordinary = march.without_modes(point)
        self._systems = march.systems
        self._points = march.systems.discretization.points
        self._structures = march.systems.structures
        self._bases = [trace.task.state.base for trace in traces]
        self._weights = np.array([seeds.at(n) for n in range(len(traces))])
        acts = reach(self._bases, self._weights)
        self._columns = [np.flatnonzero(row) for row in acts]
        self._special = np.flatnonzero(self._special_points())
        self._place = np.full(self._points.n_points, -1)
        self._place[self._special] = np.arange(len(self._special))
        self._by_ordinary = np.zeros((seeds.count, len(self._ordinary.names)))
        self._by_field: dict[int, Floats] = {}  # (q, g) by field
        self._left: dict[int, list[tuple[Ints, _Adjoint]]] = {}

    def jacobian(self) -> Floats:
        """dv/dp (g, n) of the readings, what gauges add by themselves aside."""
        for state in reversed(range(len(self._traces))):
            if len(self._columns[state]):
                self._stage(state)
        return self._gathered()

    def _gathered(self) -> Floats:
        names = {name: k for k, name in enumerate(self._point.names)}
        result = np.zeros((self._seeds.count, len(names)))
        result[:, [names[name] for name in self._ordinary.names]] = self._by_ordinary
        for number, products in self._by_field.items():
            one = self._march.on_mesh.fields[number]
            known = [k for k, name in enumerate(one.names) if name in names]
            places = [names[one.names[k]] for k in known]
            modes = one.modes if len(known) == len(one.names) else one.modes[:, known]
            result[:, places] -= products.T @ modes
        return result

    @cached_property
    def _ground(self) -> dict[int, Ints]:
        points = self._systems.discretization.points_of
        return {g: numbers(index, self._points.n_points) for g, index in points.items()}

    def _special_points(self) -> Bools:
        """(n_points,) those that some stage takes away or places anew, or whose stress is read."""
        special = np.zeros(self._points.n_points, dtype=bool)
        for trace in self._traces[1:]:
            special |= self._cleared(trace) & self._systems[trace.task.state.base].present
        stress = self._seeds.rows.stress
        if stress is not None:
            special[np.unique(stress.indices) % self._points.n_points] = True
        return special

    def _cleared(self, trace: ElasticTrace) -> Bools:
        """(n_points,) strain points that begin a stage without stress."""
        cleared = ~trace.task.system.present
        for group in trace.task.state.placed:
            cleared[self._systems.discretization.points_of[group]] = True
        return cleared

    def _stage(self, number: int) -> None:
        """One stage backwards."""
        trace, columns = self._traces[number], self._columns[number]
        task = trace.task
        carried = self._arrive(number, columns)
        if number == 0:
            carried.u[:] = 0.0  # the motion to balance is forgotten
        w = carried.M
        if trace.stepped:
            w = self._solved(task, carried)
            dofs = task.system.pattern.dofs
            pull = np.zeros_like(w)  # lambda
            pull[dofs] = w[dofs] - carried.M[dofs]
            self._by_ordinary[columns] += pull.T @ self._force_slopes(number)
            self._hold(trace, pull, carried, columns)
        before = self._strains(trace, w, carried, columns)
        member = self._members(trace, w, carried, columns)
        if number:
            self._leave(trace, w, carried, before, member, columns)

    def _arrive(self, number: int, columns: Ints) -> _Adjoint:
        """What a state is left by those that build on it, and by its own readings."""
        k, s, n_dofs = len(columns), self._points.n_strain, self._systems.discretization.n_dofs
        n_rows, parts = self._structures.n_rows, self._left.pop(number, [])
        if len(parts) == 1 and len(parts[0][0]) == k:
            found = parts[0][1]
        else:
            found = _Adjoint(
                np.zeros((n_dofs, k)),
                np.zeros((n_dofs, k)),
                np.zeros((s, len(self._special), k)),
                np.zeros((n_rows, k)),
            )
            for theirs, part in parts:
                at = np.searchsorted(columns, theirs)
                found.M[:, at] += part.M
                found.u[:, at] += part.u
                found.d[..., at] += part.d
                found.members[:, at] += part.members
                for group, held in part.held.items():
                    found.held.setdefault(group, np.zeros((n_dofs, k)))[:, at] += held
        self._add_seeds(number, columns, found)
        return found

    def _add_seeds(self, number: int, columns: Ints, found: _Adjoint) -> None:
        """What readings depend on a state itself."""
        weights = self._weights[number, columns]
        here = np.flatnonzero(weights)
        if not len(here):
            return
        rows, channels = self._seeds.rows, self._seeds.channel[columns[here]]
        scale = sp.diags_array(weights[here])
        if rows.u is not None:
            found.u[:, here] += (scale @ rows.u[channels]).T.toarray()
        if rows.stress is not None:
            stress = sp.csr_array(scale @ rows.stress[channels]).tocoo()
            component, point = np.divmod(stress.col, self._points.n_points)
            place = component, self._place[point], here[stress.row]
            np.add.at(found.d, place, -stress.data / self._points.volume[point])
        if rows.members is not None and self._structures.n_rows:
            forces = (scale @ rows.members[channels]).T.toarray()
            found.members[:, here] -= forces / self._structures.weight[:, None]

    def _solved(self, task: StageTask, carried: _Adjoint) -> Floats:
        """The adjoint displacements w (n_dofs, k)."""
        rest = carried.u.copy()
        if len(self._special):
            stress = self._special_stress(task, carried.d)
            rest -= self._special_forces @ stress
        if self._structures.n_rows:
            rest -= self._structures.nodal_forces(task.moduli[:, :1] * carried.members)
        w = np.zeros_like(rest)
        factor = factorize(task, self._systems, self._factors)
        if factor is not None:
            dofs = task.system.pattern.dofs
            w[dofs] = factor.solve(rest[dofs])
        return w

    @cached_property
    def _special_forces(self) -> sp.csr_array:
        """C^T at the special points, (n_dofs, n_strain n_special)."""
        m = self._points.n_points
        rows = (np.arange(self._points.n_strain)[:, None] * m + self._special).ravel()
        return sp.csr_array(sp.csr_array(self._points.compatibility[rows]).T)

    def _special_stress(self, task: StageTask, d: Floats) -> Floats:
        """V E d (n_strain n_special, k) at the special points, zero where they are absent."""
        stress = np.zeros_like(d)
        for material, mine in task.system.points_of.items():
            points = numbers(mine, self._points.n_points)
            points = points[self._place[points] >= 0]
            if len(points):
                at = self._place[points]
                stress[:, at] = task.ground.moduli(material, points).value.stress(d[:, at])
        stress *= task.system.volume[self._special][None, :, None]
        return stress.reshape(-1, d.shape[2])

    def _force_slopes(self, number: int) -> Floats:
        """df/dp (n_dofs, n) by the ordinary parameters: of what acts, and of released fractions."""
        forces = self._march.actions.forces(number, self._ordinary)[:, 1:]
        release = self._traces[number].task.state.release
        for group, support in self._traces[number].held.items():
            fraction = self._ordinary.number(release[group]).columns[1:]
            forces = forces - np.outer(support, fraction)
        return forces

    def _hold(self, trace: ElasticTrace, pull: Floats, carried: _Adjoint, columns: Ints) -> None:
        """Adjoints of what is held; where the group leaves at this stage, of what made it."""
        state = trace.task.state
        for group in trace.held:
            fraction = float(self._ordinary.number(state.release[group]).value)
            held = carried.held.setdefault(group, np.zeros_like(pull))
            held += (1.0 - fraction) * pull
            if group in state.leaving:
                own = self._march.actions.carried(state.base, {group}, self._ordinary)[:, 1:]
                self._by_ordinary[columns] += held.T @ own

    def _strains(self, trace: ElasticTrace, w: Floats, carried: _Adjoint, columns: Ints) -> Floats:
        """Take b of a stage to the parameters of its moduli and strains.

        Returns:
            C w (n_strain, n_special, k) at the special points.
        """
        points = self._points
        weighted = self._weighted(trace)
        s, special = points.n_strain, self._special
        seen = np.empty((s, len(special), w.shape[1]))
        step = max(1, _TOGETHER // (s * points.n_points))
        for start in range(0, w.shape[1], step):
            some = slice(start, start + step)
            b = points.strain(w[:, some])
            seen[..., some] = b[:, special]
            b[:, special] += carried.d[..., some]
            mine = columns[some]
            for number, at, place, change in weighted.by_field:
                products = np.einsum("sq,sqk->qk", change, b[:, at])
                kept = self._by_field.setdefault(
                    number,
                    np.zeros((len(self._march.on_mesh.fields[number].points), self._seeds.count)),
                )
                if isinstance(place, slice):
                    kept[:, mine] += products
                else:
                    kept[np.ix_(place, mine)] += products
            if weighted.by_ordinary.any():
                flat = b.reshape(-1, b.shape[2])
                self._by_ordinary[mine] -= flat.T @ weighted.by_ordinary.reshape(len(flat), -1)
        return seen

    def _weighted(self, trace: ElasticTrace) -> _Weighted:
        """V times the derivatives of stress at kept displacements."""
        task, points = trace.task, self._points
        volume, n = task.system.volume, len(self._ordinary.names)
        columns = {name: k for k, name in enumerate(self._ordinary.names)}
        by_ordinary = np.zeros((points.n_strain, points.n_points, n))
        by_field = []
        fields = {id(one): number for number, one in enumerate(self._march.on_mesh.fields)}
        strain = points.strain(trace.du) if trace.stepped else np.zeros(by_ordinary.shape[:2])
        thermal = self._march.thermal.change(task.number, self._ordinary) if task.number else None
        if thermal is not None:
            strain[:NORMAL_COMPONENTS] -= thermal[:, 0]
        for material, mine in task.system.points_of.items():
            moduli = task.ground.moduli(material, mine)
            if trace.stepped:
                for name, slope in moduli.slopes.items():
                    if name in columns:
                        by_ordinary[:, mine, columns[name]] += slope.stress(strain[:, mine])
                for modes in moduli.modes:
                    change = modes.moduli.stress(strain[:, mine]) * volume[mine]
                    place = slice(None) if modes.places is None else modes.places
                    by_field.append((fields[id(modes.field)], mine, place, change))
            if thermal is not None:
                normal = np.zeros((points.n_strain, *thermal[mine, 1:].shape))
                normal[:NORMAL_COMPONENTS] = thermal[mine, 1:]
                by_ordinary[:, mine] -= moduli.value.stress(normal)
        if task.number == 0:
            by_ordinary += self._march.in_situ.columns(self._ordinary)[..., 1:]
        by_ordinary *= volume[:, None]
        return _Weighted(by_ordinary, by_field)

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
        if task.state.stressed:
            begun = np.zeros((structures.n_rows, self._ordinary.n_columns))
            structures.begin(task.state, begun, self._ordinary)
            slopes += begun[:, 1:]
        self._by_ordinary[columns] -= weighted.T @ slopes
        return seen

    def _leave(
        self,
        trace: ElasticTrace,
        w: Floats,
        carried: _Adjoint,
        seen: Floats,
        member: Floats,
        columns: Ints,
    ) -> None:
        """What a stage leaves the state on which it builds."""
        state = trace.task.state
        cleared = self._cleared(trace)[self._special]
        d = np.where(cleared[:, None], -seen, carried.d)
        gone = self._structures.begins_anew(state)[:, None]
        members = np.where(gone, -member, carried.members)
        u = carried.u
        u[~trace.task.system.touched] = 0.0
        held = {g: h for g, h in carried.held.items() if g not in state.leaving}
        for group, support in carried.held.items():
            if group in state.leaving:
                mine = self._ground[group]
                at = self._place[mine]
                d[:, at] += self._points.strain(support)[:, mine]
        left = _Adjoint(w, u, d, members, held)
        self._left.setdefault(state.base, []).append((columns, left))

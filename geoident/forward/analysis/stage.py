"""One stage of the analysis: what it starts from, and its end where nothing yields (theory 2).

There one factorization serves all columns; for stages with yielding see `plastic_step`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from geoident.errors import ModelError
from geoident.fem.elasticity import Moduli
from geoident.fem.solvers.direct import Factor, NotPositiveDefinite, SymbolicFactorization
from geoident.forward.actions.thermal import NORMAL_COMPONENTS
from geoident.forward.analysis.systems import StageSystem, StageSystems
from geoident.forward.ground.elasticity import ModuliAt
from geoident.forward.stages import ConstructionState, Index
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.dual import ParameterPoint


@dataclass(frozen=True)
class UnitForces:
    """Forces along the readings, beside those of the case.

    Args:
        forces: (n_dofs, g) unit force along each reading, N.
        active: (n_states, g) how it acts in each state: 1, not at all, 0, or against it, -1.
        multipliers: (g,) the forces act on the state, so many times; None: each unit force has a
            further column, which carries its response.
    """

    forces: Floats
    active: Floats
    multipliers: Floats | None = None

    @property
    def n_columns(self) -> int:
        """Number of further columns."""
        return 0 if self.multipliers is not None else int(self.forces.shape[1])

    def add_to(self, forces: Floats, state: int) -> None:
        """Add to the forces (n_dofs, 1 + n + k) of a state."""
        if self.multipliers is not None:
            forces[:, 0] += self.forces @ (self.active[state] * self.multipliers)
        elif self.n_columns:
            forces[:, -self.n_columns :] = self.forces * self.active[state]


@dataclass(frozen=True)
class LastEquilibrium:
    """The last equilibrium on the way to a load that the ground does not carry.

    Args:
        u: (n_dofs,) displacements, m: of the stage alone where the stage says it, since placing
            where the analysis does.
        stress: (n_strain, n_points), Pa.
        yielded: (n_points,) strain points that flow plastically.
    """

    u: Floats
    stress: Floats
    yielded: Bools


@dataclass(frozen=True)
class StageEnd:
    """The state of equilibrium at the end of a stage. Arrays are the analysis's own: copy to keep.

    Args:
        state: index of the state.
        u: (n_dofs, 1 + n + k) displacements since placing, m, and their derivatives.
        stress: (n_strain, n_points, 1 + n + k), Pa.
        members: (n_rows, 1 + n + k) forces in linings and bolts (`structures`).
        yielded: (n_points,) strain points that flow plastically in this state.
        forces: (n_dofs, 1 + n + k) what acts on the nodes, supports aside, N; None where nobody
            has said.
        last: of a state without equilibrium, what was found on the way to it; None where nothing
            was.
    """

    state: int
    u: Floats
    stress: Floats
    members: Floats
    yielded: Bools
    forces: Floats | None = None
    last: LastEquilibrium | None = None


@dataclass(frozen=True)
class LinearRows:
    """What channels (g) read as a linear function of a state, at given parameters.

    Args:
        u: (g, n_dofs) of the displacements; None: of none.
        stress: (g, n_strain n_points) of the stresses, component by component; None: of none.
        members: (g, n_rows) of the forces in structures; None: of none.
    """

    u: sp.csr_array | None = None
    stress: sp.csr_array | None = None
    members: sp.csr_array | None = None


@dataclass
class StressState:
    """What ground and structures carry from one stage to the next, changed in place.

    Args:
        stress: (n_strain, n_points, k), Pa.
        members: (n_rows, k) forces in linings and bolts.
        hardened: material to the multipliers (y, n_points, k) of its planes so far, where they
            count because it hardens.
    """

    stress: Floats
    members: Floats
    hardened: dict[str, Floats] = field(default_factory=dict)

    def columns(self, part: slice) -> StressState:
        """Some of its columns, not copied."""
        return StressState(self.stress[..., part], self.members[:, part])

    def clear(self, points: Bools | Ints | slice) -> None:
        """Points (n_points,), or (k,) by number, that are gone or placed anew carry nothing.

        They have not hardened either.
        """
        self.stress[:, points] = 0.0
        for multipliers in self.hardened.values():
            multipliers[:, points] = 0.0

    def multipliers(self, material: str, points: Index, columns: slice | int) -> Floats | None:
        """Multipliers so far (y, q, ...); None for none.

        Args:
            material: its name.
            points: (q,) strain points.
            columns: of what is carried.
        """
        hardened = self.hardened.get(material)
        return None if hardened is None else hardened[:, points, columns]

    def add_multipliers(self, material: str, points: Index, columns: slice, more: Floats) -> None:
        """Add multipliers of a material that hardens.

        Args:
            material: its name.
            points: (q,) strain points.
            columns: c of what is carried.
            more: (y, q, c) what is added.
        """
        if material not in self.hardened:
            shape = (more.shape[0], *self.stress.shape[1:])
            self.hardened[material] = np.zeros(shape)
        self.hardened[material][:, points, columns] += more

    def copy(self) -> StressState:
        """A copy of its own."""
        hardened = {name: values.copy() for name, values in self.hardened.items()}
        return StressState(self.stress.copy(), self.members.copy(), hardened)

    def restore(self, kept: StressState) -> None:
        """Take over the values of a copy."""
        self.stress[:], self.members[:] = kept.stress, kept.members
        self.hardened.clear()
        self.hardened.update({name: values.copy() for name, values in kept.hardened.items()})


class BaseStates:
    """Keeps what later states build on, as long as they need it, and no longer.

    Args:
        states: of the analysis.
    """

    def __init__(self, states: Sequence[ConstructionState]) -> None:
        self._bases = [state.base for state in states]
        self._last_use = {base: n for n, base in enumerate(self._bases) if base != n - 1}
        self._kept: dict[int, tuple[Floats, StressState]] = {}

    def go_to(self, state: int, u: Floats, carried: StressState) -> None:
        """Put the displacements and stresses in place on which a state builds.

        Args:
            state: index of the state.
            u: (n_dofs, 1 + n + k), overwritten.
            carried: overwritten.
        """
        base = self._bases[state]
        if base == state - 1 or state == 0:
            return
        u[:], kept = self._kept[base]
        carried.restore(kept)
        if self._last_use[base] == state:
            del self._kept[base]

    def leave(self, state: int, u: Floats, carried: StressState) -> None:
        """Copy them where a later state builds on this one, but not the next.

        Args:
            state: index of the state.
            u: (n_dofs, 1 + n + k).
            carried: at its end.
        """
        if self._last_use.get(state, -1) > state:
            self._kept[state] = u.copy(), carried.copy()


@dataclass(frozen=True)
class StageTask:
    """One stage to be solved.

    Args:
        number: of the state.
        system: its equations.
        state: what is there.
        point: the parameters, and those to differentiate by.
        ground_moduli: of all materials.
        carried: before the stage, without what left; thermal strains are in it. Changed in place.
        forces: (n_dofs, 1 + n + k).
        rigidities: (n_rows, 1 + n) of structures.
        thermal: (n_points, 1 + n) normal strains, or None.
        motion: (n_dofs, 1 + n) displacement step that supports impose, zero where nothing is given;
            None for none.
    """

    number: int
    system: StageSystem
    state: ConstructionState
    point: ParameterPoint
    ground_moduli: ModuliAt
    carried: StressState
    forces: Floats
    rigidities: Floats
    thermal: Floats | None
    motion: Floats | None = None

    @property
    def n(self) -> int:
        """Number of parameters to differentiate by."""
        return len(self.point.names)

    def moduli_by_material(self) -> dict[str, Moduli]:
        """E of every material that is there, at its points, Pa."""
        return {
            m: self.ground_moduli.moduli(m, points).value
            for m, points in self.system.points_of.items()
        }


@dataclass(frozen=True, eq=False)
class ElasticTrace:
    """What the way back needs of a stage.

    Args:
        task: the stage, without derivatives.
        du: (n_dofs,) its displacement step, what supports impose included.
        slopes: (n_dofs, n) df/dp by the parameters that are no modes, of what acts in it.
        held: group to H (n_dofs,) of what is partly released in it.
        in_situ: (n_strain, n_points, n) derivatives of the virgin stress; None in later states.
        stepped: whether an equilibrium was sought; in the virgin state only if it was out of it.
    """

    task: StageTask
    du: Floats
    slopes: Floats
    held: Mapping[int, Floats]
    in_situ: Floats | None = None
    stepped: bool = True


class LastFactor:
    """The factorizations of an analysis that are held, good as long as K stays the same.

    K depends on the material of every present group, and on the structures. One is held, not one
    for every stage: in three dimensions a factor is the largest thing in memory. Only for adjoints,
    which need the stages backwards, all are held up to a limit.

    Args:
        entries: of matrices whose factors may be held at once; 0: the last one only.
    """

    def __init__(self, entries: int = 0) -> None:
        self._entries = entries
        self._held: list[tuple[object, Factor, SymbolicFactorization, int]] = []

    def find(self, state: ConstructionState) -> Factor | None:
        """The factorization of K at a state, if it is one that is held and still there."""
        what = _what_stands(state)
        for ground, factor, _, _ in self._held:
            if ground == what and factor.valid:
                return factor
        return None

    def make_room(self, entries: int) -> None:
        """Forget what must go before a factorization of so many entries is made, oldest first."""
        while self._held and sum(held[3] for held in self._held) + entries > self._entries:
            del self._held[0]

    def forget(self) -> None:
        """Forget all."""
        self._held.clear()

    def uses(self, symbolic: SymbolicFactorization) -> bool:
        """Whether a factor that is held would be lost by another factorization by the same."""
        return any(held[2] is symbolic for held in self._held)

    def keep(
        self, state: ConstructionState, factor: Factor, symbolic: SymbolicFactorization, size: int
    ) -> None:
        """Hold a factorization.

        Args:
            state: for which it was made.
            factor: of K there.
            symbolic: of which it is the last factor.
            size: entries of K.
        """
        self._held.append((_what_stands(state), factor, symbolic, size))


def elastic_step(task: StageTask, systems: StageSystems, last: LastFactor) -> Floats:
    """Bring a state to equilibrium.

    The state comes first, since the derivatives need its strains.

    Args:
        task: the stage; what it carries is brought to its end.
        systems: the equations of the stages.
        last: the last factorization of this analysis.

    Returns:
        (n_dofs, 1 + n + k) displacement steps.

    Raises:
        ModelError: the stiffness is not positive definite.
    """
    factor, structures = factorize(task, systems, last), systems.structures
    impose_motion(task, systems)
    first = _solve_columns(
        task, systems, factor, task.carried.columns(slice(1)), task.forces[:, :1]
    )
    if task.motion is not None:
        first += task.motion[:, :1]
    if task.forces.shape[1] == 1:
        return first
    strain = systems.discretization.points.strain(first[:, 0])
    if task.thermal is not None:
        strain[:NORMAL_COMPONENTS] -= task.thermal[:, 0]
    add_stress_from_moduli_slopes(task, strain, task.carried.stress[..., 1:])
    members = task.carried.members[:, 1 : 1 + task.n]
    members += task.rigidities[:, 1:] * structures.strain(first)
    slopes = task.carried.columns(slice(1, None))
    others = _solve_columns(task, systems, factor, slopes, task.forces[:, 1:])
    if task.motion is not None:
        others[:, : task.n] += task.motion[:, 1:]
    return np.hstack([first, others])


def follow_displacements(task: StageTask, systems: StageSystems, du: Floats) -> None:
    """Bring what is carried to the end of a stage whose displacement steps are known.

    Args:
        task: the stage, in which temperatures and supports stay as they are.
        systems: the equations of the stages.
        du: (n_dofs, 1 + n) displacement steps.
    """
    strain, moduli = systems.discretization.points.strain(du), task.moduli_by_material()
    if du.shape[1] > 1:
        add_stress_from_moduli_slopes(task, strain[..., 0], task.carried.stress[..., 1:])
    for material, points in task.system.points_of.items():
        task.carried.stress[:, points] += moduli[material].stress(strain[:, points])
    if systems.structures.n_rows:
        members = systems.structures.strain(du)
        task.carried.members[:, 1:] += task.rigidities[:, 1 : du.shape[1]] * members[:, :1]
        task.carried.members[:] += task.rigidities[:, :1] * members


def impose_motion(task: StageTask, systems: StageSystems) -> None:
    """Bring what supports impose into what is carried, with its derivatives.

    Those by the moduli (dE/dp) are added in `elastic_step`.

    The other nodes stay where they are for now: what they are then out of balance by, the step of
    the stage takes away.

    Args:
        task: the stage; what it carries is changed.
        systems: the equations of the stages.
    """
    if task.motion is None:
        return
    strain, moduli = systems.discretization.points.strain(task.motion), task.moduli_by_material()
    columns = task.motion.shape[1]
    for material, points in task.system.points_of.items():
        task.carried.stress[:, points, :columns] += moduli[material].stress(strain[:, points])
    if systems.structures.n_rows:
        more = task.rigidities[:, :1] * systems.structures.strain(task.motion)
        task.carried.members[:, :columns] += more


def add_stress_from_moduli_slopes(task: StageTask, strain: Floats, stress_slopes: Floats) -> None:
    """dsigma/dp_h += dE/dp_h eps for the moduli that depend on parameters.

    Args:
        task: the stage.
        strain: eps (s, n_points) of the step, without thermal strains.
        stress_slopes: dsigma/dp (s, n_points, n + k), changed in place.
    """
    columns = {name: column for column, name in enumerate(task.point.names)}
    for material, points in task.system.points_of.items():
        moduli = task.ground_moduli.moduli(material, points)
        for name, slope in moduli.slopes.items():
            if name in columns:
                stress_slopes[:, points, columns[name]] += slope.stress(strain[:, points])
        for modes in moduli.modes:
            change, phi = modes.moduli.stress(strain[:, points]), modes.modes
            for some, place in _runs(modes.field.names, columns):
                stress_slopes[:, points, place] += change[..., None] * phi[None, :, some]


def _runs(names: Sequence[str], columns: Mapping[str, int]) -> Iterator[tuple[slice, slice]]:
    """Modes (a part of names) whose columns stand together, and these columns."""
    places = [(k, columns[name]) for k, name in enumerate(names) if name in columns]
    for n, (k, column) in enumerate(places):
        if n and (k - 1, column - 1) == places[n - 1]:
            continue
        end = n + 1
        while end < len(places) and places[end] == (k + end - n, column + end - n):
            end += 1
        yield slice(k, k + end - n), slice(column, column + end - n)


def not_positive_definite(stage: str, place: str) -> ModelError:
    """The elastic stiffness of a stage has a mechanism at some place."""
    msg = f"at stage '{stage}' the stiffness matrix is not positive definite{place}"
    hint = "look there for elements without stiffness, or held by next to nothing"
    return ModelError(msg, hint)


def _solve_columns(
    task: StageTask,
    systems: StageSystems,
    factor: Factor | None,
    carried: StressState,
    forces: Floats,
) -> Floats:
    """Displacements (n_dofs, k) that balance forces and stress; adds the stress that they make."""
    points, structures = systems.discretization.points, systems.structures
    rest = forces - points.forces(carried.stress, task.system.volume)
    if structures.n_rows:
        rest -= structures.nodal_forces(carried.members)
    du = np.zeros_like(rest)
    if factor is not None:
        dofs = task.system.dofs
        du[dofs] = factor.solve(rest[dofs])
    strain, moduli = points.strain(du), task.moduli_by_material()
    for material, at in task.system.points_of.items():
        carried.stress[:, at] += moduli[material].stress(strain[:, at])
    if structures.n_rows:
        carried.members[:] += task.rigidities[:, :1] * structures.strain(du)
    return du


def factorize(task: StageTask, systems: StageSystems, last: LastFactor) -> Factor | None:
    """Factorization of K_j; None where every displacement is prescribed.

    Args:
        task: the stage.
        systems: the equations of the stages.
        last: the factorizations that are held.

    Raises:
        ModelError: the stiffness is not positive definite.
    """
    system, state = task.system, task.state
    symbolic = systems.symbolic(system)
    if symbolic is None:
        return None
    held = last.find(state)
    if held is not None:
        return held
    size = len(system.pattern.lower.indices)
    last.make_room(size)
    spare = 0
    while last.uses(symbolic):
        spare += 1
        symbolic = systems.symbolic(system, spare) or symbolic
    try:
        values = systems.values(system, state, task.moduli_by_material(), task.point.values)
        factor = symbolic.factorize(values)
    except NotPositiveDefinite as error:
        place = systems.describe_unknown(system, error.unknown)
        raise not_positive_definite(state.name, place) from error
    last.keep(state, factor, symbolic, size)
    return factor


def _what_stands(state: ConstructionState) -> tuple[object, ...]:
    """On what K depends: materials of groups, structures, those under a given force, supports."""
    return state.materials, state.structures, set(state.stressed), state.held

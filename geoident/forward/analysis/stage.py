"""One stage of the analysis: what it starts from, and its end where nothing yields (theory 2).

There one factorization serves all columns; for stages with yielding see `plastic_step`.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp

from geoident.errors import ModelError
from geoident.fem.elasticity import Moduli
from geoident.fem.kinematics import NORMAL_COMPONENTS
from geoident.fem.solvers.direct import Factor, NotPositiveDefinite, SymbolicFactorization
from geoident.forward.analysis.heating import StageHeating
from geoident.forward.analysis.systems import StageSystem, StageSystems
from geoident.forward.analysis.water import WaterInPart
from geoident.forward.creep.steps import CreepStrains, StepModuli
from geoident.forward.ground.elasticity import ModuliAt
from geoident.forward.stages import ConstructionState, Index
from geoident.forward.structures.members import Structures
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
        number: of the state.
        u: (n_dofs, 1 + n + k) displacements since placing, m, and their derivatives.
        stress: (n_strain, n_points, 1 + n + k), Pa.
        members: (n_rows, 1 + n + k) forces in linings and bolts (`structures`).
        yielded: (n_points,) strain points that flow plastically in this state.
        forces: (n_dofs, 1 + n + k) what acts on the nodes, supports aside, N; None where nobody
            has said.
        last: of a state without equilibrium, what was found on the way to it; None where nothing
            was.
        pores: (n_nodes, 1 + n + k) pressure of water in excess of that at rest, Pa, at the corners
            of ground that consolidates; None in a case in which none does.
        temperatures: (n_nodes, 1 + n) degC; None in a case that conducts no heat.
        hardened: of `StressState`.
        relieved: of `StressState`; None where nothing goes on from it.
    """

    number: int
    u: Floats
    stress: Floats
    members: Floats
    yielded: Bools
    forces: Floats | None = None
    last: LastEquilibrium | None = None
    pores: Floats | None = None
    temperatures: Floats | None = None
    hardened: Mapping[str, Floats] = field(default_factory=dict)
    relieved: Floats | None = None


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
        relieved: (n_rows, k) tractions of which interfaces have rid themselves by opening, Pa, and
            forces of struts likewise; they count again as these close (theory 5.15).
        hardened: material to the multipliers (y, n_points, k) of its planes so far, where they
            count because it hardens.
        pores: (n_nodes, k) pressure of water in excess of that at rest, Pa; None where all ground
            drains at once.
        creep: strains of ground that creeps, and the times of its placing; None where none does.
        temperatures: (n_nodes, 1 + n) degC; None in a case that conducts no heat.
    """

    stress: Floats
    members: Floats
    relieved: Floats
    hardened: dict[str, Floats] = field(default_factory=dict)
    pores: Floats | None = None
    creep: CreepStrains | None = None
    temperatures: Floats | None = None

    def clear(self, points: Bools | Ints | slice) -> None:
        """Points (n_points,), or (k,) by number, that are gone or placed anew carry nothing.

        They have not hardened either.
        """
        self.stress[:, points] = 0.0
        for multipliers in self.hardened.values():
            multipliers[:, points] = 0.0
        if self.creep is not None:
            self.creep.clear(points)

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

    def take(self, other: StressState) -> None:
        """Take stress, forces of structures, hardening and creep of another state."""
        self.stress[:], self.members[:] = other.stress, other.members
        self.relieved[:] = other.relieved
        self.hardened = {name: values.copy() for name, values in other.hardened.items()}
        self.creep = None if other.creep is None else other.creep.copy()

    def copy(self) -> StressState:
        """A copy of its own."""
        hardened = {name: values.copy() for name, values in self.hardened.items()}
        pores = None if self.pores is None else self.pores.copy()
        creep = None if self.creep is None else self.creep.copy()
        heat = None if self.temperatures is None else self.temperatures.copy()
        forces = self.members.copy(), self.relieved.copy()
        return StressState(self.stress.copy(), *forces, hardened, pores, creep, heat)


@dataclass(frozen=True)
class StageTask:
    """One stage to be solved.

    Args:
        number: of the state.
        system: its equations.
        state: what is there.
        point: the parameters, and those to differentiate by in this run.
        ground_moduli: of all materials; it knows their derivatives by all parameters of the case.
            Of a step in time those that the step has.
        carried: before the stage, without what left; see `impose`. Changed in place.
        forces: (n_dofs, 1 + n + k).
        rigidities: (n_rows, 1 + n) of structures.
        thermal: (n_points, 1 + n) normal strains eps_0 of a change of temperature; None for none.
        motion: (n_dofs, 1 + n) displacement step w that supports impose, zero where nothing is
            given; None for none.
        moduli_key: what the moduli depend on beside ground and parameters: the step in time.
        members_grown: structure to what there is of its stiffness, where it ages.
        water: of a part of a step in time in which ground yields; None where none flows.
        heating: the temperatures of the stage, where it conducts heat; their strain is in
            ``thermal`` only as far as it is imposed with the rest.
    """

    number: int
    system: StageSystem
    state: ConstructionState
    point: ParameterPoint
    ground_moduli: ModuliAt | StepModuli
    carried: StressState
    forces: Floats
    rigidities: Floats
    thermal: Floats | None = None
    motion: Floats | None = None
    moduli_key: Hashable = None
    members_grown: Mapping[str, float] = field(default_factory=dict)
    water: WaterInPart | None = None
    heating: StageHeating | None = None

    @property
    def n(self) -> int:
        """Number of parameters to differentiate by."""
        return len(self.point.names)

    @property
    def moment(self) -> str:
        """The stage, and of one in time the moment, for a message."""
        name, water = f"stage '{self.state.name}'", self.water
        if water is None or not water.span[1]:
            return name
        text = f"{name}, {water.span[1] / 86400.0:.3g} days after it began,"
        came = water.loaded[1]
        return text if came >= 1.0 else f"{text} when {100.0 * came:.3g} % of it had come,"

    def moduli_by_material(self) -> dict[str, Moduli]:
        """E of every material that is there, at its points, Pa."""
        return {
            m: self.ground_moduli.moduli(m, points).value
            for m, points in self.system.points_of.items()
        }

    def impose(self, systems: StageSystems) -> None:
        """Bring what temperatures and supports impose into what is carried, E (C w - eps_0).

        With the derivatives of w and eps_0; those of E are added with the step
        (`add_stiffness_derivatives`).
        The other nodes stay where they are for now: what they are then out of balance by, the
        step of the stage takes away.
        """
        if self.motion is not None:
            self.add_stress(systems, self.motion, slice(0, 1 + self.n))
        if self.thermal is not None:
            self.add_thermal_stress(self.thermal, self.carried.stress, -1.0)

    def add_thermal_stress(self, thermal: Floats, stress: Floats, sign: float) -> None:
        """Add E eps_0, with a sign, of normal strains (n_points, 1 + n) to stress (s, n_points, k).

        Args:
            thermal: eps_0 with derivatives.
            stress: Pa, changed in place.
            sign: 1 or -1.
        """
        moduli = self.moduli_by_material()
        for material, points in self.system.points_of.items():
            strain = np.zeros((stress.shape[0], *thermal[points].shape))
            strain[:NORMAL_COMPONENTS] = thermal[points]
            stress[:, points, : 1 + self.n] += sign * moduli[material].stress(strain)

    def with_thermal(self, strain: Floats) -> StageTask:
        """The same with further normal strains (n_points, 1 + n) of temperatures."""
        thermal = strain if self.thermal is None else self.thermal + strain
        return replace(self, thermal=thermal)

    def add_stress(self, systems: StageSystems, du: Floats, columns: slice) -> None:
        """Add E C du to what is carried, and the forces of structures likewise.

        Args:
            systems: the equations of the stages.
            du: (n_dofs, c) displacement steps.
            columns: c columns of what is carried.
        """
        strain, moduli = systems.discretization.points.strain(du), self.moduli_by_material()
        for material, points in self.system.points_of.items():
            self.carried.stress[:, points, columns] += moduli[material].stress(strain[:, points])
        self.add_member_forces(systems.structures, du, columns)

    def add_member_forces(self, structures: Structures, du: Floats, columns: slice) -> None:
        """The same of the forces of structures alone, from du (n_dofs, c)."""
        if structures.n_rows:
            self.carried.members[:, columns] += self.rigidities[:, :1] * structures.strain(du)

    def add_stiffness_derivatives(
        self, systems: StageSystems, du: Floats, stress: Floats, members: Floats
    ) -> None:
        """Add dE/dp_h eps for the moduli that depend on parameters; structures likewise.

        Args:
            systems: the equations of the stages.
            du: (n_dofs,) displacement step, without what supports impose.
            stress: dsigma/dp (s, n_points, n + k), changed in place.
            members: derivatives (n_rows, n + k) of the forces of structures, changed in place.
        """
        du = du if self.motion is None else du + self.motion[:, 0]
        strain = systems.discretization.points.strain(du)
        if self.thermal is not None:
            strain[:NORMAL_COMPONENTS] -= self.thermal[:, 0]
        columns = {name: column for column, name in enumerate(self.point.names)}
        for material, points in self.system.points_of.items():
            moduli = self.ground_moduli.moduli(material, points)
            for name, slope in moduli.slopes.items():
                if name in columns:
                    stress[:, points, columns[name]] += slope.stress(strain[:, points])
            for modes in moduli.modes:
                change, phi = modes.moduli.stress(strain[:, points]), modes.modes
                for some, place in _runs(modes.field.names, columns):
                    stress[:, points, place] += change[..., None] * phi[None, :, some]
        if systems.structures.n_rows:
            member_strain = systems.structures.strain(du)[:, None]
            members[:, : self.n] += self.rigidities[:, 1:] * member_strain


@dataclass(frozen=True, eq=False)
class ElasticTrace:
    """What the way back needs of a stage.

    Args:
        task: the stage, without derivatives.
        du: (n_dofs,) its displacement step, what supports impose included.
        slopes: (n_dofs, n) df/dp by the parameters that are no modes, of what acts in it.
        unreleased: group to H (n_dofs,) of what is partly released in it.
        in_situ: (n_strain, n_points, n) derivatives of the virgin stress; None in later states.
        stepped: whether an equilibrium was sought; in the virgin state only if it was out of it.
    """

    task: StageTask
    du: Floats
    slopes: Floats
    unreleased: Mapping[int, Floats]
    in_situ: Floats | None = None
    stepped: bool = True


@dataclass(frozen=True, eq=False)
class _KeptFactor:
    """A factorization of K.

    Args:
        key: what K depends on, see `_stiffness_key`.
        factor: the factorization.
        symbolic: what it was made with; a further one made with it overwrites it.
        entries: of K.
    """

    key: object
    factor: Factor
    symbolic: SymbolicFactorization
    entries: int


def _stiffness_key(state: ConstructionState, moduli_key: Hashable) -> object:
    """What K of a state depends on, at given parameters."""
    return state.materials, state.structures, set(state.stressed), state.held, moduli_key


class FactorCache:
    """The factorizations of an analysis that are kept, good as long as K stays the same.

    K depends on the material of every present group, and on the structures. One is kept, not one
    for every stage: in three dimensions a factor is the largest thing in memory. Only for adjoints,
    which need the stages backwards, all are kept up to a limit.

    Args:
        entries: of matrices whose factors may be kept at once; 0: the last one only.
    """

    def __init__(self, entries: int = 0) -> None:
        self._entries = entries
        self._kept: list[_KeptFactor] = []

    def forget(self) -> None:
        """Forget all."""
        self._kept.clear()

    def find(self, state: ConstructionState, moduli_key: Hashable = None) -> Factor | None:
        """The factorization of K at a state, if it is one that is kept and still valid."""
        key = _stiffness_key(state, moduli_key)
        for kept in self._kept:
            if kept.key == key and kept.factor.valid:
                return kept.factor
        return None

    def factor(self, task: StageTask, systems: StageSystems) -> Factor | None:
        """Factorization of K of a stage; None where every displacement is prescribed.

        Raises:
            ModelError: the stiffness is not positive definite.
        """
        system, state = task.system, task.state
        symbolic = systems.symbolic(system)
        if symbolic is None:
            return None
        factor = self.find(state, task.moduli_key)
        if factor is not None:
            return factor
        entries = len(system.pattern.lower.indices)
        while self._kept and sum(kept.entries for kept in self._kept) + entries > self._entries:
            del self._kept[0]  # the oldest makes room
        spare = 0
        while any(kept.symbolic is symbolic for kept in self._kept):  # it would be overwritten
            spare += 1
            symbolic = systems.symbolic(system, spare)
            assert symbolic is not None  # of the same pattern, in which something is free to move
        try:
            values = systems.stiffness_values(
                system, state, task.moduli_by_material(), task.point.values, task.members_grown
            )
            factor = symbolic.factorize(values)
        except NotPositiveDefinite as error:
            place = systems.describe_unknown(system, error.unknown)
            raise not_positive_definite(state.name, place) from error
        key = _stiffness_key(state, task.moduli_key)
        self._kept.append(_KeptFactor(key, factor, symbolic, entries))
        return factor


def elastic_step(
    task: StageTask, systems: StageSystems, factors: FactorCache, known: Floats | None = None
) -> Floats:
    """Bring a state to equilibrium (theory 2.1).

    The state comes first, since the derivatives need its strains.

    Args:
        task: the stage; what it carries is brought to its end.
        systems: the equations of the stages.
        factors: those that are kept.
        known: (n_dofs, 1 + n) displacement steps, where they are known; nothing is solved then.

    Returns:
        (n_dofs, 1 + n + k) displacement steps beside those that supports impose.

    Raises:
        ModelError: the stiffness is not positive definite.
    """
    points, structures, carried = systems.discretization.points, systems.structures, task.carried
    factor = factors.factor(task, systems) if known is None else None
    du, dofs = np.zeros_like(task.forces) if known is None else known, task.system.dofs

    def solve(columns: slice) -> None:
        if factor is not None:
            r = task.forces[:, columns] - points.forces(
                carried.stress[..., columns], task.system.volume
            )
            if structures.n_rows:
                r -= structures.nodal_forces(carried.members[:, columns])
            du[dofs, columns] = factor.solve(r[dofs])
        task.add_stress(systems, du[:, columns], columns)

    solve(slice(0, 1))
    if du.shape[1] > 1:
        derivatives = slice(1, None)
        task.add_stiffness_derivatives(
            systems, du[:, 0], carried.stress[..., derivatives], carried.members[:, derivatives]
        )
        solve(derivatives)
    return du


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

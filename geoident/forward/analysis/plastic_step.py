"""A step of the analysis where materials yield (theory 2 and 5).

The state follows from `equilibrium`, its derivatives by the parameters from `plastic_derivatives`:
with the same factorization of the tangent where the last Newton step did not leave its pieces.

Newton's method starts from what the nearest known parameter vector needed, continued by its
derivatives: a small change of the parameters costs one or two factorizations a stage.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from geoident.errors import ModelError
from geoident.fem.elasticity import UniformModuli
from geoident.fem.location import format_point
from geoident.fem.solvers.direct import NotPositiveDefinite
from geoident.fem.yielding.domain import EmptyDomain, NoProjection
from geoident.forward.analysis.balanced_overstress import (
    SOUND,
    KnownFlow,
    balance_again,
    balance_overstress,
)
from geoident.forward.analysis.bands import band_at
from geoident.forward.analysis.collapse import carried_part, collapses
from geoident.forward.analysis.collapse_message import collapse_error, describe_mechanism
from geoident.forward.analysis.constitutive import MaterialPoints, PlasticResponse, ReachedPlanes
from geoident.forward.analysis.equilibrium import (
    LARGE_STRAIN,
    MOST_STEPS,
    SEARCH,
    overstrained,
    solve,
)
from geoident.forward.analysis.plastic_derivatives import plastic_derivatives
from geoident.forward.analysis.stage import StageTask, not_positive_definite
from geoident.forward.analysis.stage_equations import Balance, NoEquilibrium, StageEquations
from geoident.forward.analysis.stage_points import StagePoints, Turning
from geoident.forward.analysis.systems import StageSystems
from geoident.forward.analysis.tangents import StageTangents
from geoident.forward.analysis.viscous_path import BALANCED, KNOWN, StepBudget
from geoident.forward.ground.elasticity import ModuliAt
from geoident.forward.stages import ConstructionState, numbers
from geoident.forward.structures.limits import StructureLaws
from geoident.forward.yielding.surfaces import YieldLaws
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Case, format_path
from geoident.model.parameter import Values
from geoident.model.structures import Beam
from geoident.model.yielding import OF_STRUCTURE

_CONFIRMING_STEPS = 100
"""Newton steps to confirm that associated flow has no equilibrium.

In the tests arcs that lead to the whole load take up to 31, arcs to a limit load up to 47.
"""

_OUTSIDE = 1e-6
"""Excess over the yield surface, relative to the largest stress, that is not rounding."""

_KEPT, _FEWEST = 10_000_000, 4
"""Numbers of displacements, with their derivatives, that are kept of each stage, to start from the
nearest one; parameter vectors that they are kept of at least."""

_KEPT_IN_TIME = 30_000_000
"""The same numbers of all parts of a stage in time. Where they are too many derivatives are left
out, else all: a part can begin with what the last part needed."""

_SAME_SEARCH = 1e-3
"""How far apart parameter vectors are for which overstress is balanced in the same way: 6 % in one
parameter."""

_NEAR_BY = 1e-4
"""How far apart parameter vectors are of which one is worth keeping: 2 % in one parameter."""


class Haste(Enum):
    """How a search for an equilibrium is shortened, where it is one of many.

    Attributes:
        steps: Newton's where there is a potential.
        search: steps of a search where there is none.
        proves: whether it is looked for a proof where none is found.
    """

    NONE = (MOST_STEPS, SEARCH, True)
    FEW_STEPS = (20, 70, False)  # equilibria of slopes take 8 to 15, and 40 to 60
    PROOF = (0, SEARCH, True)  # the same was tried with few steps

    def __init__(self, steps: int, search: int, proves: bool) -> None:
        self.steps, self.search, self.proves = steps, search, proves


@dataclass(frozen=True)
class _Known:
    """What a stage needed at a parameter vector.

    Args:
        values: the parameters.
        names: by which it is differentiated.
        du: (n_dofs,) displacement step.
        slopes: (n_dofs, n) its derivatives.
        flow: the solutions with balanced overstress that led to it; empty for an equilibrium.
        searched: the parameters at which such flow was searched for.
    """

    values: Values
    names: tuple[str, ...]
    du: Floats
    slopes: Floats
    flow: tuple[KnownFlow, ...]
    searched: Values

    def change(self, values: Values) -> Floats:
        """(n_dofs,) what the derivatives add to du at other parameters."""
        by = [values.get(name, self.values[name]) - self.values[name] for name in self.names]
        return np.asarray(self.slopes @ np.array(by))


class WarmStart:
    """Displacement steps at parameter vectors that are known, to start Newton's method from.

    It is shared by all analyses of a model, and by those of the opening that it asks what to
    release (`openings.mesh_reaction`): what one leaves helps the next to converge. It changes the
    numbers no further than the tolerance of equilibrium, but where overstress was balanced: there
    parameters near those of the last search go on with its viscosity and its number of solutions,
    and do not ask again whether there is an equilibrium without viscosity.

    Attributes:
        released: parts of the stress that a face releases, by name, where an analysis of the
            opening found them for the parameters that come next.
    """

    def __init__(self) -> None:
        self._known: dict[object, deque[_Known]] = {}
        self.released: Values = {}

    def forget(self) -> None:
        """Forget all that is known."""
        self._known.clear()
        self.released = {}

    def _nearest(self, task: StageTask) -> _Known | None:
        """What is known nearest to the parameters, the latest of it."""
        kept, values = self._known.get(_key(task)), self._values(task)
        return min(reversed(kept), key=lambda one: _far(one.values, values)) if kept else None

    def _values(self, task: StageTask) -> dict[str, float]:
        """The parameters of a stage, with the released parts."""
        return {**self.released, **task.point.values}

    def guesses(self, task: StageTask, units: Floats) -> list[Floats]:
        """Displacement steps (n_motions,) to try: what near parameters needed, and its slope there.

        Args:
            task: the stage.
            units: (n_motions, 1) of motions, as in `StagePoints`.
        """
        known = self._nearest(task)
        if known is None:
            return []
        ends = [known.du]
        if known.names:
            ends.append(known.du + known.change(self._values(task)))
        return [end / units[:, 0] for end in ends]

    def knows(self, task: StageTask) -> bool:
        """Whether a stage has been solved at these very parameters: then it is not solved on."""
        known = self._nearest(task)
        return known is not None and known.values == self._values(task)

    def flow(self, task: StageTask, units: Floats) -> tuple[KnownFlow, ...]:
        """Solutions with balanced overstress to begin with; none where a search is due."""
        known, values = self._nearest(task), self._values(task)
        if known is None or not known.flow or _far(known.searched, values) > _SAME_SEARCH:
            return ()
        more = known.change(values)
        return tuple(replace(one, du=(one.du + more) / units[:, 0]) for one in known.flow)

    def keep(
        self, task: StageTask, du: Floats, balance: Balance, units: Floats, *, searched: bool
    ) -> None:
        """What a stage needed.

        Without derivatives it is worth less than what is known near by with them.

        Args:
            task: the stage.
            du: (n_motions, 1 + n + k).
            balance: that led to it.
            units: (n_motions, 1) of motions in it.
            searched: whether it does not go on with what `flow` gave.
        """
        nearest, values = self._nearest(task), self._values(task)
        if not task.n and nearest is not None and _far(nearest.values, values) < _NEAR_BY:
            return
        flow = tuple(
            KnownFlow(s.viscosity, s.iterate.du * units[:, 0], s.multiple) for s in balance.steps
        )
        origin = values if searched or nearest is None else nearest.searched
        names, n = task.point.names, task.forces.shape[0]
        if task.water is None:
            most = max(_FEWEST, _KEPT // (n * (1 + len(names) + len(flow)) or 1))
        else:
            room = _KEPT_IN_TIME // task.water.n_parts
            if n * (1 + len(names) + len(flow)) > room:
                names = ()
            # what balanced overstress was like must be known
            most = max(1 if flow else 0, room // (n * (1 + len(names) + len(flow)) or 1))
        if not most:
            return
        kept = self._known.setdefault(_key(task), deque())
        while len(kept) >= most:
            kept.popleft()
        slopes = du[:, 1 : 1 + len(names)].copy()
        kept.append(_Known(values, names, du[:, 0].copy(), slopes, flow, origin))


@dataclass(frozen=True)
class Localisation:
    """Where shear goes into bands at a stage whose diffuse flow ends short.

    Args:
        part: of the points that yield: that at which the acoustic tensor allows a band.
        short: part by which displacements may be off those of the diffuse flow; where overstress
            is not balanced, by which they fall short of them at least.
        balanced: whether overstress is balanced (`balanced_overstress`).
        band: words for the mode that has lost its stability and for its place; empty where none
            has, or nobody asked.
    """

    part: float
    short: float = 0.0
    balanced: bool = True
    band: str = ""


@dataclass(frozen=True, eq=False)
class PlasticFindings:
    """What an analysis finds where materials yield.

    Args:
        planes: which planes are reached.
        overstressed: stage to the part of its change of load that stress beyond the yield surface
            carries.
        localising: of these stages where shear goes into bands.
    """

    planes: ReachedPlanes
    overstressed: dict[str, float] = field(default_factory=dict)
    localising: dict[str, Localisation] = field(default_factory=dict)


@dataclass(eq=False)
class PlasticSteps:
    """Solves the stages of one analysis in which materials or structures yield.

    Args:
        case: the case.
        systems: the equations of the stages.
        warm: where Newton's method may start.
        moduli: at the parameters of the analysis; yield laws are made with them.
        explain: find the part of the load that can be carried, where there is a collapse.
        strict: of non-associated flow only the diffuse one (not localised in bands) counts.
        haste: how a search for an equilibrium may be shortened.

    Attributes:
        findings: of the analysis.
    """

    case: Case
    systems: StageSystems
    warm: WarmStart
    moduli: ModuliAt
    explain: bool
    strict: bool = False
    haste: Haste = Haste.NONE

    def __post_init__(self) -> None:
        self._laws = YieldLaws(self.moduli)
        n_strain = self.systems.discretization.points.n_strain
        parts = self.systems.structures.parts
        yielding = {part.name: part.given(self.case) for part in parts if part.structure.yields}
        self._structure_laws = StructureLaws(yielding, self.moduli.point, n_strain)
        own = self._structure_laws.limits
        planes = self._laws.limits | {_of_structure(name): one for name, one in own.items()}
        self.findings = PlasticFindings(ReachedPlanes(planes, self.case.stage_names[1:]))

    def yields(self, state: ConstructionState) -> bool:
        """Whether any material of a state yields, or a structure that works with its stiffness."""
        if self.systems.structures.yielding(state):
            return True
        return any(self.case.materials[m].yields for m in state.materials.values())

    def step(self, task: StageTask, guess: Floats | None = None) -> tuple[Floats, Bools]:
        """Solve a stage, or a part of a step in time; updates what is carried.

        Args:
            task: the stage; of a part of a step with the forces at its end, and its water.
            guess: (n_motions,) what it may need; None for nothing.

        Returns:
            Motions (n_motions, 1 + n + k) as in `StagePoints`, pressures in Pa: first of all
            displacement steps (n_dofs) beside those that supports impose. And which strain points
            (n_points,) yield.

        Raises:
            CollapseError: the loads cannot be carried.
            ModelError: the stiffness is singular, or no stress satisfies all yield planes.
        """
        with self._faults_named(task):
            points = StagePoints(self.systems, task)
            equations, units = self._equations(task, points), points.units
            flow = () if equations.associated or self.strict else self.warm.flow(task, units)
            searched = True
            try:
                again = balance_again(equations, flow)
                if again is not None and not overstrained(equations, again.end, LARGE_STRAIN):
                    searched, balance = False, again
                    if again.residual > SOUND:
                        raise NoEquilibrium(again.end.du, diffuse=again)
                else:
                    starts = [np.zeros_like(equations.forces), *self.warm.guesses(task, units)]
                    if guess is not None and len(starts) == 1:
                        starts.append(guess / units[:, 0])
                    balance = solve(
                        equations,
                        starts,
                        strict=self.strict,
                        at_start=BALANCED if self.warm.knows(task) else KNOWN,
                        most_strain=LARGE_STRAIN,
                        most_steps=self.haste.steps,
                        budget=StepBudget(self.haste.search),
                    )
            except NoEquilibrium as error:
                balance = self._after_failure(task, equations, error, points)
            end = balance.end
            equations = equations.viscous(balance.viscosity)
            du = np.zeros((len(end.du), task.forces.shape[1]))
            du[:, 0] = end.du
            stress = end.stress[..., None]
            if du.shape[1] > 1:
                du[:, 1:], slopes = plastic_derivatives(
                    task, self.systems, points, equations, balance
                )
                stress = np.concatenate([stress, slopes], axis=2)
            points.carry(stress, du)
            for response in end.flowing:
                if response.ground.hardens:
                    more = response.projection.multipliers.T[..., None]
                    task.carried.add_multipliers(
                        response.ground.name, response.points, slice(0, 1), more
                    )
            self.note(task, end.flowing, equations.grounds, end.stress)
            self._note_what_is_left(task, equations, balance)
            du *= units
            self.warm.keep(task, du, balance, units, searched=searched)
            return du, end.yielded()[: points.n_ground]

    def limited(self, task: StageTask, points: StagePoints) -> list[MaterialPoints]:
        """Ground and structures that yield in a stage, beside ground with a state of its own."""
        every = *self._grounds(task), *self._members(points)
        return [one for one in every if one.law is not None]

    def note(
        self,
        task: StageTask,
        flowing: Iterable[PlasticResponse],
        grounds: Iterable[MaterialPoints],
        stress: Floats,
    ) -> None:
        """Note which planes are reached at the end of a stage, or of a part of it.

        Args:
            task: the stage.
            flowing: what yields at its end.
            grounds: whatever is there.
            stress: (s, m) of all points at its end.
        """
        for response in flowing:
            self.findings.planes.count(task.number, response)
        for ground in grounds:
            if ground.law is not None:
                excess = ground.excess(stress[:, ground.points])
                self.findings.planes.note_excess(ground.name, excess)

    def return_stress(self, task: StageTask) -> None:
        """Bring stress and the tractions of interfaces back to limits that have become smaller.

        Args:
            task: the stage; what is carried is changed.

        Raises:
            ModelError: no stress satisfies all yield planes.
        """
        with self._faults_named(task):
            points = StagePoints(self.systems, task)
            equations = self._equations(task, points)
            still = np.zeros_like(equations.forces)
            points.carry(equations.at(still).stress[..., None], still[:, None])

    def associated(self, task: StageTask) -> bool:
        """Whether all flow in a stage is associated, so that a failure can be proven."""
        with self._faults_named(task):
            return self._equations(task, StagePoints(self.systems, task)).associated

    @contextmanager
    def _faults_named(self, task: StageTask) -> Iterator[None]:
        """Say in words what keeps a stage from being solved, whichever part of the step meets it.

        Raises:
            ModelError: the stiffness is singular, or there is no projection on yield planes.
        """
        try:
            yield
        except NotPositiveDefinite as error:
            place = self.systems.describe_unknown(task.system, error.unknown)
            raise not_positive_definite(task.state.name, place) from error
        except EmptyDomain as error:
            msg = f"the yield planes of a material contradict each other: {error}"
            raise ModelError(msg, "Raise their distances k (start values or bounds).") from error
        except NoProjection as error:
            msg = f"at {task.moment} {error}: planes of a material that nearly coincide"
            hint = "Leave out planes that are the same but for little, or move them apart."
            raise ModelError(msg, hint) from error

    def _grounds(self, task: StageTask) -> list[MaterialPoints]:
        """The materials that are there in a stage."""
        moduli, grounds = task.moduli_by_material(), []
        for name, points in task.system.points_of.items():
            law, hardened = self._laws.at(name, points), None
            if law is not None and law.hardens:
                hardened = task.carried.multipliers(name, points, 0)
            grounds.append(MaterialPoints(name, points, moduli[name], law, hardened))
        return grounds

    def _members(self, points: StagePoints) -> list[MaterialPoints]:
        """The structures that yield in a stage."""
        if points.members is None:
            return []
        laws, first = self._structure_laws, points.n_ground
        return [
            MaterialPoints(
                _of_structure(part.name),
                slice(first + part.points.start, first + part.points.stop),
                UniformModuli(laws.elasticity(part.name).value),
                laws.law(part.name),
                of_structure=True,
                bends=isinstance(part.structure, Beam),
            )
            for part in points.members.parts
        ]

    def _equations(self, task: StageTask, points: StagePoints) -> StageEquations:
        structures, n_dofs = self.systems.structures, points.n_dofs
        elastic = structures.n_rows > 0
        if points.members is not None:
            elastic = not points.members.yields.all()
        carried = task.carried.members[:, :1].copy()

        def linear(du: Floats) -> Floats:
            forces = points.water_forces(du)
            if elastic:
                more = task.rigidities[:, :1] * structures.strain(du[:n_dofs])[:, None]
                forces += points.elastic_forces(carried + more)[:, 0]
            return forces

        grounds = self._grounds(task)
        moduli = {ground.name: ground.elasticity for ground in grounds}
        tangents = StageTangents(self.systems, task, moduli, points)
        members_of = self._members(points)
        stress = np.ascontiguousarray(points.carried(slice(0, 1))[..., 0])
        turning: Callable[[Floats, Floats], Floats] | None = None
        if points.members is not None and points.members.n_turns:
            numbered = range(points.n_ground, points.n_points)
            alone = [one.restrict(np.array(numbered), points.n_points) for one in members_of]
            kept = [one for one in alone if one is not None]
            turns = Turning(points.members, kept, stress[:, points.n_ground :])

            def turning(du: Floats, guess: Floats) -> Floats:
                return turns.balanced(du[:n_dofs], guess)

        return StageEquations(
            points,
            volume=points.volume,
            dofs=points.dofs,
            grounds=[*grounds, *members_of],
            stress=stress,
            trial=np.ascontiguousarray(points.trial(slice(0, 1))[..., 0]),
            forces=points.given_forces(slice(0, 1))[:, 0],
            solver=tangents,
            linear=linear if elastic or points.n_pores else None,
            patches=tangents if points.members is None and not points.n_pores else None,
            n_turns=points.n_turns,
            n_pressures=points.n_free,
            balanced_turns=turning,
        )

    def _after_failure(
        self,
        task: StageTask,
        equations: StageEquations,
        failure: NoEquilibrium,
        points: StagePoints,
    ) -> Balance:
        """The equilibrium that Newton's method missed, if the arc of growing loads leads to it.

        Whether there is one is asked in the same way for every p, with few steps since searches
        ask it often; `explain` only adds to the message. While water flows there is no load that
        could grow by itself. Ground that dilates never collapses while its water stays in it: of
        flow with less dilation that proves nothing.

        Raises:
            CollapseError: there is none, with the part of the load that is carried where known.
            ModelError: there is none, where only diffuse flow is looked for.
        """
        associated, diffuse = equations.associated, failure.diffuse
        if self.strict and not associated:
            msg = f"at {task.moment} the ground shears in bands, with a dilation "
            raise ModelError(msg + "far below the friction") from failure
        carried, water = None, task.water
        flows = water is not None and water.h > 0.0
        if associated and not failure.proven and not flows and self.haste.proves:
            carried = carried_part(equations, failure, _CONFIRMING_STEPS)
            failure = carried.failure
            if carried.fraction >= 1.0 and carried.end is not None:
                try:
                    return solve(equations, [carried.end.du])
                except NoEquilibrium as again:
                    failure = again
        elif not associated and not failure.proven and self.haste.proves:
            balance = self._near_the_end(equations, failure)
            if balance is not None and balance.residual <= SOUND and not failure.runs_away:
                return balance
            proven = False
            if water is None:
                # Associated flow carries at least as much (Radenkovic 1961).
                proven = collapses(equations.with_associated_flow(), _CONFIRMING_STEPS)
                if balance is not None and not proven:
                    return balance
            failure = NoEquilibrium(failure.mechanism, proven=proven)
        # of a given motion no part is known
        explained = self.explain and task.motion is None and not flows
        if explained and (carried is None or not failure.proven):
            carried = carried_part(equations, failure)
            failure = carried.failure
        if carried is not None and not (explained and carried.fraction < 1.0):
            carried = None
        band, residual = None, np.nan
        if diffuse is not None:
            residual = diffuse.residual
            if self.explain:
                band = band_at(equations.viscous(diffuse.viscosity), diffuse.end)
        if band is not None:
            band = replace(band, mode=points.without_water(band.mode))
        if failure.mechanism is not None:
            mechanism = points.without_water(failure.mechanism)
            failure = NoEquilibrium(mechanism, proven=failure.proven)
        raise collapse_error(
            self.systems.on_mesh, task, failure,
            associated=associated, carried=carried, residual=residual, band=band,
            members=self.systems.member_points(task.state),
        ) from failure  # fmt: skip

    def _near_the_end(self, equations: StageEquations, failure: NoEquilibrium) -> Balance | None:
        """What the path of viscous grounds ends with where flow is not associated.

        None where there is nothing, or where strains are so large that it describes nothing.
        """
        last = failure.diffuse
        if last is None:
            return None
        balance = last if last.steps else balance_overstress(equations, last)
        if balance is None and not failure.runs_away:
            balance = last
        if balance is None or overstrained(equations, balance.end, LARGE_STRAIN):
            return None
        return balance

    def _note_what_is_left(
        self, task: StageTask, equations: StageEquations, balance: Balance
    ) -> None:
        """Note what of the load overstress carries, and where shear goes into bands then."""
        if not balance.viscosity > 0.0:
            return
        name, findings = task.state.name, self.findings
        findings.overstressed[name] = balance.residual
        text, band = "", band_at(equations, balance.end) if self.explain else None
        if band is not None:
            mode = band.mode[: len(task.forces)]
            text = f"a band has lost its stability, with half of its strain in {band.points} of "
            text += f"the {band.yielding} strain points that yield"
            text += describe_mechanism(self.systems.on_mesh, task.system, mode)
        part = equations.localising(balance.end)
        findings.localising[name] = Localisation(part, balance.short, bool(balance.steps), text)

    def refuse_virgin(self, task: StageTask) -> None:
        """Refuse an in-situ stress beyond what ground or interfaces bear, with place and factor.

        Raises:
            ModelError: it is.
        """
        if not self.yields(task.state):
            return
        points, structures = StagePoints(self.systems, task), self.systems.structures
        carried = points.carried(slice(0, 1))[..., 0]
        members = {} if points.members is None else {p.name: p for p in points.members.parts}
        for ground in self.limited(task, points):
            assert ground.law is not None
            stress = np.ascontiguousarray(carried[:, ground.points])
            position = self.systems.discretization.points.position
            name = ground.name
            path: tuple[str, ...] = ("materials", name, "yield")
            bears = f"outside the yield surface of {name}"
            if ground.of_structure:
                part = members[name.removeprefix(OF_STRUCTURE)]
                joint = structures.part(part.name).joint
                if joint is None:
                    continue
                stress[:, ~joint.points.parted] = 0.0
                position, path = joint.points.position, ("interfaces", joint.interface)
                bears = f"beyond what the interface '{joint.interface}' bears"
            excess = ground.excess(stress)
            self.findings.planes.note_excess(name, excess)
            plane, point = map(int, np.unravel_index(np.argmax(excess), excess.shape))
            beyond = float(excess[plane, point])
            if beyond <= _OUTSIDE * np.abs(stress).max():
                continue
            distance = -float(ground.law.excess(np.zeros_like(stress))[plane, point])
            if not ground.of_structure:
                point = numbers(ground.points, points.n_points)[point]
            msg = f"the in-situ stress is {bears} near {format_point(position[point])}, at its "
            msg += f"{ground.law.planes.names[plane]}: by "
            msg += (
                f"a factor of {1.0 + beyond / distance:.3g}"
                if distance > 0.0
                else (f"{beyond:.3g} Pa")
            )
            hint = "Raise the strength, or correct the in-situ stress: virgin ground must carry it."
            source = self.case.source
            raise ModelError(msg, hint, location=source.locate(path), path=format_path(path))


def _of_structure(name: str) -> str:
    """A structure that yields, beside the materials that do."""
    return f"{OF_STRUCTURE}{name}"


def _far(one: Values, other: Values) -> float:
    """How far two parameter vectors are from each other, each parameter by its size."""
    return sum(
        ((one[name] - x) / (abs(one[name]) + abs(x) + 1e-300)) ** 2
        for name, x in other.items()
        if name in one
    )


def _key(task: StageTask) -> object:
    """What tells a stage, or a part of a step, from others.

    Of this analysis or of another one of the same ground.
    """
    state = task.state
    return (
        state.name,
        None if task.water is None else task.water.span,
        state.structures,
        *map(frozenset, (state.loads, state.supports, state.leaving)),
    )

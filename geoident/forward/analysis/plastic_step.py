"""A step of the analysis where materials yield (theory 2 and 5).

What the ground bears is said by `constitutive`. The state follows from `equilibrium`, its
derivatives by the parameters from `plastic_derivatives`: with the same factorization of the tangent
where the last Newton step did not leave its pieces.

Newton's method starts from what the nearest known parameter vector needed, continued by its
derivatives: a small change of the parameters costs one or two factorizations a stage.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from geoident.errors import ModelError
from geoident.fem.location import format_point
from geoident.fem.solvers.direct import NotPositiveDefinite
from geoident.fem.yielding.domain import EmptyDomain, NoProjection
from geoident.forward.analysis.bands import band_at
from geoident.forward.analysis.collapse import collapse_error, describe_mechanism, limit_of
from geoident.forward.analysis.constitutive import Ground, ReachedPlanes, grounds_of
from geoident.forward.analysis.equilibrium import solve
from geoident.forward.analysis.plastic_derivatives import plastic_derivatives
from geoident.forward.analysis.stage import (
    LastEquilibrium,
    StageTask,
    impose_motion,
    not_positive_definite,
)
from geoident.forward.analysis.stage_equations import (
    Balance,
    NoEquilibrium,
    StageEquations,
    Trial,
)
from geoident.forward.analysis.systems import StageSystems
from geoident.forward.analysis.tangents import StageTangents
from geoident.forward.analysis.viscous_path import StepBudget
from geoident.forward.ground.elasticity import ModuliAt
from geoident.forward.stages import ConstructionState, numbers
from geoident.forward.yielding.surfaces import YieldLaws
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Case, format_path
from geoident.model.parameter import Values

_OUTSIDE = 1e-6
"""Excess over the yield surface, relative to the largest stress, that is not rounding."""

_WITHOUT_MEANING = 1.0
"""Strain of yielding points beyond which an equilibrium needs the confirmation of the arc.

Meshes that lock under flow without change of volume let pressures grow without end: where all else
flows, Newton's method finds equilibria kilometres away (Nagtegaal, Parks, Rice 1974).
"""

_KEPT, _FEWEST = 10_000_000, 4
"""Numbers of displacements, with their derivatives, that are kept of each stage, to start from the
nearest one; parameter vectors that they are kept of at least."""

_NEAR_BY = 1e-4
"""How far apart parameter vectors are of which one is worth keeping: 2 % in one parameter."""

_RESOLUTION = 1 / 512
"""To which the part of a load that is carried is known where there is no potential."""

_PARTS = 80
"""Newton steps for the part that could be balanced, where collapse is not proven."""


@dataclass(frozen=True)
class _Known:
    """What a stage needed at a parameter vector: du (n_dofs,), its derivatives (n_dofs, n)."""

    values: Values
    names: tuple[str, ...]
    du: Floats
    slopes: Floats


class WarmStart:
    """Displacement steps at parameter vectors that are known, to start Newton's method from.

    It is shared by all analyses of a model: what one leaves helps the next to converge, and changes
    its numbers no further than the tolerance of equilibrium.
    """

    def __init__(self) -> None:
        self._known: dict[int, deque[_Known]] = {}

    def guesses(self, task: StageTask) -> list[Floats]:
        """Displacement steps (n_dofs,) to try: what near parameters needed, and its slope there."""
        kept = self._known.get(task.number)
        if not kept:
            return []
        values = task.point.values
        known = min(kept, key=lambda one: _far(one.values, values))
        change = [values[name] - known.values[name] for name in known.names]
        return [known.du, known.du + known.slopes @ np.array(change)]

    def keep(self, task: StageTask, du: Floats) -> None:
        """What a stage needed: du (n_dofs, 1 + n + k).

        Without derivatives it is worth less than what is known near by with them.
        """
        known = self._known.get(task.number, ())
        if not task.n and any(_far(one.values, task.point.values) < _NEAR_BY for one in known):
            return
        slopes = du[:, 1 : 1 + task.n].copy()
        most = max(_FEWEST, _KEPT // (task.forces.shape[0] * (1 + task.n) or 1))
        kept = self._known.setdefault(task.number, deque())
        while len(kept) >= most:
            kept.popleft()
        kept.append(_Known(dict(task.point.values), task.point.names, du[:, 0].copy(), slopes))


@dataclass(frozen=True)
class Localisation:
    """Where shear goes into bands at a stage whose even flow ends short.

    Args:
        part: of the points that yield: that at which the acoustic tensor allows a band.
        short: part by which displacements are short of those that the even flow promises.
        band: words for the mode that has lost its stability and for its place; empty where none
            has, or nobody asked.
    """

    part: float
    short: float = 0.0
    band: str = ""


@dataclass(frozen=True, eq=False)
class PlasticFindings:
    """What an analysis finds where materials yield.

    Args:
        planes: which planes are reached.
        unbalanced: stage to the part of its change of load that is not balanced.
        overstressed: stage to the part of the overstress that is kept.
        localising: of these stages where shear goes into bands.
    """

    planes: ReachedPlanes
    unbalanced: dict[str, float] = field(default_factory=dict)
    overstressed: dict[str, float] = field(default_factory=dict)
    localising: dict[str, Localisation] = field(default_factory=dict)


@dataclass(eq=False)
class PlasticSteps:
    """Solves the stages of one analysis in which materials yield.

    Args:
        case: the case.
        systems: the equations of the stages.
        warm: where Newton's method may start.
        ground: the moduli at the parameters of the analysis; yield laws are made with them.
        explain: find the part of the load that can be carried, where there is a collapse.
        even_only: without potential, no flow in bands of shear is looked for.

    Attributes:
        findings: of the analysis.
    """

    case: Case
    systems: StageSystems
    warm: WarmStart
    ground: ModuliAt
    explain: bool
    even_only: bool = False

    def __post_init__(self) -> None:
        self._laws = YieldLaws(self.ground)
        self.findings = PlasticFindings(ReachedPlanes(self._laws, self.case.stage_names[1:]))

    def yields(self, state: ConstructionState) -> bool:
        """Whether any material of a state yields."""
        return any(self.case.materials[m].yields for m in state.materials.values())

    def step(self, task: StageTask) -> tuple[Floats, Bools]:
        """Solve a stage; updates what is carried.

        Returns:
            Displacement steps (n_dofs, 1 + n + k), and which strain points (n_points,) yield.

        Raises:
            CollapseError: the loads cannot be carried.
            ModelError: the stiffness is singular, or no stress satisfies all yield planes.
        """
        with self._told(task):
            return self._stepped(task)

    @contextmanager
    def _told(self, task: StageTask) -> Iterator[None]:
        """What keeps a stage from being solved in words, whichever part of the step meets it.

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
            msg = f"at stage '{task.state.name}' {error}: planes of a material that nearly coincide"
            hint = "Leave out planes that are the same but for little, or move them apart."
            raise ModelError(msg, hint) from error

    def _stepped(self, task: StageTask) -> tuple[Floats, Bools]:
        """See `step`.

        Raises:
            CollapseError: the loads cannot be carried.
        """
        grounds = grounds_of(task, self._laws)
        try:
            return self._solved(task, grounds)
        except NoEquilibrium as error:  # of flow without potential
            if self.even_only and not error.limit:
                msg = f"at stage '{task.state.name}' the ground shears in bands, with a dilation "
                raise ModelError(msg + "far below the friction") from error
            part, even, band, reached = np.nan, error.even, None, None
            if self.explain:
                if even is not None:
                    viscous = self._equations(task, grounds).viscous(even.viscosity)
                    band = band_at(viscous, even.trial)
                if task.motion is None:
                    part, reached, error = self._carried_part(task, grounds, error)
            raise collapse_error(
                self.systems.on_mesh, task, part, error.mechanism,
                proven=error.limit, ended=even, band=band, reached=reached,
            ) from error  # fmt: skip

    def refuse_virgin(self, task: StageTask) -> None:
        """Refuse an in-situ stress outside a yield surface, with place and factor.

        Raises:
            ModelError: it is.
        """
        if not self.yields(task.state):
            return
        for ground in grounds_of(task, self._laws):
            if not ground.yields:
                continue
            stress = np.ascontiguousarray(task.carried.stress[:, ground.points, 0])
            excess = self.findings.planes.reach(ground, stress)
            plane, point = np.unravel_index(np.argmax(excess), excess.shape)
            if excess[plane, point] > _OUTSIDE * np.abs(stress).max():
                name, distance = ground.limit(int(plane), int(point), stress)
                raise self._outside(ground, int(point), name, excess[plane, point], distance)

    def _outside(
        self, ground: Ground, point: int, plane: str, excess: float, distance: float
    ) -> ModelError:
        points = self.systems.discretization.points
        at = numbers(ground.points, points.n_points)[point]
        msg = f"the in-situ stress is outside the yield surface of {ground.name} near "
        msg += f"{format_point(points.position[at])}, at its {plane}"
        if distance > 0.0:
            msg += f": by a factor of {1.0 + excess / distance:.3g}"
        else:
            msg += f": by {excess:.3g} Pa"
        hint = "Raise the strength, or correct the in-situ stress: virgin ground must carry it."
        source = self.case.source
        path = ("materials", ground.name, "yield")
        return ModelError(msg, hint, location=source.locate(path), path=format_path(path))

    def _carried_part(
        self, task: StageTask, grounds: Sequence[Ground], error: NoEquilibrium
    ) -> tuple[float, LastEquilibrium | None, NoEquilibrium]:
        """The part of the change of load that is carried, found by halving, and how it fails.

        With the equilibrium under that part, where any was found.

        Where the whole load has no even flow, only even flow of its parts is looked for, with few
        steps: each part beyond the last would be lost where the whole is.
        """
        even_only = not error.limit
        equations = self._equations(task, grounds)
        before, least, most = equations.before(), 0.0, 1.0
        du, reached, budget = np.zeros_like(before), None, StepBudget(_PARTS)
        while most - least > _RESOLUTION and (error.limit or budget.left > 0):
            part = 0.5 * (least + most)
            under = equations.under(before + part * (equations.forces - before))
            try:
                balance = solve(
                    under,
                    [np.zeros_like(before), du],
                    even_only=even_only,
                    budget=None if error.limit else budget,
                )
                if self._means_nothing(under, balance):
                    raise NoEquilibrium(balance.trial.du)
                least, du = part, balance.trial.du
                reached = _last(under, balance.trial)
            except NoEquilibrium as failed:
                most = part
                if failed.mechanism is not None and (failed.limit or not error.limit):
                    error = failed
        return least, reached, error

    def _solved(self, task: StageTask, grounds: Sequence[Ground]) -> tuple[Floats, Bools]:
        impose_motion(task, self.systems)
        equations = self._equations(task, grounds)
        balance = self._balance(task, equations, self.warm.guesses(task))
        du = np.zeros_like(task.forces)
        du[:, 0] = balance.trial.du
        equations = equations.viscous(balance.viscosity)
        if du.shape[1] > 1:
            du[:, 1:] = plastic_derivatives(task, self.systems, equations, balance)
        self._accept(task, equations, balance.trial)
        if balance.unbalanced > 0.0:
            self.findings.unbalanced[task.state.name] = balance.unbalanced
        if balance.viscosity > 0.0:
            self.findings.overstressed[task.state.name] = balance.viscosity
        if balance.unbalanced > 0.0 or balance.viscosity > 0.0:
            self.findings.localising[task.state.name] = self._localisation(task, equations, balance)
        self.warm.keep(task, du)
        if task.motion is not None:
            du[:, : task.motion.shape[1]] += task.motion
        return du, yielded_points(equations, balance.trial)

    def _localisation(
        self, task: StageTask, equations: StageEquations, balance: Balance
    ) -> Localisation:
        """Where shear goes into bands at the end of a stage."""
        part, band = equations.localising(balance.trial), None
        if self.explain:
            band = band_at(equations, balance.trial)
        if band is None:
            return Localisation(part, balance.short)
        text = f"a band has lost its stability, with half of its strain in {band.points} of the "
        text += f"{band.yielding} strain points that yield"
        text += describe_mechanism(self.systems.on_mesh, task.system, band.mode)
        return Localisation(part, balance.short, text)

    def _equations(self, task: StageTask, grounds: Sequence[Ground]) -> StageEquations:
        members: Callable[[Floats], Floats] | None = None
        if self.systems.structures.n_rows:

            def members(du: Floats) -> Floats:
                more = task.rigidities[:, 0] * self.systems.structures.strain(du)
                total = (task.carried.members[:, 0] + more)[:, None]
                return self.systems.structures.nodal_forces(total)[:, 0]

        moduli = {ground.name: ground.elasticity for ground in grounds}
        tangents = StageTangents(self.systems, task, moduli)
        return StageEquations(
            self.systems.discretization.points,
            volume=task.system.volume,
            dofs=task.system.dofs,
            grounds=grounds,
            stress=np.ascontiguousarray(task.carried.stress[..., 0]),
            forces=task.forces[:, 0],
            tangents=tangents,
            members=members,
            patches=tangents,
        )

    def _balance(
        self, task: StageTask, equations: StageEquations, guesses: Sequence[Floats]
    ) -> Balance:
        """Equilibrium, or the reason why there is none."""
        try:
            starts = [np.zeros_like(equations.forces), *guesses]
            balance = solve(equations, starts, even_only=self.even_only)
            if self._means_nothing(equations, balance):
                raise NoEquilibrium(balance.trial.du)
            return balance
        except NoEquilibrium as error:
            if not equations.associated:
                raise
            # Whoever searches needs only to know that there is none.
            if not self.explain:
                raise collapse_error(self.systems.on_mesh, task, np.nan, error.mechanism) from error
            return self._after_limit(task, equations, error)

    def _means_nothing(self, equations: StageEquations, balance: Balance) -> bool:
        """Whether yielding points are strained beyond what small strains can describe."""
        flows = equations.flowing(balance.trial)
        strain = self.systems.discretization.points.strain(balance.trial.du)
        return any(np.abs(strain[:, flow.points]).max() > _WITHOUT_MEANING for flow in flows)

    def _after_limit(
        self, task: StageTask, equations: StageEquations, error: NoEquilibrium
    ) -> Balance:
        """Follow the arc of equilibria: it ends at collapse, or leads to the whole load."""
        limit = limit_of(equations)
        if limit.fraction < 1.0:
            if task.motion is not None:  # what is carried of it is not known
                raise collapse_error(self.systems.on_mesh, task, np.nan, error.mechanism) from error
            reached = _last(equations, equations.at(limit.du))
            raise collapse_error(
                self.systems.on_mesh, task, limit.fraction, error.mechanism, reached=reached
            ) from error
        try:
            return solve(equations, [limit.du])
        except NoEquilibrium as again:
            raise collapse_error(self.systems.on_mesh, task, np.nan, again.mechanism) from again

    def _accept(self, task: StageTask, equations: StageEquations, trial: Trial) -> None:
        """The state of what is carried after the step."""
        task.carried.stress[..., 0] = trial.stress
        if self.systems.structures.n_rows:
            task.carried.members[:, 0] += task.rigidities[:, 0] * self.systems.structures.strain(
                trial.du
            )
        for flow in equations.flowing(trial):
            if flow.ground.hardens:
                more = flow.multipliers.T[..., None]
                task.carried.add_multipliers(flow.ground.name, flow.points, slice(0, 1), more)
            self.findings.planes.flow(task.number, flow)
        for ground in equations.grounds:
            if ground.yields:
                self.findings.planes.reach(ground, trial.stress[:, ground.points])


def _last(equations: StageEquations, trial: Trial) -> LastEquilibrium:
    """A trial in equilibrium, to be kept."""
    return LastEquilibrium(trial.du.copy(), trial.stress.copy(), yielded_points(equations, trial))


def _far(one: Values, other: Values) -> float:
    """How far two parameter vectors are from each other, each parameter by its size."""
    return sum(
        ((one[name] - x) / (abs(one[name]) + abs(x) + 1e-300)) ** 2 for name, x in other.items()
    )


def yielded_points(equations: StageEquations, trial: Trial) -> Bools:
    """(n_points,) strain points with a positive multiplier."""
    result = np.zeros(equations.operators.n_points, dtype=bool)
    for flow in equations.flowing(trial):
        result[flow.points] = flow.flowing
    return result

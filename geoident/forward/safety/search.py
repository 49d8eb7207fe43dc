"""The factor of safety of a stage: strength is divided until no equilibrium is left (theory 5.14).

The reduction is a phase after the stage, as in practice: it begins with the stress, the motions and
the forces in structures at its end, under its loads, which stay. With less strength stress lies
outside the yield surface, is returned, and what is then out of balance moves the ground. Each trial
goes on from the equilibrium with the largest factor so far. With associated flow the limit depends
on none of this: whether loads can be carried is a question of strength alone (limit analysis), and
a failure that is proven (`equilibrium`) proves that the factor is smaller.

A stage that collapses with the strength that it has is reached with more: with half the factor,
and so on. The factor found is below one then. One of hardening soil that finds no equilibrium is
first reached with the limit of that soil alone.

In stages that consolidate the water stays as it is at the moment: its pressures act on, strength is
that of effective stress.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.errors import CollapseError, ModelError
from geoident.fem.yielding.principal_axes import principal_values
from geoident.forward.analysis.analysis import AnalysisRun, RunOptions, StagedAnalysis
from geoident.forward.analysis.collapse_message import (
    describe_mechanism,
    describe_slips,
    mechanism_on_mesh,
)
from geoident.forward.analysis.plastic_step import Haste, PlasticSteps, WarmStart
from geoident.forward.analysis.stage import StageEnd, StageTask, StressState
from geoident.forward.ground.elasticity import ModuliAt
from geoident.forward.model import StagedModel
from geoident.forward.safety.strengths import reducible, with_reduced_strength
from geoident.forward.structures.members import StructureMembers
from geoident.model.arrays import Floats
from geoident.model.case import Material
from geoident.model.dual import ParameterPoint
from geoident.model.results.safety import StageSafety
from geoident.model.results.yielded import Mechanism

TOLERANCE = 0.01
"""Relative width of the bracket in which a factor is found."""

MOST = 20.0
"""Factor up to which it is looked for."""

LEAST = 1.0 / 16.0
"""Factor with which a stage must stand at last."""

_FIRST, _GROWTH, _LARGEST = 1.08, 1.6, 2.0
"""First step up from the factor at which the search begins; power by which steps grow; largest."""

_SOUND = 0.05
"""Part of what a reduction puts out of balance that stress beyond the surface may carry at most."""

_MOST_STRAIN = 0.1
"""Strain by the reduction beyond which the ground counts as failed: meshes that lock under flow
without change of volume find equilibria far away, where small strains describe nothing. It is the
mean of the strain with the strain as weight, that of the part that flows: the largest one has no
bound beside the edge of a footing."""

_ALIKE = 1.15
"""Factor up to which the mechanism of a proven collapse stands for that of a smaller one."""

_NEAR = 1.04
"""How far from a guess the search begins, as a factor."""


@dataclass(frozen=True)
class Search:
    """How a factor is looked for.

    Args:
        tolerance: relative width of the bracket at its end.
        most: largest factor that is tried.
        guess: about what the factor is; None where nobody knows.
        in_situ_too: go on with more strength where the in-situ stress is beyond it, too; else that
            is an error of the case.
        tell: is told what is going on, a few words.
    """

    tolerance: float = TOLERANCE
    most: float = MOST
    guess: float | None = None
    in_situ_too: bool = False
    tell: Callable[[str], None] = lambda words: None


@dataclass(frozen=True)
class _Reached:
    """A stage that was brought to equilibrium with strength divided by a factor.

    Args:
        factor: 1, or less where the stage collapses.
        carried: stress and forces at its end.
        forces: (n_dofs, 1) that act.
        confined: material to the largest confining stress, Pa.
        collapse: of the stage at twice the factor; None at 1, and where it was not asked there.
    """

    factor: float
    carried: StressState
    forces: Floats
    confined: Mapping[str, float]
    collapse: CollapseError | None


def safety_factors(
    model: StagedModel, p: Floats, states: Sequence[int], search: Search
) -> Iterator[tuple[StageSafety, Mechanism | None]]:
    """The factors of safety of some states, one by one, each with how the ground fails beyond it.

    The motion is the part that is proven to go on without end, else that between the last two
    equilibria; None where nothing is known.

    Args:
        model: of the case.
        p: (n,) parameters, SI.
        states: numbers of states after the virgin one, ascending.
        search: how.

    Raises:
        CollapseError: a stage collapses even with 16 times the strength.
        ModelError: the model has no solution for another reason.
    """
    reached = dict[int, _Reached]()
    for number in states:
        if number not in reached:
            reached |= _reached(model, p, [n for n in states if n >= number], search)
        yield _Reduction(model, p, number, reached[number], search).found()


def _reached(
    model: StagedModel, p: Floats, states: Sequence[int], search: Search
) -> dict[int, _Reached]:
    """Those of some states, of which the first is one, that stand at one factor.

    Raises:
        CollapseError: the first stands with no factor.
        ModelError: the in-situ stress is beyond the strength, or there is no solution otherwise.
    """
    factor, collapse, limit = 1.0, None, False
    options = RunOptions(derivatives=False, last=states[-1], explain=False, partial=True)
    while True:
        search.tell(f"strength / {factor:g}")
        run = _run(model, p, factor, options, limit=limit)
        found = dict[int, _Reached]()
        try:
            for end in run.states():
                if end.number in states and np.isfinite(end.u).all():
                    found[end.number] = _kept(model, end, factor, collapse)
        except ModelError:  # no collapse: these are among the findings
            if not search.in_situ_too or factor <= LEAST:
                raise
            collapse = None
        else:
            if states[0] in found:
                return found
            collapse = next(iter(run.findings.collapses))
            if factor <= LEAST:
                raise collapse
        if model.case.hardens and not limit:
            limit, collapse = True, None
            continue
        factor *= 0.5


def _run(
    model: StagedModel, p: Floats, factor: float, options: RunOptions, *, limit: bool
) -> AnalysisRun:
    """An analysis with strength divided by a factor; of hardening soil its limit alone, if so."""
    if factor == 1.0 and not limit:
        return model.at(p, options)
    values, confined = model.values(p), _virgin_confinement(model, p)
    on_mesh = with_reduced_strength(model.on_mesh, values, factor, confined)
    analysis = StagedAnalysis(on_mesh, model.systems, model.face, WarmStart())
    return AnalysisRun(analysis, ParameterPoint(values, ()), options)


def _virgin_confinement(model: StagedModel, p: Floats) -> dict[str, float]:
    stress, _ = model.analysis.virgin(ParameterPoint(model.values(p), ()))
    return _confinement(model, 0, stress[..., 0])


def _confinement(model: StagedModel, number: int, stress: Floats) -> dict[str, float]:
    """Material to the largest confining stress, Pa, compression positive, in a stress (s, m)."""
    return {
        name: max(0.0, -float(principal_values(np.ascontiguousarray(stress[:, points]))[0].min()))
        for name, points in model.systems[number].points_of.items()
    }


def _kept(
    model: StagedModel, end: StageEnd, factor: float, collapse: CollapseError | None
) -> _Reached:
    """What the search needs of a state, copied."""
    assert end.forces is not None
    assert end.relieved is not None
    hardened = {name: values[..., :1].copy() for name, values in end.hardened.items()}
    forces = end.members[:, :1].copy(), end.relieved[:, :1].copy()
    carried = StressState(end.stress[..., :1].copy(), *forces, hardened)
    confined = _confinement(model, end.number, end.stress[..., 0])
    return _Reached(factor, carried, end.forces[:, :1].copy(), confined, collapse)


class _Reduction:
    """The search for the factor of one stage.

    Args:
        model: of the case.
        p: (n,) parameters.
        number: of the state.
        reached: the state, and with which factor it stands.
        search: how.
    """

    def __init__(
        self, model: StagedModel, p: Floats, number: int, reached: _Reached, search: Search
    ) -> None:
        self._model, self._number, self._search = model, number, search
        self._point = ParameterPoint(model.values(p), ())
        self._reached, self._carried = reached, reached.carried
        self._moved = [np.zeros(len(reached.forces))]
        self._factors = [reached.factor]
        self._proven = False  # whether the last failure is
        self._hasty = False  # whether the last failure is that of a hasty search
        self._collapse: tuple[float, CollapseError] | None = None  # the last that is proven

    def found(self) -> tuple[StageSafety, Mechanism | None]:
        """The factor of safety, and how the ground fails beyond it."""
        low, high = self._narrowed()
        state = self._model.sequence.states[self._number]
        mechanism, place = self._mechanism(high)
        materials, joints = self._materials(), self._joints()
        structures = self._model.case.structures
        elastic = [n for n in sorted(state.structures) if not structures[n].yields]
        elastic += [p.name for p in joints if not p.structure.yields]
        kept = [m.name for m in materials if m.yields and not reducible(m)]
        n = len(self._model.names)
        row = StageSafety(
            stage=state.name,
            value=float(np.sqrt(low * high)) if np.isfinite(high) else low,
            lower=low,
            upper=high,
            proven=self._proven,
            associated=self._associated(low),
            kept=", ".join((*kept, *(n for n in sorted(state.structures) if structures[n].yields))),
            unyielding=", ".join((*(m.name for m in materials if m.is_elastic), *elastic)),
            place=place,
            tried=np.array(self._factors),
            moved=np.array([np.abs(u).max(initial=0.0) for u in self._moved]),
            influence=np.full(n, np.nan),
            draws=np.zeros((0, n)),
        )
        return row, mechanism

    def _narrowed(self) -> tuple[float, float]:
        """The ends of the last bracket, of which the upper one fails for sure, or is infinite."""
        narrow = 1.0 + self._search.tolerance
        low, high = self._bracket(self._reached.factor, _FIRST)
        while True:
            while high / low > narrow and np.isfinite(high):
                middle = float(np.sqrt(low * high))
                # a failure that would be the last one, and cannot be proven, is looked for once
                surely = middle / low <= narrow and not self._associated(middle)
                stands = self._stands(middle, surely=surely)
                low, high = (middle, high) if stands else (low, middle)
            if not (self._hasty and np.isfinite(high)) or not self._stands(high, surely=True):
                return low, high
            low, high = self._bracket(high, narrow)

    def _materials(self) -> list[Material]:
        """Those that are there."""
        state = self._model.sequence.states[self._number]
        return [self._model.case.materials[m] for m in dict.fromkeys(state.materials.values())]

    def _joints(self) -> list[StructureMembers]:
        """The parts of interfaces that stand."""
        state, parts = self._model.sequence.states[self._number], self._model.structures.parts
        return [part for part in parts if part.joint is not None and part.stands(state)]

    def _bracket(self, low: float, step: float) -> tuple[float, float]:
        """A factor with which the stage stands, and a larger one with which not, or infinity.

        Args:
            low: one with which it stands.
            step: the first by which that is multiplied.
        """
        most, guess, collapse = self._search.most, self._search.guess, self._reached.collapse
        if collapse is not None and low < 2.0 * self._reached.factor:
            self._note(2.0 * self._reached.factor, collapse)
            return low, 2.0 * self._reached.factor
        if guess is not None and low * _NEAR < guess < most:
            if not self._stands(guess / _NEAR):
                return low, guess / _NEAR
            low, step = guess / _NEAR, _NEAR**2
        while low < most:
            trial = min(low * step, most)
            if not self._stands(trial):
                return low, trial
            low, step = trial, min(step**_GROWTH, _LARGEST)
        return low, np.inf

    def _associated(self, factor: float) -> bool:
        """Whether all flow with strength divided by a factor is associated."""
        return self._steps(factor).associated(self._task(self._carried))

    def _stands(self, factor: float, *, surely: bool = False) -> bool:
        """Whether there is an equilibrium with strength divided by a factor; it is gone on from.

        Most of the time goes where there is none. So a few steps are tried first; where the bracket
        ends a proof is, with associated flow, and if that is not found all else.

        Args:
            factor: F.
            surely: try all.
        """
        self._search.tell(f"strength / {factor:.4g}" + (", for sure" if surely else ""))
        if not surely:
            return self._tried(factor, Haste.FEW_STEPS)
        if self._associated(factor):
            if self._tried(factor, Haste.PROOF):
                return True
            if self._proven:
                return False
        return self._tried(factor, Haste.NONE)

    def _tried(self, factor: float, haste: Haste) -> bool:
        """The same, as far as a search goes that is shortened."""
        carried, surely = self._carried.copy(), haste.proves
        steps, task = self._steps(factor, haste), self._task(carried)
        steps.return_stress(task)
        try:
            du, _ = steps.step(task)
        except CollapseError as error:
            self._note(factor, error)
            self._hasty = not (surely or error.proven)
            return False
        if max(steps.findings.overstressed.values(), default=0.0) > _SOUND:
            self._proven, self._hasty = False, not surely
            return False
        moved = self._moved[-1] + du[: len(self._moved[-1]), 0]
        points, present = self._model.discretization.points, task.system.present
        strain = np.abs(points.strain(moved)[:, present]).max(axis=0, initial=0.0)
        weight = points.volume[present] * strain
        if weight @ strain > _MOST_STRAIN * weight.sum():
            self._proven = self._hasty = False
            return False
        self._carried = carried
        self._factors.append(factor)
        self._moved.append(moved)
        return True

    def _note(self, factor: float, collapse: CollapseError) -> None:
        """Note how the stage fails with a factor, the smallest so far."""
        self._proven, self._hasty = collapse.proven, False
        if collapse.proven and collapse.mechanism is not None:
            self._collapse = factor, collapse

    def _steps(self, factor: float, haste: Haste = Haste.NONE) -> PlasticSteps:
        model = self._model
        on_mesh = with_reduced_strength(
            model.on_mesh, self._point.values, factor, self._reached.confined
        )
        moduli = ModuliAt(on_mesh, self._point, model.discretization.points.n_strain)
        return PlasticSteps(
            on_mesh.case, model.systems, WarmStart(), moduli, explain=False, haste=haste
        )

    def _task(self, carried: StressState) -> StageTask:
        """The state once more, with nothing new that acts or moves."""
        model, state = self._model, self._model.sequence.states[self._number]
        ground = ModuliAt(model.on_mesh, self._point, model.discretization.points.n_strain)
        return StageTask(
            self._number,
            model.systems[self._number],
            state,
            self._point,
            ground,
            carried,
            self._reached.forces,
            rigidities=model.structures.moduli(state, self._point),
        )

    def _mechanism(self, high: float) -> tuple[Mechanism | None, str]:
        """How the ground moves as it fails, on its mesh, and in words.

        The motion that is proven to go on without end; else that between the last two equilibria.

        Args:
            high: factor with which it fails; infinite where it does not.
        """
        if not np.isfinite(high):
            return None, ""
        u = None
        if self._collapse is not None and self._collapse[0] < _ALIKE * high:
            u = self._collapse[1].mechanism
        elif len(self._moved) > 1:
            u = self._moved[-1] - self._moved[-2]
        if u is None or not u.any():
            return None, ""
        model, task = self._model, self._task(self._carried)
        u = u / np.abs(u).max()
        joints, jumps = self._joints(), model.structures.strain(u)
        place = describe_slips(joints, jumps)
        if not all(material.is_elastic for material in self._materials()):
            place += describe_mechanism(model.on_mesh, task.system, u)
        place = place.removeprefix("; ")
        return mechanism_on_mesh(model.on_mesh, task, u, np.nan, joints, jumps), place

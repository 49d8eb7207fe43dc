"""The marches of a case at any parameter vector, and what they have cost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np

from geoident.fem.solvers.direct import Solver
from geoident.fem.solvers.kept_solutions import KeepsSolutions, SolutionStore
from geoident.forward.checks import inadmissible_numbers
from geoident.forward.gauges.adjoints import AdjointTable
from geoident.forward.gauges.instrument_errors import InstrumentErrors
from geoident.forward.gauges.observable import MarchState
from geoident.forward.gauges.observation import Observation
from geoident.forward.ground.elasticity import inadmissible_moduli
from geoident.forward.march.march import KnownMotion, March, Run, RunOptions
from geoident.forward.march.stage import StageEnd
from geoident.forward.march.systems import StageSystems
from geoident.forward.openings.face import advancing_face
from geoident.forward.stages import CaseOnMesh
from geoident.model.arrays import Floats
from geoident.model.dual import ParameterPoint
from geoident.model.results.costs import Counts

WHOLE = RunOptions()
"""All states with their derivatives."""


MOST_KEPT = 100_000_000
"""Numbers that the states of a march may take: 0.8 GB."""

See = Callable[[StageEnd, Run], tuple[Floats, tuple[str, ...]]]
"""What all channels see of a state, (n_channels, 1 + n), and whose principal stresses coincide."""


@dataclass(eq=False)
class KeptMarch:
    """One elastic march with derivatives, as far as it was asked for: it goes on where it was left.

    A fit asks for the readings of its last parameters, then for what the mesh does to them, at the
    end for all that later stages will show. All of it is one march. Of a state is kept what does
    not depend on the number of parameters: its displacements and stresses, and what the gauges see
    of it.

    Args:
        run: whose states are wanted, to the last one.
        see: what gauges see.

    Attributes:
        ends: the states so far; of displacements and stresses, their values alone.
        observed: of every state, what all channels see with derivatives, (n_channels, 1 + n).
        equal: of every state, the channels that read one of several equal principal stresses.
    """

    run: Run
    see: See
    ends: list[StageEnd] = field(default_factory=list)
    observed: list[Floats] = field(default_factory=list)
    equal: list[tuple[str, ...]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._states = self.run.states()

    @property
    def p(self) -> tuple[float, ...]:
        """The values of all parameters."""
        return tuple(self.run.given.values.values())

    @property
    def last(self) -> int:
        """The state to which it has come; -1 before the first."""
        return len(self.ends) - 1

    def go_on(self, last: int, tell: Callable[[StageEnd, Run], None] | None = None) -> None:
        """March on to a state. It holds no factor while it waits.

        Args:
            last: index of the state.
            tell: is given every state that is computed now, whole, with the run; its arrays change.

        Raises:
            ModelError: the stiffness of a stage is not positive definite. It cannot go on then.
        """
        for end in islice(self._states, max(last - self.last, 0)):
            observed, equal = self.see(end, self.run)
            if tell is not None:
                tell(end, self.run)
            self.observed.append(observed)
            self.equal.append(equal)
            self.ends.append(_values(end))
        self.run.factors.forget()


class Marches:
    """Marches of a case with its gauges, each counted.

    Args:
        on_mesh: the case and the mesh that it fits.
        observation: its gauges there.
        solver: factorizes the stiffness matrices.

    Attributes:
        on_state: is told of every state computed.
        last_adjoints: readings with their derivatives at the parameters that were evaluated last.
        face: what turns distances to a tunnel face into released parts.
    """

    def __init__(self, on_mesh: CaseOnMesh, observation: Observation, *, solver: Solver) -> None:
        self.on_mesh, self.observation = on_mesh, observation
        self.case, self.mesh, self.sequence = on_mesh.case, on_mesh.mesh, on_mesh.sequence
        self.names = tuple(parameter.name for parameter in self.case.parameters)
        self.instrument_errors = InstrumentErrors(self.case, self.sequence.built_on)
        self._solver = solver
        self._evaluations = 0
        self.on_state: Callable[[int], None] | None = None
        self.last_adjoints: AdjointTable | None = None
        self.discretization = on_mesh.discretization
        self.systems = StageSystems(on_mesh, solver)
        self.structures = self.systems.structures
        self.face = advancing_face(on_mesh, solver)
        self.march = March(on_mesh, self.systems, self.face)
        self.actions = self.march.actions
        self._kept: KeptMarch | None = None
        self._paid: tuple[bytes | None, int] = None, -1
        self._free = Counts()
        self._lent: tuple[bytes, KnownMotion] | None = None

    @property
    def counts(self) -> Counts:
        """Costs so far."""
        spent = self._spent()
        return replace(spent, evaluations=self._evaluations) - self._free

    def keep_solutions(self, store: SolutionStore | None) -> None:
        """Have solutions that take long kept, where the solver can; None for no longer."""
        if isinstance(self._solver, KeepsSolutions):
            self._solver.keep_solutions(store)

    def _spent(self) -> Counts:
        """What the solver has done so far."""
        done = self._solver.counts
        return Counts(0, done.analyses, done.factorizations, done.solves, done.iterations)

    @property
    def yields(self) -> bool:
        """Whether any material of the case has yield limits."""
        return any(material.yields for material in self.case.materials.values())

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain, or None."""
        if not np.all(np.isfinite(p)):
            return "a parameter is not finite"
        values = self.values(p)
        found = inadmissible_numbers(self.case, self.sequence, values)
        for name in () if found else self.sequence.materials:
            fields = self.on_mesh.elastic_fields(name)
            growths = self.on_mesh.elastic_growths(name)
            if fields or growths:
                s = self.discretization.points.n_strain
                material = replace(self.case.materials[name], elastic=self.on_mesh.elastic(name))
                found = found or inadmissible_moduli(material, fields, values, s, growths)
        return found

    def values(self, p: Floats) -> dict[str, float]:
        """Parameter values p (n,) by name."""
        return dict(zip(self.names, map(float, p), strict=True))

    def count_evaluation(self) -> int:
        """One more parameter vector was evaluated: how many so far."""
        self._evaluations += 1
        return self._evaluations

    def at(self, p: Floats, options: RunOptions = WHOLE) -> Run:
        """One march at parameters p (n,); its states come one by one.

        Args:
            p: (n,) parameters.
            options: how to march.
        """
        lent = self._lent
        if lent is not None and lent[0] == p.tobytes() and options.unit_forces is None:
            options = replace(options, known=lent[1], traced=False)
        return Run(self.march, ParameterPoint(self.values(p), self.names), options, self._tell)

    def lend(self, p: Floats, known: KnownMotion) -> None:
        """Displacements at p (n,) are known; marches there need not solve for them.

        Args:
            p: (n,) parameters.
            known: the displacements.
        """
        self._lent = p.tobytes(), known

    def is_lent(self, p: Floats) -> bool:
        """Whether displacements at p (n,) are known."""
        return self._lent is not None and self._lent[0] == p.tobytes()

    @property
    def keeps_march(self) -> bool:
        """Whether the states of a march are kept: nothing yields, and they are not too many."""
        points = self.discretization.points
        each = self.discretization.n_dofs + points.n_strain * points.n_points
        return not self.yields and each * len(self.sequence.states) <= MOST_KEPT

    def paid(self, p: Floats, last: int) -> None:
        """A march at p (n,) up to a state was counted, in this run or in one that this goes on.

        Should its states be computed again for what comes later, they are not counted again.
        """
        key, before = self._paid
        self._paid = p.tobytes(), max(last, before) if key == p.tobytes() else last

    def is_paid(self, p: Floats) -> bool:
        """Whether the last march with derivatives that was counted is that at p (n,)."""
        return self.keeps_march and self._paid[0] == p.tobytes()

    def march_to(
        self,
        p: Floats,
        last: int,
        tell: Callable[[StageEnd, Run], None] | None = None,
    ) -> KeptMarch:
        """The march with derivatives at p (n,), which goes on where it was left, to a state.

        Args:
            p: (n,) parameters, SI.
            last: index of the state.
            tell: is given every state with its run while its factorization is there: the march is
                made anew.

        Raises:
            ModelError: the stiffness of a stage is not positive definite.
        """
        kept = self._kept
        if kept is None or kept.p != tuple(map(float, p)) or tell is not None:
            self._kept = None  # its memory is free for the next
            if self._paid[0] != p.tobytes():
                self.count_evaluation()
                self.paid(p, -1)
            kept = KeptMarch(self.at(p), self._see)
        free = self._paid[1]
        try:
            for to in sorted({min(free, last), last}):
                before = self._spent()
                kept.go_on(to, tell)
                if to <= free:
                    self._set_free(before)
        except BaseException:
            self._kept = None
            raise
        self._kept = kept
        self.paid(p, last)
        return kept

    def forget(self) -> None:
        """Begin the next march as a new model does: of earlier ones only analyses stay."""
        self.march.forget()
        self.face.forget()
        self.last_adjoints = self._kept = self._lent = None
        self._paid = None, -1

    def _set_free(self, before: Counts) -> None:
        """What was done since these counts is not to be counted, but for analyses."""
        self._free += replace(self._spent() - before, analyses=0)

    def _see(self, end: StageEnd, run: Run) -> tuple[Floats, tuple[str, ...]]:
        """What channels see of a state, and which read one of several equal stresses."""
        state = MarchState(end, run.point, self.structures)
        return self.observation.values(state), self.observation.coinciding(state)

    def _tell(self, state: int) -> None:
        if self.on_state is not None:
            self.on_state(state)


def _values(end: StageEnd) -> StageEnd:
    """The values of a state without derivatives, copied."""
    return replace(
        end,
        u=end.u[:, :1].copy(),
        stresses=end.stresses.values(),
        members=end.members[:, :1].copy(),
        yielded=end.yielded.copy(),
        forces=None if end.forces is None else end.forces[:, :1].copy(),
    )

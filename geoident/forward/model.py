"""A case on its mesh, ready to answer: the one class by which others use the forward model."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from geoident.fem.solvers.protocol import Solver
from geoident.forward.actions.forces import Actions
from geoident.forward.checks import CaseOnMesh, check_on_mesh, imbalance_notes, notes_on_mesh
from geoident.forward.gauges.instrument_errors import Instruments
from geoident.forward.ground.elasticity import inadmissible
from geoident.forward.march.discretization import StageSystems
from geoident.forward.march.fields import FieldRecorder
from geoident.forward.march.march import March
from geoident.forward.march.plastic_step import PERFECT, PlasticOptions
from geoident.forward.march.state import Push, Standing
from geoident.forward.protocols import Survey
from geoident.forward.response import StagedResponse
from geoident.forward.structures.forces import MemberRecorder
from geoident.forward.structures.members import Structures
from geoident.forward.structures.members import inadmissible as impossible_structure
from geoident.forward.yielding.checks import no_stress_left
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.mesh import Mesh
from geoident.model.result import Counts


def staged_model(mesh: Mesh, case: Case, *, solver: Solver) -> StagedModel:
    """The staged forward model of a case on a mesh, after all checks.

    Args:
        mesh: its mesh.
        case: the case.
        solver: factorizes the stiffness matrices.

    Raises:
        InputError: everything in the case that does not fit the mesh, at once.
        ModelError: a piece of the ground that no support holds.
    """
    return StagedModel(check_on_mesh(case, mesh), solver=solver)


class StagedModel:
    """The staged forward model of a case (theory 1 and 2); it checks nothing (see `checks`).

    Args:
        on_mesh: the case and the mesh that it fits.
        solver: factorizes the stiffness matrices.
    """

    def __init__(self, on_mesh: CaseOnMesh, *, solver: Solver) -> None:
        case, mesh, timeline = on_mesh.case, on_mesh.mesh, on_mesh.timeline
        table, locator = on_mesh.table, on_mesh.locator
        self.on_mesh = on_mesh
        self.case, self.mesh, self.timeline = case, mesh, timeline
        self.names = tuple(parameter.name for parameter in case.parameters)
        self.observation = on_mesh.observation
        self.instruments = Instruments(case, self.observation.zero, timeline.built_on)
        self._solver = solver
        self._evaluations = 0
        self.on_state: Callable[[int], None] | None = None  # is told of every state computed
        self.structures = Structures(case, mesh, timeline, locator)
        self.systems = StageSystems(case, mesh, timeline, on_mesh.fixed, solver, self.structures)
        self.actions = Actions(case, mesh, table, locator, timeline, self.systems)
        self.march = March(case, mesh, timeline, self.systems, self.actions)

    @property
    def counts(self) -> Counts:
        """Costs so far."""
        spent = self._solver.counts
        return Counts(self._evaluations, spent.analyses, spent.factorizations, spent.solves)

    @property
    def yields(self) -> bool:
        """Whether any material of the case has yield limits."""
        return any(material.yields for material in self.case.materials.values())

    @property
    def solver_name(self) -> str:
        """Name of the sparse solver."""
        return self._solver.name

    @property
    def n_dofs(self) -> tuple[int, ...]:
        """Unknowns of every state, the virgin state first."""
        states = range(len(self.timeline.states))
        return tuple(self.systems[n].pattern.lower.n for n in states)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know of how the case was understood, and of the last run."""
        start = {p.name: p.start for p in self.case.parameters}
        notes = notes_on_mesh(
            self.on_mesh,
            n_outside=max(self.march.n_outside, self.actions.n_outside),
            in_tension=self.march.virgin_tension(start),
        )
        notes += [
            f"at stage '{stage}' {100 * part:.2g} % of the change of load is not balanced: with a "
            "dilation far below the friction the flow tends to shear in bands; a larger dilation "
            "(or none given: associated) has an exact solution"
            for stage, part in self.march.plastic.left.items()
        ]
        return (*notes, *imbalance_notes(self.march.imbalance))

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain, or None."""
        if not np.all(np.isfinite(p)):
            return "a parameter is not finite"
        values = self.values(p)
        used = {m for state in self.timeline.states for m in state.materials.values()}
        for material in (self.case.materials[name] for name in sorted(used)):
            found = inadmissible(material, values) or no_stress_left(self.case, material, values)
            if found is not None:
                return found
        return impossible_structure(self.case, values)

    def values(self, p: Floats) -> dict[str, float]:
        """Parameter values by name."""
        return dict(zip(self.names, map(float, p), strict=True))

    def count_evaluation(self) -> int:
        """One more parameter vector was evaluated: how many so far."""
        self._evaluations += 1
        return self._evaluations

    def unreadable(self, channel: str, stage: str) -> str | None:
        """Why a channel can't be read at a stage, or None if it can."""
        return self.observation.unreadable(channel, self.case.stage_names.index(stage))

    def response(
        self, pairs: Sequence[tuple[str, str]], times: Sequence[float | None] = ()
    ) -> StagedResponse:
        """The response in the readings of some (channel, stage) pairs.

        Args:
            pairs: what was read.
            times: when each was read, seconds since 1970; None for what is known of its stage.
        """
        return StagedResponse(self, pairs, times)

    def run(
        self,
        values: Mapping[str, float],
        *,
        names: Sequence[str] = (),
        last: int | None = None,
        push: Push | None = None,
        plastic: PlasticOptions = PERFECT,
    ) -> Iterator[Standing]:
        """March through the stages (see `March.run`) and tell ``on_state`` of each."""
        march = self.march.run(values, names=names, last=last, push=push, plastic=plastic)
        for standing in march:
            if self.on_state is not None:
                self.on_state(standing.state)
            yield standing

    def survey(self, p: Floats, *, fields: bool, partial: bool = False) -> Survey:
        """All channels at all stages, their derivatives, and the fields if wanted.

        One factorization per stage, more where ground yields.

        Args:
            p: (n,) parameters.
            fields: whether displacements and stresses are wanted.
            partial: where a stage collapses, give what can be known without it.

        Raises:
            CollapseError: a stage collapses; with ``partial``, only if nothing is left.
        """
        self.count_evaluation()
        observed = []
        recorder = FieldRecorder(self.mesh, self.timeline, self.systems) if fields else None
        members = MemberRecorder(self.structures, self.timeline, self.values(p))
        plastic = PlasticOptions(partial=partial)
        for standing in self.run(self.values(p), names=self.names, plastic=plastic):
            observed.append(self.observation.operator @ standing.u)
            if recorder is not None:
                recorder.add(standing)
            if self.structures.parts:
                members.add(standing)
        table = self.relative(np.stack(observed))
        states, rows = np.indices(table.shape[:2]).reshape(2, -1)
        added = self.instruments.added(self.values(p), self.names, rows, states)
        table = (table + added.reshape(table.shape))[1:].swapaxes(0, 1)
        series = None if recorder is None else recorder.series()
        collapses = self.march.collapses
        if collapses and not np.isfinite(table).any():
            raise collapses[0]
        said = tuple(error.message for error in collapses)
        activity = self.march.plastic.activity(self.names) if self.yields else None
        return Survey(table[..., 0], table[..., 1:], series, members.table(), said, activity)

    def relative(self, observed: Floats) -> Floats:
        """Readings from relative displacements since placing: less what was there at zero.

        Args:
            observed: (n_states, n_channels, k).

        Returns:
            (n_states, n_channels, k); NaN where a channel can't be read.
        """
        zero, readable = self.observation.zero, self.observation.readable[: len(observed)]
        rows = np.arange(observed.shape[1])
        reachable = zero < len(observed)
        result = observed - observed[np.where(reachable, zero, 0), rows]
        result[~readable] = np.nan
        return np.asarray(result)

"""A case on its mesh, ready to answer: the one class by which others use the forward model."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from geoident.errors import Fault, InputError, Location, ModelError
from geoident.fem.faces import FaceTable, face_table
from geoident.fem.kinematics import Kinematics, kinematics_of
from geoident.fem.location import Locator
from geoident.fem.mechanism import LooseBody, loose_body
from geoident.fem.orientation import oriented
from geoident.fem.solvers.protocol import Solver
from geoident.forward.actions.forces import Actions
from geoident.forward.actions.supports import burden_faults, fixed_dofs, load_faults, support_faults
from geoident.forward.axisymmetric_checks import revolution_faults
from geoident.forward.gauges.instrument_errors import Instruments
from geoident.forward.gauges.observation import Observation, format_point, observe
from geoident.forward.ground.checks import section_faults
from geoident.forward.ground.elasticity import inadmissible
from geoident.forward.in_situ.stress import edges_held, in_situ_models, surface_faults, zone_faults
from geoident.forward.march.discretization import StageSystems
from geoident.forward.march.fields import FieldRecorder
from geoident.forward.march.march import March
from geoident.forward.march.plastic_step import PERFECT, PlasticOptions
from geoident.forward.march.state import Push, Standing
from geoident.forward.protocols import Survey
from geoident.forward.response import StagedResponse
from geoident.forward.stages import Timeline, build_timeline, group_faults
from geoident.forward.structures.checks import (
    standing_faults,
    structure_faults,
    structure_notes,
)
from geoident.forward.structures.forces import MemberRecorder
from geoident.forward.structures.members import Structures
from geoident.forward.structures.members import inadmissible as impossible_structure
from geoident.forward.yielding.checks import no_stress_left, yield_faults, yield_notes
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Case, KeyPath, Source, format_path
from geoident.model.mesh import Mesh
from geoident.model.parameter import Scalar
from geoident.model.result import Counts


class StagedModel:
    """The staged forward model of a case (theory 1 and 2).

    Args:
        mesh: its mesh.
        case: the case.
        solver: factorizes the stiffness matrices.

    Raises:
        InputError: everything in the case that does not fit the mesh, at once.
        ModelError: a piece of the ground that no support holds.
    """

    def __init__(self, mesh: Mesh, case: Case, *, solver: Solver) -> None:
        self.case = case
        kinematics = kinematics_of(case.analysis)
        self.mesh = mesh = oriented(mesh, kinematics)
        self.names = tuple(parameter.name for parameter in case.parameters)
        table = face_table(mesh)
        _raise_any(_group_faults(case, mesh, table))
        self.timeline = build_timeline(case, mesh)
        locator = Locator(mesh)
        _raise_any(
            [
                *burden_faults(case, mesh, table, locator, self.timeline),
                *zone_faults(case, self.timeline),
                *standing_faults(case, mesh, self.timeline, locator),
            ]
        )
        self.observation, faults = observe(case, mesh, locator, self.timeline)
        _raise_any([*faults, *_reading_faults(case, self.observation, faults)])
        self.instruments = Instruments(case, self.observation.zero, self.timeline.built_on)
        self._fixed = fixed = fixed_dofs(case, mesh)
        _refuse_mechanisms(case.source, mesh, table, kinematics, self.timeline, fixed)
        self._solver = solver
        self._evaluations = 0
        self.on_state: Callable[[int], None] | None = None  # is told of every state computed
        self.structures = Structures(case, mesh, self.timeline, locator)
        self.systems = StageSystems(case, mesh, self.timeline, fixed, solver, self.structures)
        self.actions = Actions(case, mesh, table, locator, self.timeline, self.systems)
        self.march = March(case, mesh, self.timeline, self.systems, self.actions)

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

    def _odd_notes(self) -> list[str]:
        """What is allowed, and seldom meant."""
        notes = []
        used = {m for state in self.timeline.states for m in state.materials.values()}
        densities = [self.case.materials[m].density for m in used]
        if self.case.gravity is not None and all(d == Scalar(0.0) for d in densities):
            notes.append("there is gravity, but no material has a density: nothing weighs")
        values = {p.name: p.start for p in self.case.parameters}
        if self.march.virgin_tension(values):
            notes.append(
                "at the start values the virgin ground is in tension: stresses are positive in "
                "tension, the vertical stress of Heim's model is positive in compression"
            )
        return notes

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know of how the case was understood."""
        notes = []
        on_axis = np.count_nonzero(self.systems.kinematics.on_axis(self.mesh.points))
        if on_axis:
            notes.append(
                f"{on_axis} nodes on the axis of revolution x = 0 are held radially (u_r = 0)"
            )
        if any(edges_held(model) for _, model in in_situ_models(self.case)):
            notes.append(
                "the in-situ stress is held at the edges of the model by tractions "
                "(in_situ: held: true)"
            )
        if self.observation.snapped:
            notes.append(
                "points just outside the mesh, taken by the nearest element: "
                + ", ".join(self.observation.snapped)
            )
        beside = max(self.march.n_outside, self.actions.n_outside)
        if beside:
            notes.append(
                f"{beside} strain points lie beside the faces that give the level of the ground or "
                "of the water; the level of the nearest node of these faces was taken"
            )
        if any(state.water is not None for state in self.timeline.states):
            notes.append("there is water in the pores: all stresses are effective stresses")
        notes += self._odd_notes()
        notes += yield_notes(self.case)
        notes += structure_notes(self.case, self.mesh, self.timeline, self._fixed)
        notes += [
            f"at stage '{stage}' {100 * part:.2g} % of the change of load is not balanced: with a "
            "dilation far below the friction the flow tends to shear in bands; a larger dilation "
            "(or none given: associated) has an exact solution"
            for stage, part in self.march.plastic.left.items()
        ]
        if self.march.imbalance > 1e-9:
            notes.append(
                f"the in-situ stress is out of balance by {100 * self.march.imbalance:.3g} % of "
                "the largest nodal force; one equilibrium step was made, its motion is not counted"
            )
        return tuple(notes)

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


def _group_faults(case: Case, mesh: Mesh, table: FaceTable) -> list[Fault]:
    return [
        *revolution_faults(case, mesh),
        *section_faults(case),
        *yield_faults(case),
        *group_faults(case, mesh),
        *support_faults(case, mesh),
        *load_faults(case, mesh, table),
        *surface_faults(case, mesh),
        *structure_faults(case, mesh),
    ]


def _reading_faults(case: Case, observation: Observation, gauge_faults: list[Fault]) -> list[Fault]:
    """Readings that were taken when the gauge could not be read."""
    if gauge_faults:
        return []
    names = case.stage_names
    faults = []
    for reading in case.readings:
        reason = observation.unreadable(reading.channel, names.index(reading.stage))
        if reading.value is not None and reason and not reading.bad:
            faults.append(
                Fault(
                    "unreadable-gauge",
                    f"gauge '{reading.channel}' can't have been read at stage "
                    f"'{reading.stage}': {reason}",
                    "leave the value blank, or correct the stage, the gauge's 'zero' or its points",
                    reading.location,
                )
            )
    return faults


def _refuse_mechanisms(
    source: Source,
    mesh: Mesh,
    table: FaceTable,
    kinematics: Kinematics,
    timeline: Timeline,
    fixed: Bools,
) -> None:
    checked = set()
    for n, state in enumerate(timeline.states):
        present = timeline.present(n)
        if present.tobytes() in checked:
            continue
        checked.add(present.tobytes())
        if not present.any():
            msg = f"at stage '{state.name}' no ground is present"
            raise InputError([Fault("no-ground", msg, "see 'groups'", Location(mesh.file))])
        loose = loose_body(mesh, table, kinematics, present, fixed)
        if loose is None:
            continue
        place: KeyPath = ("stages", n - 1) if n else ("supports",)
        hint = (
            "See whether what this stage takes away cuts the piece loose, or hold it by 'supports'."
            if n
            else "Hold it by 'supports': groups on its edge, with the axes that they hold."
        )
        msg = f"at stage '{state.name}' {_loose_text(loose, timeline)}"
        raise ModelError(msg, hint, location=source.locate(place), path=format_path(place))


def _loose_text(loose: LooseBody, timeline: Timeline) -> str:
    """What moves, where, and how."""
    names = sorted({timeline.groups[g] for g in timeline.group_of[loose.elements]})
    axes = " and ".join(a for a, x in zip("xyz", loose.motion, strict=False) if x)
    motion = f"move along {axes}" if axes else "turn"
    count = len(loose.elements)
    return (
        f"{count} element{'s' * (count > 1)} of {', '.join(map(repr, names))} near"
        f" {format_point(loose.centre)} can {motion} freely: nothing holds the piece"
    )


def _raise_any(faults: list[Fault]) -> None:
    if faults:
        raise InputError(faults)

"""The response of a staged model: chosen readings as a function of the parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from geoident.forward.affine import condensation_obstacle
from geoident.forward.equations import ReadingRows, export, export_obstacle
from geoident.forward.gauges.adjoints import AdjointTable, ReadingAdjoints
from geoident.forward.gauges.instrument_errors import ReadingPlaces
from geoident.forward.gauges.observable import MarchState
from geoident.forward.march.march import Run, RunOptions
from geoident.forward.march.plastic_step import WarmStart
from geoident.forward.march.stage import StageEnd, UnitForces
from geoident.forward.marches import Marches
from geoident.forward.model_response import ModelResponse
from geoident.forward.openings.model import OpeningResponse, opening_in_mesh
from geoident.forward.openings.site import Circle
from geoident.forward.reduced.reduction import Reduction
from geoident.forward.staged_system import StagedSystem, bilinear
from geoident.model.arrays import Floats
from geoident.model.dual import ParameterPoint
from geoident.model.response import BilinearSystem, Condensed
from geoident.model.yielding import Activity

Tell = Callable[[StageEnd, Run], None]
"""Is given a state with its run."""

_DEPENDENT = 1e-10
"""Singular value of S, relative to the largest, below which readings count as dependent."""


class StagedResponse(ModelResponse):
    """Readings of some (channel, stage) pairs as a function of the parameters.

    Fulfils the protocols ``Response``, ``AffineElastic`` and ``ComplementaritySystem`` of the
    identifiers. The march ends with the last stage that a reading needs.

    Args:
        marches: of the case.
        pairs: channel and stage of every reading.
        times: when each was read; None for what is known of its stage.

    Attributes:
        reduction: is given the marches with derivatives, for a reduced model; None for none.
        learns: whether it is given the next one, too.
    """

    def __init__(
        self,
        marches: Marches,
        pairs: Sequence[tuple[str, str]],
        times: Sequence[float | None] = (),
    ) -> None:
        super().__init__(marches)
        self._marches = marches
        self._pairs, self._given_times = tuple(pairs), tuple(times)
        self._start = np.array([parameter.start for parameter in marches.case.parameters])
        self._start_point = ParameterPoint(marches.case.start, marches.names)
        self._activity: tuple[bytes, Activity | None] | None = None  # p and what was found there
        self._increments: tuple[bytes, Floats] | None = None  # likewise
        self._places = ReadingPlaces.of(marches.case, pairs, times)
        self._row, self._state = self._places.rows, self._places.states
        self._last = int(self._state.max(initial=0))
        self.reduction: Reduction | None = None
        self.learns = True

    def readings(self, p: Floats) -> Floats:
        """v(p), (g,), m."""
        return self._run(p)[:, 0]

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its Jacobian, (g, n)."""
        return self.by_adjoints(p) if self.backwards else self.by_tangents(p)

    @property
    def backwards(self) -> bool:
        """Whether derivatives come by adjoints: not while marches are kept."""
        if not self.adjoints.cost_less(len(self.names)):
            return False
        return self.reduction is None or not self.reduction.covers()

    def remembers(self, p: Floats) -> None:
        """The answer at p (n,) with derivatives is known and was counted, from an earlier run."""
        if self._marches.keeps_march and not self.backwards:
            self._marches.paid(p, self._last)

    def forget(self) -> None:
        """Begin the next evaluation as a new model does; what a reduced model is made of stays."""
        self._marches.forget()
        self._activity = self._increments = None

    def starts(self) -> WarmStart:
        """From where evaluations may begin now, without factors."""
        return self._marches.march.warm.without_factors()

    def begin_from(self, starts: object) -> None:
        """Begin the next evaluation from what was known then.

        Args:
            starts: of this model, as they were.
        """
        assert isinstance(starts, WarmStart)
        self._marches.march.warm = starts

    def by_tangents(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its Jacobian, (g, n): one column a parameter through the stages.

        A march that is kept goes as far as the reduced model is to go.
        """
        reduction = self.reduction if self.learns else None
        recorder = None if reduction is None or reduction.knows(p) else reduction.recorder(p)
        if reduction is None or recorder is None:
            table = self._run(p, derivatives=True)
        else:
            table = self._run(p, derivatives=True, last=reduction.last, tell=recorder.add)
            reduction.add(recorder.snapshot)
        return table[:, 0], table[:, 1:]

    def increments(self, p: Floats) -> Floats:
        """What the step of each state changes in what all channels see at p (n,).

        (n_states, n_channels), SI, up to the last stage that a reading needs. Of the last run if
        it was made there.
        """
        if self._increments is None or self._increments[0] != p.tobytes():
            self.readings(p)
        assert self._increments is not None
        return self._increments[1]

    def by_adjoints(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its Jacobian, (g, n): one column a reading back through the stages.

        Raises:
            ValueError: ground yields, or a reading is not linear in the state.
        """
        marches = self._marches
        marches.count_evaluation()
        run = marches.at(p, RunOptions(last=self._last, traced=True))
        observed = [(end, self.adjoints.observed(end, run)) for end in run.states()]
        seen = np.stack([of_end for _, of_end in observed])
        change = marches.observation.increments(seen[:, :, 0], marches.sequence.bases)
        self._increments = p.tobytes(), change
        table = self.adjoints.table(run, observed[-1][0], seen)
        values = run.given.values
        marches.last_adjoints = AdjointTable(values, self._row, self._state, table.copy())
        self._activity = p.tobytes(), run.findings.plastic.planes.activity()
        table += marches.instrument_errors.added(marches.values(p), self.names, self._places)
        return table[:, 0], table[:, 1:]

    @cached_property
    def adjoints(self) -> ReadingAdjoints:
        """The way back from these readings."""
        marches = self._marches
        return ReadingAdjoints(
            marches.march, marches.observation, self._row, self._state, self._last
        )

    def yields(self) -> bool:
        """Whether any material of the case has yield limits."""
        return self._marches.yields

    def activity(self, p: Floats) -> Activity:
        """The yield planes at p (n,), of the last run if it was made there.

        Raises:
            ValueError: nothing can yield.
        """
        if self._activity is None or self._activity[0] != p.tobytes():
            self.readings(p)
        found = None if self._activity is None else self._activity[1]
        if found is None:
            raise ValueError("no material of the case yields")
        return found

    def system_obstacle(self) -> str | None:
        """Why the equations are no `BilinearSystem`, a clause, or None if they are one."""
        marches = self._marches
        not_linear = marches.observation.not_linear(self._row)
        return not_linear or export_obstacle(marches.march, self._start_point)

    def system(self) -> BilinearSystem:
        """The equations of all stages as one system of vectors."""
        return bilinear(self.staged_system(), self._start)

    def staged_system(self) -> StagedSystem:
        """The equations stage by stage, as arrays."""
        marches, start = self._marches, self._start_point
        added = marches.instrument_errors.added(start.values, self.names, self._places)
        operator = marches.observation.operator(self._row)
        rows = ReadingRows(operator, self._active(), added)
        return export(marches.march, start, rows, self._last)

    def opening(
        self, centre: tuple[float, float] | None, radius: float | None
    ) -> OpeningResponse | str:
        """The closed form of these readings, or why there is none."""
        marches = self._marches
        found = opening_in_mesh(marches.on_mesh, Circle(centre, radius))
        return found if isinstance(found, str) else found.response(self._pairs, self._given_times)

    def obstacle(self) -> str | None:
        """Why the equations are not affine in the parameters, or None if they are."""
        marches = self._marches
        return marches.observation.not_linear(self._row) or condensation_obstacle(marches.march)

    def condense(self, p: Floats, measured: Floats, sd: Floats) -> Condensed:
        """The condensed equations at p (theory 4.1), for the whole sequence of stages at once.

        Let K be the operator of all stages together, block lower triangular, and G the one that
        adds displacement increments up to readings. One march with the columns G^T gives
        S = G K^-1 G^T; forces c with S c = measured - v, in least squares where readings depend on
        each other, bring the displacements to the readings. The equation error of parameters q
        there, carried to the gauges, is G K^-1 e(q) = (measured - v) - J (q - p), with J the
        Jacobian of a march under those forces: exact, since e is affine in q. Two factorizations a
        stage.

        Args:
            p: (n,) parameters.
            measured: (g,) readings, m.
            sd: (g,) their standard deviations, SI; where readings share errors, the matrix (g, g)
                that makes their errors independent and of size one.
        """
        unit = self._unit_forces()
        table = self._run(p, unit)
        gap, flexibility = measured - table[:, 0], table[:, 1:]
        if sd.ndim == 1:
            weighted, aim = flexibility / sd[:, None], gap / sd
        else:
            weighted, aim = sd @ flexibility, sd @ gap
        multipliers = np.asarray(np.linalg.lstsq(weighted, aim, rcond=_DEPENDENT)[0])
        corrected = replace(unit, multipliers=multipliers)
        jacobian = self._run(p, corrected, derivatives=True)[:, 1:]
        return Condensed(table[:, 0], flexibility, -jacobian, -jacobian @ p - gap)

    def _run(
        self,
        p: Floats,
        unit_forces: UnitForces | None = None,
        *,
        derivatives: bool = False,
        last: int = 0,
        tell: Tell | None = None,
    ) -> Floats:
        """Readings (g, 1 + n + k).

        Args:
            p: (n,) parameters, SI.
            unit_forces: forces along the readings.
            derivatives: carry the derivatives by all parameters.
            last: index of a later state to which it is to go.
            tell: is given every state with its run, while it is there.
        """
        marches = self._marches
        plain, goes_on = unit_forces is None, max(last, self._last)
        if plain and (marches.keeps_march if derivatives else marches.is_paid(p)):
            kept = marches.march_to(p, goes_on, tell).observed[: self._last + 1]
            observed = np.stack(kept)[..., : None if derivatives else 1]
            self._activity = p.tobytes(), None
        else:
            observed = self._march(p, unit_forces, derivatives=derivatives, tell=tell)
        change = marches.observation.increments(observed[:, :, 0], marches.sequence.bases)
        self._increments = p.tobytes(), change
        table = marches.observation.readings(observed, self._row, self._state)
        names = self.names if derivatives else ()
        added = marches.instrument_errors.added(marches.values(p), names, self._places)
        table[:, : added.shape[1]] += added
        return np.asarray(table)

    def _march(
        self,
        p: Floats,
        unit_forces: UnitForces | None,
        *,
        derivatives: bool,
        tell: Tell | None,
    ) -> Floats:
        """What channels see, (m, n_channels, 1 + n + k), of a march that is not kept."""
        marches = self._marches
        marches.count_evaluation()
        # Where the loads collapse at the start, the user wants to know how much of them is carried;
        # who searches elsewhere, only that they are not.
        explain = bool(np.array_equal(p, self._start))
        run = marches.at(
            p, RunOptions(derivatives, self._last, unit_forces=unit_forces, explain=explain)
        )
        seen = []
        for end in run.states():
            seen.append(marches.observation.values(MarchState(end, run.point, marches.structures)))
            if tell is not None:
                tell(end, run)
        self._activity = p.tobytes(), run.findings.plastic.planes.activity()
        return np.stack(seen)

    def _unit_forces(self) -> UnitForces:
        """Unit forces along every reading: G^T.

        A reading adds up the increments of all stages that led to its own, less those that led to
        its zero. Where its stage builds on its zero, its unit force is a dead load that acts from
        the stage after the zero on.
        """
        rows = self._marches.observation.operator(self._row)
        return UnitForces(rows.toarray().T, self._active())

    def _active(self) -> Floats:
        """(n_states, g) weight of the step of a state in a reading: 1, 0 or -1."""
        built_on = self._marches.sequence.built_on
        return self._marches.observation.steps(built_on, self._row, self._state)

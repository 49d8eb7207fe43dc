"""The response of a staged model: what identifiers may ask beside readings and their Jacobian.

Condensation pushes the ground with unit forces along the readings; the formulations that solve all
stages at once take its equations; closed-form takes the opening that it may be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geoident.forward.affine import condensation_obstacle
from geoident.forward.analysis.analysis import RunOptions
from geoident.forward.analysis.stage import UnitForces
from geoident.forward.equation_arrays import EquationArrays, bilinear
from geoident.forward.equations import ReadingRows, export, export_obstacle
from geoident.forward.gauges.adjoints import ReadingAdjoints
from geoident.forward.gauges.instrument_errors import ReadingPlaces
from geoident.forward.observed import ObservedResponse, Query
from geoident.forward.openings.model import OpeningResponse, opening_in_mesh
from geoident.forward.staged import StagedKernel
from geoident.model.arrays import Floats
from geoident.model.dual import ParameterPoint
from geoident.model.response import BilinearSystem, Condensed
from geoident.model.yielding import Activity

_DEPENDENT = 1e-10
"""Singular value of S, relative to the largest, below which readings count as dependent."""


class StagedResponse(ObservedResponse[StagedKernel]):
    """Readings of some (channel, stage) pairs as a function of the parameters.

    Fulfils the protocols ``Response``, ``AffineElastic`` and ``ComplementaritySystem`` of the
    identifiers. The analysis ends with the last stage that a reading needs.

    Args:
        model: of the case.
        pairs: channel and stage of every reading.
        times: when each was read; None for what is known of its stage.
    """

    def __init__(
        self,
        model: StagedKernel,
        pairs: Sequence[tuple[str, str]],
        times: Sequence[float | None] = (),
    ) -> None:
        super().__init__(model, ReadingPlaces.of(model.case, pairs, times))
        self._pairs, self._given_times = tuple(pairs), tuple(times)
        self._start = np.array([parameter.start for parameter in model.case.parameters])
        self._start_point = ParameterPoint(model.case.start, model.names)

    def by_tangents(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its Jacobian, (g, n): one column a parameter through the stages."""
        return self._by(p, adjoints=False)

    def by_adjoints(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its Jacobian, (g, n): one column a reading back through the stages.

        Raises:
            ValueError: ground yields, or a reading is not linear in the state.
        """
        return self._by(p, adjoints=True)

    def _by(self, p: Floats, *, adjoints: bool) -> tuple[Floats, Floats]:
        places = self._places
        observed = self._model.observe(p, Query(places, self._last), adjoints=adjoints)
        table = self._model.readings_of(p, observed, places, derivatives=True)
        return table[:, 0], table[:, 1:]

    @property
    def adjoints(self) -> ReadingAdjoints:
        """The way back from these readings."""
        return self._model.way_back(self._places, self._last)

    def yields(self) -> bool:
        """Whether any material of the case has yield limits."""
        return self._model.case.yields

    def activity(self, p: Floats) -> Activity:
        """The yield planes at p (n,).

        Raises:
            ValueError: nothing can yield.
        """
        activity = self.evaluation(p, derivatives=False).activity
        if activity is None:
            raise ValueError("no material of the case yields")
        return activity

    def system_obstacle(self) -> str | None:
        """Why the equations are no `BilinearSystem`, a clause, or None if they are one."""
        model = self._model
        rows = self._places.rows
        not_linear = model.gauges.not_linear(rows) or model.instrument_errors.not_added(rows)
        return not_linear or export_obstacle(model.analysis, self._start_point)

    def system(self) -> BilinearSystem:
        """The equations of all stages as one system of vectors."""
        return bilinear(self.equation_arrays(), self._start)

    def equation_arrays(self) -> EquationArrays:
        """The equations stage by stage, as arrays."""
        model, start = self._model, self._start_point
        added = model.instrument_errors.added(start.values, self.names, self._places)
        operator = model.gauges.operator(self._places.rows)
        rows = ReadingRows(operator, self._active(), added)
        return export(model.analysis, start, rows, self._last)

    def opening(
        self, centre: tuple[float, float] | None, radius: float | None
    ) -> OpeningResponse | str:
        """The closed form of these readings, or why there is none."""
        model = self._model
        opening = opening_in_mesh(model.on_mesh, centre, radius)
        return (
            opening
            if isinstance(opening, str)
            else opening.response(self._pairs, self._given_times)
        )

    def obstacle(self) -> str | None:
        """Why the equations are not affine in the parameters, or None if they are."""
        model = self._model
        rows = self._places.rows
        not_linear = model.gauges.not_linear(rows) or model.instrument_errors.not_added(rows)
        return not_linear or condensation_obstacle(model.analysis)

    def condense(self, p: Floats, measured: Floats, sd: Floats) -> Condensed:
        """The condensed equations at p (theory 4.1), for the whole sequence of stages at once.

        Let K be the operator of all stages together, block lower triangular, and G the one that
        adds displacement increments up to readings. One analysis with the columns G^T gives
        S = G K^-1 G^T; forces c with S c = measured - v, in least squares where readings depend on
        each other, bring the displacements to the readings. The equation error of parameters q
        there, carried to the gauges, is G K^-1 e(q) = (measured - v) - J (q - p), with J the
        Jacobian of a run under those forces: exact, since e is affine in q. Two factorizations a
        stage.

        Args:
            p: (n,) parameters.
            measured: (g,) readings, SI.
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

    def _run(self, p: Floats, unit_forces: UnitForces, *, derivatives: bool = False) -> Floats:
        """Readings under unit forces along them, (g, 1 + n + k).

        Args:
            p: (n,) parameters, SI.
            unit_forces: the forces.
            derivatives: carry the derivatives by all parameters.
        """
        model = self._model
        model.evaluations += 1
        run = model.at(p, RunOptions(derivatives, self._last, unit_forces=unit_forces))
        observed = np.stack([model.see(end, run) for end in run.states()])
        table = model.rule.readings(observed, self._places.rows, self._places.states)
        names = self.names if derivatives else ()
        added = model.instrument_errors.added(model.values(p), names, self._places)
        table[:, : added.shape[1]] += added
        return np.asarray(table)

    def _unit_forces(self) -> UnitForces:
        """Unit forces along every reading: G^T.

        A reading adds up the increments of all stages that led to its own, less those that led to
        its zero. Where its stage builds on its zero, its unit force is a dead load that acts from
        the stage after the zero on.
        """
        rows = self._model.gauges.operator(self._places.rows)
        return UnitForces(rows.toarray().T, self._active())

    def _active(self) -> Floats:
        """(n_states, g) weight of the step of a state in a reading: 1, 0 or -1."""
        built_on = self._model.sequence.built_on
        return self._model.gauges.steps(built_on, self._places.rows, self._places.states)

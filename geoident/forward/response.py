"""The staged model as the identifiers see it: parameters in, readings and derivatives out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from geoident.forward.actions import forces as actions
from geoident.forward.actions import release, thermal, water
from geoident.forward.equations import ReadingRows, export, export_obstacle
from geoident.forward.ground import elasticity as materials
from geoident.forward.in_situ import stress as in_situ
from geoident.forward.march.plastic_step import PlasticOptions
from geoident.forward.march.state import Push
from geoident.forward.openings.model import OpeningResponse, opening_in_mesh
from geoident.forward.openings.site import Circle
from geoident.forward.staged_system import StagedSystem, bilinear
from geoident.forward.structures import members as structures
from geoident.model.arrays import Floats
from geoident.model.certificate import Activity
from geoident.model.equations import BilinearSystem, Condensed
from geoident.model.result import Counts

_DEPENDENT = 1e-10
"""Singular value of S, relative to the largest, below which readings count as dependent."""

if TYPE_CHECKING:
    from geoident.forward.model import StagedModel


class StagedResponse:
    """Readings of some (channel, stage) pairs as a function of the parameters.

    Fulfils the protocols ``Response``, ``AffineElastic`` and ``ComplementaritySystem`` of the
    identifiers. The march ends with the last stage that a reading needs.

    Args:
        model: the staged model.
        pairs: channel and stage of every reading.
        times: when each was read; None for what is known of its stage.
    """

    def __init__(
        self,
        model: StagedModel,
        pairs: Sequence[tuple[str, str]],
        times: Sequence[float | None] = (),
    ) -> None:
        observation = model.observation
        self._model = model
        self._pairs, self._given_times = tuple(pairs), tuple(times)
        self._evaluated: tuple[int, bytes] | None = None
        stages = model.case.stage_names
        self._row = np.array([observation.channels.index(c) for c, _ in pairs], dtype=np.int64)
        self._state = np.array([stages.index(s) for _, s in pairs], dtype=np.int64)
        given = [np.nan if time is None else time for time in times or [None] * len(pairs)]
        self._times = np.array(given, dtype=np.float64)
        self._last = int(self._state.max(initial=0))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return self._model.names

    @property
    def counts(self) -> Counts:
        """Costs so far."""
        return self._model.counts

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain, or None."""
        return self._model.admissible(p)

    def readings(self, p: Floats) -> Floats:
        """v(p), (g,), m."""
        return self._run(p)[:, 0]

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its Jacobian, (g, n)."""
        table = self._run(p, names=self.names)
        return table[:, 0], table[:, 1:]

    def yields(self) -> bool:
        """Whether any material of the case has yield limits."""
        return self._model.yields

    def activity(self, p: Floats) -> Activity:
        """The yield planes at p (n,), of the last run if it was made here."""
        if self._evaluated != (self._model.counts.evaluations, p.tobytes()):
            self.readings(p)
        return self._model.march.plastic.activity(self.names)

    def system_obstacle(self) -> str | None:
        """Why the equations are no `BilinearSystem`, a clause, or None if they are one."""
        return export_obstacle(self._model, self._start())

    def system(self) -> BilinearSystem:
        """The equations of all stages as one system of vectors."""
        return bilinear(self.staged_system(), self._start())

    def staged_system(self) -> StagedSystem:
        """The equations stage by stage, as arrays."""
        model, start = self._model, self._start()
        values = model.values(start)
        added = model.instruments.added(values, self.names, self._row, self._state, self._times)
        operator = sp.csr_array(model.observation.operator)[self._row]
        return export(model, start, ReadingRows(operator, self._active(), added), self._last)

    def _start(self) -> Floats:
        return np.array([parameter.start for parameter in self._model.case.parameters])

    def opening(
        self, centre: tuple[float, float] | None, radius: float | None
    ) -> OpeningResponse | str:
        """The closed form of these readings, or why there is none."""
        model = self._model
        found = opening_in_mesh(model.case, model.mesh, model.timeline, Circle(centre, radius))
        return found if isinstance(found, str) else found.response(self._pairs, self._given_times)

    def obstacle(self) -> str | None:
        """Why the equations are not affine in the parameters, or None if they are."""
        case = self._model.case
        free = frozenset(self.names)
        reasons = [materials.affine_obstacle(m, free) for m in case.materials.values()]
        reasons += [
            part.affine_obstacle(case, free)
            for part in (in_situ, actions, water, thermal, release, structures)
        ]
        return next((reason for reason in reasons if reason), None)

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
            sd: (g,) their standard deviations, m.
        """
        unit = self._push()
        table = self._run(p, push=unit)
        gap, flexibility = measured - table[:, 0], table[:, 1:]
        weighted = flexibility / sd[:, None]
        multipliers = np.asarray(np.linalg.lstsq(weighted, gap / sd, rcond=_DEPENDENT)[0])
        corrected = replace(unit, multipliers=multipliers)
        jacobian = self._run(p, names=self.names, push=corrected)[:, 1:]
        return Condensed(table[:, 0], flexibility, -jacobian, -jacobian @ p - gap)

    def _run(self, p: Floats, *, names: Sequence[str] = (), push: Push | None = None) -> Floats:
        """Readings (g, 1 + n + k)."""
        number = self._model.count_evaluation()
        operator = self._model.observation.operator
        values = self._model.values(p)
        # Where the very first loads collapse, the user wants to know by how much; an identifier
        # only that they do.
        plastic = PlasticOptions(explain=number == 1)
        march = self._model.run(values, names=names, last=self._last, push=push, plastic=plastic)
        observed = np.stack([operator @ standing.u for standing in march])
        self._evaluated = number, p.tobytes()
        table = self._pick(observed)
        added = self._model.instruments.added(values, names, self._row, self._state, self._times)
        table[:, : added.shape[1]] += added
        return table

    def _pick(self, observed: Floats) -> Floats:
        zero = self._model.observation.zero[self._row]
        return np.asarray(observed[self._state, self._row] - observed[zero, self._row])

    def _push(self) -> Push:
        """Unit forces along every reading: G^T.

        A reading adds up the increments of all stages that led to its own, less those that led to
        its zero. Where its stage builds on its zero, its unit force is a dead load that acts from
        the stage after the zero on.
        """
        rows = self._model.observation.operator[self._row]
        return Push(rows.toarray().T, self._active())

    def _active(self) -> Floats:
        """(n_states, g) weight of the step of a state in a reading: 1, 0 or -1."""
        built_on = self._model.timeline.built_on.astype(np.float64)
        zero = self._model.observation.zero[self._row]
        return np.asarray(built_on[:, self._state] - built_on[:, zero])

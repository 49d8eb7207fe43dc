"""A case that is answered by a kept reduced model, and by its mesh where that is not close enough.

One more `CaseModel`: what predictions and simulated readings ask of a case. The mesh is read only
when it is needed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from geoident.forward.gauges.instrument_errors import InstrumentErrors
from geoident.forward.protocols import CaseModel, Survey
from geoident.forward.reduced.kept import RestoredModel
from geoident.forward.stages import ConstructionSequence
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.response import Response
from geoident.model.results.costs import Counts


class ReducedCaseModel:
    """A case with a kept reduced model.

    Args:
        restored: the reduced model.
        limit: (n_channels, n_stages) by how much a reading may be off, SI.
        build: makes the model on the mesh.

    Attributes:
        by_reduced: parameter vectors that the reduced model answered.
        by_model: those that the model on the mesh did.
    """

    def __init__(
        self, restored: RestoredModel, limit: Floats, build: Callable[[], CaseModel]
    ) -> None:
        self._restored, self._limit, self._build = restored, limit, build
        self._on_state: Callable[[int], None] | None = None
        self._built = False
        self.by_reduced = self.by_model = 0
        self.worst = 0.0

    @cached_property
    def whole(self) -> CaseModel:
        """The model on the mesh."""
        model = self._build()
        model.on_state, self._built = self._on_state, True
        return model

    @property
    def on_state(self) -> Callable[[int], None] | None:
        """Is told of every state that is computed."""
        return self._on_state

    @on_state.setter
    def on_state(self, tell: Callable[[int], None] | None) -> None:
        self._on_state = tell
        if self._built:
            self.whole.on_state = tell

    @property
    def case(self) -> Case:
        """The case."""
        return self._restored.case

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the n parameters."""
        return self._restored.names

    @property
    def sequence(self) -> ConstructionSequence:
        """The states of construction: of the mesh."""
        return self.whole.sequence

    @property
    def n_dofs(self) -> tuple[int, ...]:
        """Unknowns of every state: of the mesh."""
        return self.whole.n_dofs

    @property
    def instrument_errors(self) -> InstrumentErrors:
        """What the gauges add by themselves."""
        return self._restored.instrument_errors

    @property
    def counts(self) -> Counts:
        """Costs so far: the reduced model factorizes nothing."""
        spent = self.whole.counts if self._built else Counts(0, 0, 0, 0)
        return spent + Counts(self.by_reduced, 0, 0, 0)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know of how the case was understood: as far as the mesh was read."""
        return self.whole.notes if self._built else ()

    def values(self, p: Floats) -> dict[str, float]:
        """Parameter values p (n,) by name."""
        return dict(zip(self.names, map(float, p), strict=True))

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain, or None."""
        return None if self._restored.admissible(p) is None else self.whole.admissible(p)

    def unreadable(self, channel: str, stage: str) -> str | None:
        """Why a channel can't be read at a stage, or None if it can."""
        state = self.case.stage_names.index(stage)
        observation = self._restored.observation
        if observation.unreadable(channel, state) is None:
            return None
        return self.whole.unreadable(channel, stage)

    def steps(self, pairs: Sequence[tuple[str, str]]) -> Floats:
        """How often the step of each state counts in some readings, (n_states, g): 1, 0 or -1."""
        kept = self._restored.kept
        names = self.case.stage_names
        rows = np.array([kept.channels.index(c) for c, _ in pairs], dtype=np.int64)
        states = np.array([names.index(s) for _, s in pairs], dtype=np.int64)
        return self._restored.observation.steps(kept.built_on, rows, states)

    def response(
        self, pairs: Sequence[tuple[str, str]], times: Sequence[float | None] = ()
    ) -> Response:
        """The response in the readings of some (channel, stage) pairs: of the mesh, if any."""
        return self.whole.response(pairs, times) if pairs else self._restored.response(())

    def survey(
        self, p: Floats, *, fields: bool, partial: bool = False, last: int | None = None
    ) -> Survey:
        """All channels at all stages, their derivatives; fields only where the mesh is asked."""
        found = self._survey(p)
        if found is not None:
            self.by_reduced += 1
            return found
        self.by_model += 1
        return self.whole.survey(p, fields=fields, partial=partial, last=last)

    def _survey(self, p: Floats) -> Survey | None:
        """What the reduced model says; None where that is not close enough."""
        restored, kept = self._restored, self._restored.kept
        wanted = self._limit.copy()
        wanted[~kept.readable[1:].T] = np.nan
        place = kept.rows, kept.states - 1
        known = np.zeros(wanted.shape, dtype=bool)
        known[place] = True
        if restored.admissible(p) is not None or np.any(np.isfinite(wanted) & ~known):
            return None
        response = restored.response(restored.pairs)
        try:
            v, error = response.estimated(p[None])
            at, J = response.evaluate(p)
            increments = response.increments(p)
        except (ValueError, np.linalg.LinAlgError):
            return None
        limit = wanted[place]
        close = np.isnan(limit) | (error[0] <= limit)
        if not (np.all(close) and np.isfinite(v).all()):
            return None
        parts = np.where(np.isnan(limit), 0.0, error[0] / limit)
        self.worst = max(self.worst, float(parts.max(initial=0.0)))
        shape = kept.readable[1:].T.shape
        computed, slopes = np.full(shape, np.nan), np.full((*shape, len(p)), np.nan)
        computed[place], slopes[place] = at, J
        return Survey(computed, slopes, None, increments=increments)

"""A case that is answered by a kept reduced model, and by its mesh where that is not close enough.

What predictions and simulated readings ask of a case. The mesh is read only when it is needed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from geoident.forward.observed import Observed, ObservedModel, ObservedResponse, Query
from geoident.forward.reduced.kept import RestoredModel
from geoident.model.arrays import Floats
from geoident.model.results.costs import Counts


class ReducedCaseModel(ObservedModel):
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
        self, restored: RestoredModel, limit: Floats, build: Callable[[], ObservedModel]
    ) -> None:
        self._restored, self._limit, self._build = restored, limit, build
        self._built = False
        kept = restored.kept
        super().__init__(restored.case, restored.rule, kept.built_on, restored.bases)
        self.by_reduced = self.by_model = 0
        self.worst = 0.0

    @cached_property
    def whole(self) -> ObservedModel:
        """The model on the mesh."""
        model = self._build()
        model.on_state, self._built = self._tell, True
        return model

    def _tell(self, state: int) -> None:
        if self.on_state is not None:
            self.on_state(state)

    @property
    def n_dofs(self) -> tuple[int, ...]:
        """Unknowns of every state: of the mesh."""
        return self.whole.n_dofs

    @property
    def counts(self) -> Counts:
        """Costs so far: the reduced model factorizes nothing."""
        spent = self.whole.counts if self._built else Counts(0, 0, 0, 0)
        return spent + Counts(self.by_reduced, 0, 0, 0)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know of how the case was understood: as far as the mesh was read."""
        return self.whole.notes if self._built else ()

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain, or None."""
        return None if self._restored.admissible(p) is None else self.whole.admissible(p)

    def why_unseen(self, state: int, row: int) -> str:
        """Why a channel cannot be read at a state at which it can't, a clause: as the mesh says."""
        return self.whole.why_unseen(state, row)

    def response(
        self, pairs: Sequence[tuple[str, str]], times: Sequence[float | None] = ()
    ) -> ObservedResponse[Any]:
        """The response in the readings of some (channel, stage) pairs: of the mesh, if any."""
        return self.whole.response(pairs, times) if pairs else super().response(())

    def observe(self, p: Floats, query: Query) -> Observed:
        """What channels see at p (n,): by the reduced model if all readings are close enough."""
        seen = self._seen(p)
        if seen is None:
            self.by_model += 1
            return self.whole.observe(p, query)
        self.by_reduced += 1
        return Observed(seen)

    def _seen(self, p: Floats) -> Floats | None:
        """What the reduced model says (n_states, n_channels, 1 + n); None if that is not close."""
        restored, kept = self._restored, self._restored.kept
        wanted = self._limit.copy()
        wanted[~kept.readable[1:].T] = np.nan
        place = kept.rows, kept.states - 1
        known = np.zeros(wanted.shape, dtype=bool)
        known[place] = True
        if restored.admissible(p) is not None or np.any(np.isfinite(wanted) & ~known):
            return None
        try:
            v, error = restored.response(restored.pairs).estimated(p[None])
            states = restored.model.observed(restored.model.states(p[None]))[:, :, 0]
        except (ValueError, np.linalg.LinAlgError):
            return None
        limit = wanted[place]
        close = np.isnan(limit) | (error[0] <= limit)
        if not (np.all(close) and np.isfinite(v).all()):
            return None
        parts = np.where(np.isnan(limit), 0.0, error[0] / limit)
        self.worst = max(self.worst, float(parts.max(initial=0.0)))
        seen = np.full((*kept.readable.shape, 1 + len(p)), np.nan)
        rows = np.unique(kept.rows)
        seen[: len(states), rows] = states[:, rows]
        return seen

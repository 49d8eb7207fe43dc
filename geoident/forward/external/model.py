"""A case whose readings a program, a function, a table of runs or a convergence law gives.

Its stages have only a name. A reading of channel a at stage j is what the model gives there, less
what it gives at the zero of the channel where that reads a change; of the virgin state that is 0.
Offsets and drifts of gauges are added with their exact derivatives.
"""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from geoident.forward.gauges.zeros import ReadingRule
from geoident.forward.observed import Observed, ObservedModel, Query
from geoident.forward.stages import ConstructionSequence, ConstructionState
from geoident.model.arrays import Bools, Floats
from geoident.model.case import Case
from geoident.model.results.costs import Counts


class ExternalModel(ObservedModel):
    """A case without ground of its own.

    Args:
        case: the case.
        provided: (n_stages, n_channels) which readings the model gives.
        seen: (n,) which parameters it depends on.
    """

    def __init__(self, case: Case, provided: Bools, seen: Bools) -> None:
        states = [
            ConstructionState(name, {}, frozenset(), {}, base=max(n - 1, 0))
            for n, name in enumerate(case.stage_names)
        ]
        sequence = ConstructionSequence((), np.zeros(0, np.int64), tuple(states))
        super().__init__(case, _rule(case, provided), sequence.built_on, sequence.bases)
        self.sequence, self.provided, self.seen = sequence, provided, seen
        self._asked: set[bytes] = set()

    @abstractmethod
    def given_readings(self, p: Floats, *, derivatives: bool, exact: bool) -> Floats:
        """What the model gives at p (n,), (n_stages, n_channels, 1 + n), SI; NaN where nothing.

        Args:
            p: (n,) parameters.
            derivatives: whether they are wanted; else the last axis has length 1.
            exact: derivatives as good as they can be; else as good as a search needs them.

        Raises:
            ModelError: it gives nothing there.
        """

    def key(self, p: Floats) -> bytes:
        """The same for all p (n,) at which the model gives the same."""
        return p[self.seen].tobytes()

    @property
    def counts(self) -> Counts:
        """Costs so far: different parameter vectors, those of an earlier call among them."""
        return Counts(len(self._asked), 0, 0, 0)

    def why_unseen(self, state: int, row: int) -> str:
        """Why a channel cannot be read at a state at which it can't, a clause."""
        if state == 0:
            return "the model gives nothing before the first stage"
        where = "there" if not self.provided[state - 1, row] else "at its zero"
        return f"the model gives no reading of it {where}"

    def observe(self, p: Floats, query: Query) -> Observed:
        """What the model gives at p (n,)."""
        self._asked.add(self.key(p))
        readings = self.given_readings(p, derivatives=query.derivatives, exact=query.fields)
        return Observed(np.concatenate([np.zeros((1, *readings.shape[1:])), readings]))

    def increments_of(self, observed: Observed) -> Floats:
        """What each state changes in what channels see, (n_states, n_channels), SI.

        Where the model gives nothing, a channel stays at what it gave last.
        """
        seen = np.array(observed.seen[:, :, 0])
        for state in range(1, len(seen)):
            unknown = ~np.isfinite(seen[state])
            seen[state, unknown] = seen[state - 1, unknown]
        return np.diff(seen, axis=0, prepend=0.0)


def _rule(case: Case, provided: Bools) -> ReadingRule:
    """How readings follow from what the model gives, (n_stages, n_channels), and zeros."""
    zero = np.array([case.zero_of(channel) for channel in case.channels], np.int64)
    changes = np.array([channel.is_zeroed for channel in case.channels], dtype=bool)
    seen = np.concatenate([np.ones((1, len(zero)), dtype=bool), provided])
    later = np.arange(len(seen))[:, None] >= zero
    at_zero = seen[zero, np.arange(len(zero))]
    readable = seen & np.where(changes, later & at_zero, True)
    readable[0] = False
    weights = np.stack([np.ones(len(zero)), np.where(changes, -1.0, 0.0)])
    return ReadingRule(tuple(c.name for c in case.channels), zero, weights, readable)

"""What a response may be asked of a reduced model, made of the marches of its evaluations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from geoident.forward.gauges.observation import MarchState
from geoident.forward.march.march import RunOptions
from geoident.forward.reduced.duals.basis import DualBasis
from geoident.forward.reduced.duals.bounds import ReadingDuals
from geoident.forward.reduced.model import ReducedModel
from geoident.forward.reduced.reduction import Reduction
from geoident.forward.reduced.response import ReadingsAsked, ReducedResponse
from geoident.forward.reduced.snapshots import from_arrays, to_arrays
from geoident.forward.reduced.stress_rows import beyond_reduction
from geoident.forward.response import Marches, StagedResponse
from geoident.model.arrays import Floats
from geoident.model.response import CertifiedResponse


@dataclass
class SharedReduction:
    """The marches of the search that was begun last: other responses of the model may use them.

    Args:
        reduction: those; None where none are kept.
    """

    reduction: Reduction | None = None


class ReducibleResponse(StagedResponse):
    """Readings of some (channel, stage) pairs, and the reduced model of the marches for them.

    It evaluates as a `StagedResponse` does. Fulfils also the protocols ``HasReducedModel`` and
    ``KeepsMarches``.

    Args:
        marches: of the case.
        shared: the marches of other responses.
        pairs: channel and stage of every reading.
        times: when each was read; None for what is known of its stage.
    """

    def __init__(
        self,
        marches: Marches,
        shared: SharedReduction,
        pairs: Sequence[tuple[str, str]],
        times: Sequence[float | None] = (),
    ) -> None:
        super().__init__(marches, pairs, times)
        self._shared = shared

    def keep_marches(self, *, economical: bool = True, most: int = 4) -> None:
        """Keep what marches with derivatives find from now on, for a reduced model.

        Args:
            economical: only where it costs less than the marches that a search saves by it.
            most: how many marches count at most, the newest.
        """
        marches = self._marches
        if self.reduction is not None or self._beyond is not None:
            return
        known = self._shared.reduction
        if economical and known is not None and known.economical and known.last >= self._last:
            self.reduction = known  # that of another response goes as far
            return
        self.reduction = Reduction(
            marches.march, marches.observation, self._last, most=most, economical=economical
        )
        self._shared.reduction = self.reduction

    def reduction_obstacle(self) -> str | None:
        """Why there is no reduced model, a clause, or None if there may be one."""
        if self._beyond is not None or self.reduction is None:
            return self._beyond
        return self.reduction.obstacle

    @cached_property
    def _beyond(self) -> str | None:
        """Why its readings have no reduced model, a clause, or None if they have."""
        return beyond_reduction(self._marches.march, self._marches.observation, self._row)

    @property
    def has_reduced_model(self) -> bool:
        """Whether marches are kept for one, and nothing is known that stands against it."""
        return self.reduction is not None and self.reduction_obstacle() is None

    def march_again(self, visited: Sequence[Floats]) -> None:
        """Have the reduced model made of the marches at some parameter vectors (n,), in that order.

        Those that were not made since they are kept are made now.
        """
        reduction = self.reduction
        if reduction is None or reduction.obstacle is not None:
            return
        for number, p in list(enumerate(visited))[-reduction.most :]:
            if not reduction.knows(p):
                self.expect_march(number)
                self.by_tangents(p)
        reduction.order(visited[-reduction.most :])

    def expect_march(self, number: int, *, learns: bool = True) -> None:
        """The next march is the one of a number in a search, from 0.

        Args:
            number: of the march.
            learns: whether it is kept for the reduced model.
        """
        self.learns = learns
        if self.reduction is not None:
            self.reduction.number = number

    def march_made(self, p: Floats) -> dict[str, Floats] | None:
        """The march at p (n,) as arrays; None where it is not kept, or does not serve."""
        made = () if self.reduction is None else self.reduction.snapshots
        return next((to_arrays(one) for one in made if np.array_equal(one.p, p)), None)

    def take_march(self, p: Floats, arrays: Mapping[str, Floats]) -> None:
        """Keep the march at p (n,) that an earlier run has made."""
        if self.reduction is not None and self.reduction.covers():
            self.reduction.add(from_arrays(p, arrays))

    def lend(self, p: Floats) -> None:
        """Let marches at p (n,) take their displacements from the reduced model, if there is."""
        made = None if self.reduction is None else self.reduction.model()
        if self.reduction is None or made is None:
            return
        motion = self.reduction.motion(made, p)
        if motion is not None:
            self._marches.lend(p, motion)

    def leap(
        self, p: Floats, key: bytes, find: Callable[[CertifiedResponse], Floats]
    ) -> Floats | None:
        """What is found with the reduced model of the marches that were kept, (k,); None for none.

        Args:
            p: (n,) where the search is.
            key: tells this question from others that are asked there.
            find: looks for it.
        """
        found = self.reduced()
        return None if found is None else find(found)

    def reduced(
        self, *, bounded: bool = False, reference: Floats | None = None
    ) -> ReducedResponse | None:
        """The reduced model of the marches that were kept; None where there is none.

        Args:
            bounded: with bounds of the errors of the readings; costs a march and its way back,
                and the same again for places far from the reference.
            reference: (n,) parameters whose moduli measure; None for those of the last march.
        """
        marches, reduction = self._marches, self.reduction
        made = None if reduction is None else reduction.model(reference)
        if reduction is None or made is None:
            return None
        duals, moved = self._bounded(reduction, made) if bounded else (None, np.zeros(0))
        values = marches.values(made.reference)
        added = marches.instrument_errors.added(values, self.names, self._places)
        dimensions = [marches.case.channels[row].dimension for row in self._row]
        response = ReducedResponse(
            made,
            marches.observation,
            ReadingsAsked(self._row, self._state, added, dimensions),
            marches.sequence.bases,
            self.admissible,
            duals,
        )
        response.see_rounding(moved)
        return response

    def _bounded(self, reduction: Reduction, made: ReducedModel) -> tuple[ReadingDuals, Floats]:
        """Adjoints of the readings, and what the march at the reference moves in them (g,)."""
        marches, observation = self._marches, self._marches.observation
        weights = observation.weights_of_states(self._row, self._state, self._last)
        reads = reduction.reads(self._row, weights)
        by, bases = reduction.dual_derivatives(made), list[DualBasis]()
        at_reference = np.zeros(0)
        for place in reduction.dual_places(made):
            run = marches.at(place, RunOptions(last=self._last, traced=True))
            seen = [
                observation.values(MarchState(end, run.point, marches.structures))
                for end in run.states()
            ]
            if not bases:
                table = observation.readings(np.stack(seen), self._row, self._state)
                at_reference = table[:, 0]
            bases += [reduction.dual_basis(run, place, by, read) for read in reads]
            run.factors.forget()
        return ReadingDuals(made, bases), at_reference

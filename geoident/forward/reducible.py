"""The response of a staged model that may have a surrogate: the reduced model of its model.

Analyses with derivatives are recorded as they are made (`Reduction`), by their parameters. The
surrogate of some parameter vectors is a function of these alone: what is not recorded is analysed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from geoident.forward.observed import Query
from geoident.forward.reduced.reduction import Reduction
from geoident.forward.reduced.response import ReducedResponse
from geoident.forward.reduced.stress_rows import beyond_reduction
from geoident.forward.response import StagedResponse
from geoident.model.arrays import Floats
from geoident.model.response import Evaluation

NOT_RECORDED = "no analyses are recorded for one"

GOOD = 1e-5
"""Error of the stresses of many answers that needs no further analysis."""


class ReducibleResponse(StagedResponse):
    """Readings of some (channel, stage) pairs, and the reduced model of the analyses for them.

    It evaluates as a `StagedResponse` does. Fulfils also the protocol ``HasSurrogate``.

    Attributes:
        reduction: the analyses that are recorded; None where none are.
    """

    reduction: Reduction | None = None

    def record(self, *, economical: bool = True, most: int = 4) -> None:
        """Record the analyses with derivatives from now on, for a surrogate.

        Args:
            economical: only where it costs less than the analyses that a search saves by it.
            most: of how many analyses a surrogate is made at most, the last ones.
        """
        model = self._model
        if self.reduction is not None or self._beyond is not None:
            return
        known = model.reduction if economical else None
        if isinstance(known, Reduction) and known.economical and known.last >= self._last:
            self.reduction = known  # that of another response goes as far
            return
        self.reduction = model.reduction = Reduction(
            model.analysis, model.gauges, self._last, most=most, economical=economical
        )

    def surrogate_obstacle(self) -> str | None:
        """Why there is no surrogate, a clause, or None if there may be one."""
        if self._beyond is not None:
            return self._beyond
        return NOT_RECORDED if self.reduction is None else self.reduction.obstacle

    @cached_property
    def _beyond(self) -> str | None:
        """Why its readings have no reduced model, a clause, or None if they have."""
        model, rows = self._model, self._places.rows
        beyond = beyond_reduction(model.analysis, model.gauges, rows)
        return beyond or model.instrument_errors.not_added(rows)

    def evaluation(self, p: Floats, *, derivatives: bool = True) -> Evaluation:
        """All that is known of the readings at p (n,).

        An analysis with derivatives that is recorded goes as far as the surrogate is to go.
        """
        reduction = self.reduction
        recorder = None
        if derivatives and reduction is not None and not reduction.knows(p):
            recorder = reduction.recorder(p)
        if reduction is None or recorder is None:
            return super().evaluation(p, derivatives=derivatives)
        query = Query(self._places, max(self._last, reduction.last))
        observed = self._model.observe(p, query, adjoints=False, tell=recorder.add)
        reduction.add(recorder.snapshot)
        observed = replace(observed, seen=observed.seen[: self._last + 1])
        return self._model.evaluation_of(p, observed, self._places, derivatives=True)

    def visited(self) -> Sequence[Floats]:
        """Parameter vectors (n,) whose analyses are recorded, in their order."""
        return () if self.reduction is None else self.reduction.recorded()

    def surrogate(
        self, visited: Sequence[Floats], reference: Floats | None = None
    ) -> ReducedResponse | None:
        """The reduced model of the analyses at some parameter vectors (n,); None for none.

        Where no analysis is recorded, one is made now.

        Args:
            visited: (n,) they, the last of which counts most; those before the last `most` ones
                are left out.
            reference: (n,) parameters whose moduli measure; None for those of the last.

        Raises:
            ModelError: there is no solution at one of them.
        """
        reduction = self.reduction
        if reduction is None or reduction.obstacle is not None:
            return None
        wanted = visited[-reduction.most :]
        reduction.prefer(wanted)
        for p in wanted:
            if not reduction.knows(p):
                self.evaluation(p)
        made = reduction.model(wanted, reference)
        if made is None:
            return None
        return ReducedResponse(made, self._model, self._places, np.zeros(0))

    def surrogate_around(
        self, centre: Floats, training: Floats, *, most: int, also: Sequence[Floats] = ()
    ) -> ReducedResponse | None:
        """A surrogate for many answers, which estimates the errors of its readings; None for none.

        It is made of analyses at the centre and, one after the other, where among the training
        points the error of its stresses is largest. Each of these is predicted before it becomes
        part of the surrogate: how far the prediction is off tells the errors of readings
        (`reduced.response`). At least one is predicted.

        Args:
            centre: (n,) parameters in the middle of what will be asked; their moduli measure.
            training: (k, n) some of what will be asked.
            most: analyses of which it is made at most, beside `also`.
            also: (n,) parameters of which it is to be made, too.

        Raises:
            ModelError: there is no solution at one of them.
        """
        self.record(economical=False, most=most + len(also))
        visited, waiting = [centre], list(also)
        ratios = np.zeros(0)  # none was withheld yet
        while True:
            surrogate = self.surrogate(visited)
            if surrogate is None:  # the loads at these do not span all loads
                if self.surrogate_obstacle() is not None or len(visited) > len(training):
                    return None
                visited.append(training[len(visited) - 1])
                continue
            error = surrogate.errors(training)
            worst = int(np.argmax(error))
            enough = error[worst] <= GOOD and len(visited) > 1
            if not waiting and (enough or len(visited) >= most + len(also)):
                break
            p = waiting.pop(0) if waiting else training[worst]
            if any(np.array_equal(p, other) for other in visited):
                break
            ratio = surrogate.ratio(p, self.evaluation(p).readings)
            ratios = np.maximum(ratios, ratio) if len(ratios) else ratio
            visited.append(p)
        surrogate = self.surrogate(visited, centre)
        if surrogate is not None:
            surrogate.ratios = ratios
        return surrogate

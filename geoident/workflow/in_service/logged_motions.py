"""Motions of a structure in service that outlive an interrupted fit, as `CachedResponse` has it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geoident.forward.in_service.structure import Motions, ServiceModel
from geoident.model.arrays import Floats, Ints
from geoident.model.results.costs import Counts
from geoident.workflow.running.control import Control
from geoident.workflow.running.evaluation_log import Log


class LoggedMotions:
    """Motions of the same readings at any parameters, each logged the moment it is known.

    What is logged is what acts on each reading: temperature fields and levels, of which the model
    makes it, are those of one process.

    Args:
        model: of the structure.
        rows: (g,) channels of the readings.
        times: (g,) when they were read, s.
        log: of evaluations of the same fit.
        control: stops a fit between two evaluations.
    """

    def __init__(
        self, model: ServiceModel, rows: Ints, times: Floats, log: Log, control: Control
    ) -> None:
        self._model, self._rows, self._times = model, rows, times
        self._log, self._control = log, control
        self._asked: set[bytes] = set()

    @property
    def counts(self) -> Counts:
        """Parameter vectors that were asked for, wherever the answer came from; what was done."""
        return replace(self._model.counts, evaluations=len(self._asked))

    def at(self, p: Floats) -> Motions:
        """At parameters p (n,), SI.

        Raises:
            Interrupted: a stop was asked for.
            ModelError: there is no solution, or no time for it.
        """
        self._asked.add(p.tobytes())
        if (known := self._log.find("motions", p)) is not None:
            return Motions({name: np.array(part) for name, part in known.items()})
        self._control.stop.check()
        self._control.within()
        motions = self._model.motions(p, self._rows, self._times)
        self._log.add("motions", p, motions.parts)
        return motions

"""The plastic multipliers of earlier stages, kept of materials that harden."""

from __future__ import annotations

import numpy as np

from geoident.forward.march.stage_equations import Ground
from geoident.forward.march.step import StepTask
from geoident.model.arrays import Floats, Ints


class Hardening:
    """Multipliers so far, kept only of materials that harden.

    Args:
        task: of the stage.
        n_columns: how many columns are worked on.
        state: work on the state, column 0, instead of the derivatives.
    """

    def __init__(self, task: StepTask, n_columns: int, *, state: bool = False) -> None:
        self._task = task
        self._part = slice(0, 1) if state else slice(1, 1 + n_columns)

    def before(self, ground: Ground, points: Ints) -> Floats | None:
        """(y, q, n) at some points, or None."""
        if ground.law is None or not ground.law.hardens:
            return None
        found = self._task.borne.hardened.get(ground.name)
        return None if found is None else found[:, points, self._part]

    def add(self, ground: Ground, points: Ints, more: Floats) -> None:
        """Add (y, q, n) at some points."""
        if ground.law is None or not ground.law.hardens:
            return
        hardened = self._task.borne.hardened
        if ground.name not in hardened:
            shape = (ground.law.n_planes, *self._task.borne.stress.shape[1:])
            hardened[ground.name] = np.zeros(shape)
        hardened[ground.name][:, points, self._part] += more

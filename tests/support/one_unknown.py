"""Equations of a stage with one unknown, for the rules of Newton's method."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np

from geoident.forward.march.stage_equations import Trial
from geoident.model.arrays import Floats

ZERO = np.zeros(1)


class OneUnknown:
    """One unknown u with the residual r(u), 0 where a table has none; a factor's steps are 1 long.

    It has a potential and is large, unless other attributes are given.

    Attributes:
        asked: where the residual was asked for.
        levels: from which level on every tangent was made.
    """

    dofs = np.array([0])
    forces = np.array([1.0])
    at_hand = held = patches = None
    associated = large = True

    def __init__(
        self, residual: Callable[[float], float] | Mapping[float, float], **changes: Any
    ) -> None:
        self.residual: Callable[[float], float] = (
            residual if callable(residual) else lambda u: residual.get(u, 0.0)
        )
        self.asked: list[float] = []
        self.levels: list[int] = []
        self.__dict__.update(changes)

    def at(self, du: Floats) -> Trial:
        self.asked.append(float(du[0]))
        found = np.array([float(self.residual(float(du[0])))])
        return Trial(du, np.zeros((1, 1)), (), found, 1.0)

    def distance(self, trial: Trial) -> float:
        return trial.error

    def factor(self, trial: Trial, *, least: int = 0) -> tuple[SimpleNamespace, int]:
        self.levels.append(least)
        return SimpleNamespace(solve=np.ones_like, valid=True), least

    def spread(self, free: Floats) -> Floats:
        return free

    def begun(self, u: float = 0.0) -> Trial:
        return self.at(np.array([u]))

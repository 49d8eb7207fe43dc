"""Frames of parallel bars that yield: a `YieldSystem` whose response is known by hand.

The bars of a frame join a wall and a rigid beam. A load F on the beam lengthens all by u with

    sum_i  s_i(u) = F ,     s_i = c_i u  up to the strength k_i, then k_i + h c_i (u - k_i / c_i),

h = 0 unless hardened. Loads grow from stage to stage. Beyond sum k_i there is no equilibrium. What
is read is u of every frame in every stage. du/dk = -(sum of (1 - h) over the bars that yield and
have this k) / (sum of the stiffness left).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geoident.errors import CollapseError
from geoident.model.arrays import Floats
from geoident.model.response import Evaluation
from geoident.model.results.costs import Counts
from geoident.model.yielding import Activity


@dataclass(frozen=True)
class Frame:
    """Bars and their growing loads.

    Args:
        stiffness: c, N/m.
        strength: of every bar the number of its parameter, or None for one that never yields.
        loads: F of every stage, N.
    """

    stiffness: Sequence[float]
    strength: Sequence[int | None]
    loads: Sequence[float]


@dataclass
class Costs:
    """Evaluations made, shared by derived systems."""

    evaluations: int = 0


class PlasticBars:
    """Frames that are read in every stage, stage by stage."""

    def __init__(
        self,
        frames: Sequence[Frame],
        n: int,
        *,
        ratio: float = 0.0,
        last: int | None = None,
        costs: Costs | None = None,
    ) -> None:
        self.frames = tuple(frames)
        self.n = n
        self.ratio = ratio
        self.last = len(frames[0].loads) if last is None else last
        self.costs = costs or Costs()

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"k{i + 1}" for i in range(self.n))

    @property
    def counts(self) -> Counts:
        return Counts(evaluations=self.costs.evaluations)

    def admissible(self, p: Floats) -> str | None:
        return None if np.all(p > 0.0) else "a strength is not positive"

    def yields(self) -> bool:
        return any(k is not None for frame in self.frames for k in frame.strength)

    def readings(self, p: Floats) -> Floats:
        return self.evaluate(p)[0]

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        self.costs.evaluations += 1
        v, J = [], []
        for stage in range(self.last):
            for frame in self.frames:
                u, du = self._elongation(frame, p, stage)
                v.append(u)
                J.append(du)
        return np.array(v), np.array(J)

    def evaluation(self, p: Floats, *, derivatives: bool = True) -> Evaluation:
        v, J = self.evaluate(p)
        return Evaluation(v, J if derivatives else None, activity=self.activity(p))

    def forget(self) -> None:
        pass

    def activity(self, p: Floats) -> Activity:
        bars = [(f, b) for f in self.frames for b, k in enumerate(f.strength) if k is not None]
        points = np.zeros((len(bars), self.last), dtype=np.int64)
        biactive = np.zeros_like(points)
        reached = np.zeros(len(bars))
        slopes = np.zeros((len(bars), self.n))
        for r, (frame, b) in enumerate(bars):
            index = frame.strength[b]
            assert index is not None
            slopes[r, index] = 1.0
            for stage in range(self.last):
                force = frame.stiffness[b] * self._elongation(frame, p, stage)[0]
                points[r, stage] = force > p[index] * (1 + 1e-12)
                biactive[r, stage] = abs(force / p[index] - 1.0) <= 1e-12
                reached[r] = max(reached[r], min(force, p[index]))
        distances = slopes @ p
        planes = tuple(f"frame {self.frames.index(f) + 1}: bar {b + 1}" for f, b in bars)
        stages = tuple(f"stage {j + 1}" for j in range(self.last))
        return Activity(planes, stages, points, biactive, distances, reached, slopes)

    def _elongation(self, frame: Frame, p: Floats, stage: int) -> tuple[float, Floats]:
        """u and du/dp: from kink to kink of the force, until it is the load."""
        c = np.array(frame.stiffness, dtype=float)
        k = np.array([np.inf if i is None else p[i] for i in frame.strength])
        order = np.argsort(k / c)
        yielded = np.zeros(len(c), dtype=bool)
        for b in [*order, None]:
            left = c[~yielded].sum() + self.ratio * c[yielded].sum()
            bound = (1.0 - self.ratio) * k[yielded].sum()
            u = (frame.loads[stage] - bound) / left if left > 0.0 else np.inf
            if b is None or c[b] * u <= k[b]:
                break
            yielded[b] = True
        if not np.isfinite(u):
            raise CollapseError(
                f"the bars cannot carry the load of stage {stage + 1}",
                stage=f"stage {stage + 1}",
                fraction=float(k.sum() / frame.loads[stage]),
            )
        slope = np.zeros(self.n)
        for b in np.flatnonzero(yielded):
            slope[frame.strength[b]] -= (1.0 - self.ratio) / left
        return float(u), slope

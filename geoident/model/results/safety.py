"""Factors of safety by strength reduction: of a stage, and their band from a fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geoident.model.arrays import Floats, Ints
from geoident.model.results.yielded import Mechanism

FELT = 0.1
"""Part of the largest influence of a parameter from which on another one counts."""


@dataclass(frozen=True)
class SafetyFactor:
    """By what the strength of the ground may be divided at the end of a stage.

    Args:
        stage: name of the stage.
        lower: largest factor with which an equilibrium was found.
        upper: smallest factor with which none was found; infinite where there was one with all.
        proven: whether there is none at ``upper``: the ground collapses. Else none was found.
        associated: whether the flow of all that yields is associated.
        kept: what yields and keeps its strength: materials of planes without c and phi, structures.
        unyielding: materials, structures and interfaces that never yield.
        mechanism: how the ground moves at ``upper``; None where nothing is known.
        place: where it shears most, a clause; empty where nothing is known.
        factors: (k,) with which an equilibrium was found, ascending, from that at which the search
            began.
        moved: (k,) largest displacement since then, m.
        solved: equilibria that were looked for.
    """

    stage: str
    lower: float
    upper: float
    proven: bool
    associated: bool
    kept: tuple[str, ...]
    unyielding: tuple[str, ...]
    mechanism: Mechanism | None
    place: str
    factors: Floats
    moved: Floats
    solved: int

    @property
    def value(self) -> float:
        """The factor: the middle of its bracket, or the largest that was tried."""
        return float(np.sqrt(self.lower * self.upper)) if self.bounded else self.lower

    @property
    def bounded(self) -> bool:
        """Whether the ground fails with some factor that was tried."""
        return bool(np.isfinite(self.upper))


@dataclass(frozen=True)
class SafetyBand:
    """What a fit knows of a factor of safety.

    Args:
        best: at the best values.
        lower95: lower end of the 95 % interval.
        median: of the posterior.
        upper95: its upper end.
        below_one: the probability that the factor is below one.
        below_one_sd: standard deviation of that number by the draws and by what the surface leaves.
        names: of the n parameters.
        draws: (d, n) of the posterior, SI.
        factors: (d,) at the draws; NaN where the model has no answer.
        bounded: (d,) 1 where the ground fails with a factor that was tried, else the factor is at
            least that.
        surface: ``quadratic`` or ``linear``: the logarithm of the factor over the posterior.
        left: standard deviation of what it leaves of the logarithm at draws that it was not fitted
            to.
        influence: (n,) change of the logarithm by one standard deviation of each parameter.
        undetermined: parameters that the fit does not determine.
        counted: how many draws are below one.
    """

    best: SafetyFactor
    lower95: float
    median: float
    upper95: float
    below_one: float
    below_one_sd: float
    names: tuple[str, ...]
    draws: Floats
    factors: Floats
    bounded: Ints
    surface: str
    left: float
    influence: Floats
    undetermined: tuple[str, ...]
    counted: int

    @property
    def left_open(self) -> tuple[str, ...]:
        """Parameters that the fit does not determine and on which the factor depends."""
        size = np.abs(self.influence)
        depends = {n for n, x in zip(self.names, size, strict=True) if x > FELT * size.max()}
        return tuple(name for name in self.undetermined if name in depends)

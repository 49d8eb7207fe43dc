"""Factors of safety by strength reduction: of a stage, and their band from a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from geoident.model.arrays import Floats, Ints
from geoident.model.results.columns import VIEWS, Record, column

FELT = 0.1
"""Part of the largest influence of a parameter from which on another one counts."""


class StageSafety(Record):
    """By what the strength of the ground may be divided at the end of a stage, and its band.

    Without a fit there is no band: NaN and nothing.

    Args:
        stage: name of the stage.
        value: the factor at given values: the middle of its bracket, or the largest tried.
        lower: largest factor with which an equilibrium was found.
        upper: smallest factor with which none was found; infinite where there was one with all.
        proven: whether there is none at ``upper``: the ground collapses. Else none was found.
        associated: whether the flow of all that yields is associated.
        kept: what yields and keeps its strength, separated by commas.
        unyielding: materials, structures and interfaces that never yield, likewise.
        place: where it shears most as it fails, a clause; empty where nothing is known.
        tried: (k,) factors with which an equilibrium was found, ascending.
        moved: (k,) largest displacement since the first of them, m.
        lower95: lower end of the 95 % interval by the fit.
        median: of the posterior.
        upper95: its upper end.
        below_one: the probability that the factor is below one.
        below_one_sd: standard deviation of that number by the draws and by what the surface leaves.
        counted: how many draws are below one.
        surface: ``quadratic`` or ``linear``: the logarithm of the factor over the posterior.
        left: standard deviation of what it leaves of the logarithm at draws that it was not fitted
            to.
        undetermined: parameters that the fit does not determine and on which the factor depends,
            separated by commas.
        influence: (n,) change of the logarithm by one standard deviation of each parameter.
        factors: (d,) at draws of the posterior; NaN where the model has no answer.
        bounded: (d,) 1 where the ground fails with a factor that was tried, else the factor is at
            least that.
        draws: (d, n) these, SI.
    """

    stage: str
    value: float = column(name="factor")
    lower: float
    upper: float
    proven: bool
    associated: bool
    kept: str
    unyielding: str
    place: str
    tried: Floats = column("trial", hidden=VIEWS)
    moved: Floats = column("trial", dimension="length", hidden=VIEWS)
    lower95: float = np.nan
    median: float = np.nan
    upper95: float = np.nan
    below_one: float = np.nan
    below_one_sd: float = np.nan
    counted: int = column(default=0, name="draws_below_one")
    surface: str = ""
    left: float = column(default=np.nan, name="surface_error")
    undetermined: str = ""
    influence: Floats = column(
        "parameter", default_factory=lambda: np.zeros(0), sheet="influence_{parameter}"
    )
    factors: Floats = column(
        "safety_draw", default_factory=lambda: np.zeros(0), name="factor_at_draw", hidden=VIEWS
    )
    bounded: Ints = column(
        "safety_draw",
        default_factory=lambda: np.zeros(0, dtype=np.int64),
        name="bounded_at_draw",
        hidden=VIEWS,
    )
    draws: Floats = column(
        "safety_draw",
        "parameter",
        default_factory=lambda: np.zeros((0, 0)),
        name="draw",
        hidden=VIEWS,
    )

    @property
    def fails(self) -> bool:
        """Whether the ground fails with some factor that was tried."""
        return bool(np.isfinite(self.upper))

    @property
    def of_fit(self) -> bool:
        """Whether there is a band."""
        return len(self.factors) > 0


def alike(rows: Sequence[StageSafety]) -> tuple[StageSafety, ...]:
    """The same with as many trials each, NaN behind the last: rows of one table."""
    most = max(len(row.tried) for row in rows)

    def filled(values: Floats) -> Floats:
        return np.concatenate([values, np.full(most - len(values), np.nan)])

    return tuple(replace(row, tried=filled(row.tried), moved=filled(row.moved)) for row in rows)


def depends_on(names: Sequence[str], influence: Floats) -> tuple[str, ...]:
    """Parameters whose influence (n,) is not small beside that of others."""
    size = np.abs(influence)
    return tuple(n for n, x in zip(names, size, strict=True) if x > FELT * size.max(initial=0.0))

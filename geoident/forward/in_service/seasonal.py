"""The effects of a seasonal model: columns of a linear model of the readings (theory 16.1).

Powers of the level relative to its range, waves of the year, air temperature less its mean as
bodies of some response times feel it, and motions that begin with the service.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.in_service import DAY, YEAR, SeasonalModel, StructureInService


@dataclass(frozen=True)
class Scales:
    """What the columns of level and air count from; of readings that are judged later, too.

    Args:
        level_low: level from which it counts, m; NaN where there is no effect of it.
        level_high: level at which it counts as 1, m.
        air_mean: air temperature from which it counts, K; NaN where there is no effect of it.
    """

    level_low: float = np.nan
    level_high: float = np.nan
    air_mean: float = np.nan

    @classmethod
    def of(cls, model: SeasonalModel) -> Scales:
        """Those of the series that a model has."""
        level = (np.nan, np.nan)
        if model.level is not None:
            low, high = float(model.level.values.min()), float(model.level.values.max())
            level = (low, high if high > low else low + 1.0)
        return cls(*level, np.nan if model.air is None else float(model.air.values.mean()))


@dataclass(frozen=True)
class Effects:
    """What the effects of a model are at some times.

    Args:
        columns: (k, q) the columns, a constant first; NaN where something that acts is not known.
            On a mesh those of the gauges that are read at the k times.
        names: q of the columns.
        effects: q, to which effect each belongs, see `EFFECTS`; empty for the constant, and for
            parameters that all gauges share.
        shared: the last columns are what all gauges share: so many.
    """

    columns: Floats
    names: tuple[str, ...]
    effects: tuple[str, ...]
    shared: int = 0

    @property
    def own(self) -> Ints:
        """Numbers of the columns whose coefficients each gauge has of its own."""
        return np.arange(len(self.names) - self.shared)

    @property
    def known(self) -> Bools:
        """(k,) at which times all that acts is known."""
        return np.asarray(np.isfinite(self.columns).all(axis=1))

    def of(self, effect: str) -> Ints:
        """Numbers of the columns of an effect."""
        return np.flatnonzero(np.array(self.effects) == effect)


ON_A_MESH = ("temperature", "creep")
"""Effects of a structure on its mesh: of its temperatures, and of materials that change."""

EFFECTS = ("level", "season", "air", *ON_A_MESH, "irreversible")
"""All effects, in the order of the columns."""


def effects_at(
    model: SeasonalModel, scales: Scales, times: Floats, loads: Floats | None = None
) -> Effects:
    """The effects of a model.

    Args:
        model: what acts.
        scales: what level and air count from.
        times: (k,) s since 1970.
        loads: (k,) times whose level and air act then; None: the same.
    """
    loads = times if loads is None else loads
    columns: list[tuple[str, str, Floats]] = [("constant", "", np.ones(len(times)))]
    if model.level is not None:
        span = scales.level_high - scales.level_low
        relative = (model.level.at(loads) - scales.level_low) / span
        columns += [
            (f"level^{power}" if power > 1 else "level", "level", relative**power)
            for power in range(1, model.powers + 1)
        ]
    year = 2.0 * np.pi * times / YEAR
    for part in range(1, model.harmonics + 1):
        columns.append((f"cos {part}", "season", np.cos(part * year)))
        columns.append((f"sin {part}", "season", np.sin(part * year)))
    if model.air is not None:
        columns += [
            (f"air {_days(lag)}", "air", model.air.lagged(loads, lag) - scales.air_mean)
            for lag in model.lags
        ]
    columns += [(name, "irreversible", v) for name, v in lasting_motions(model, times)]
    names, effects, values = zip(*columns, strict=True)
    return Effects(np.column_stack(values), names, effects)


def lasting_motions(
    model: SeasonalModel | StructureInService, times: Floats
) -> Iterator[tuple[str, Floats]]:
    """Motions that do not come back: their names, and columns (k,) at times (k,)."""
    since = times - model.since
    if model.linear:
        yield "linear", since / YEAR
    for time in model.settling:
        yield f"settling {_days(time)}", 1.0 - np.exp(-since / time)


def independent(columns: Floats) -> Ints:
    """Numbers of columns (k, q) that the ones before them do not already make."""
    kept: list[int] = []
    basis = np.zeros((len(columns), 0))
    for number, column in enumerate(columns.T):
        left = column - basis @ (basis.T @ column)
        left -= basis @ (basis.T @ left)
        size = float(np.linalg.norm(left))
        if size > _ALREADY_MADE * float(np.linalg.norm(column)):
            basis = np.column_stack([basis, left / size])
            kept.append(number)
    return np.array(kept, dtype=np.int64)


_ALREADY_MADE = 1e-6
"""Part of a column that the others leave of it, below which it says nothing by itself."""


def _days(time: float) -> str:
    """A time in the words of an engineer.

    >>> _days(3 * 86400.0), _days(365.25 * 86400.0)
    ('3 d', '1 yr')
    """
    years = time / YEAR
    return f"{years:.3g} yr" if years >= 1.0 else f"{time / DAY:.3g} d"

"""The effects that explain readings of a structure in service, by a seasonal model or a mesh."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from geoident.forward.in_service.seasonal import Effects, Scales, effects_at, lasting_motions
from geoident.forward.in_service.structure import ServiceModel, known_at
from geoident.forward.observed import ObservedModel
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.case import Case
from geoident.model.gauges import ReadingTable
from geoident.model.in_service import SeasonalModel
from geoident.model.results.result import Result


class EffectsOf(Protocol):
    """Effects on readings."""

    def __call__(self, rows: Ints, times: Floats, loads: Floats | None = None) -> Effects:
        """Those on k readings.

        Args:
            rows: (k,) numbers of their channels.
            times: (k,) when they are read, s.
            loads: (k,) times whose level and temperatures act then; None: the same.
        """


def channel_rows(case: Case, table: ReadingTable) -> Ints:
    """(k,) number of the channel of each reading."""
    row = {channel.name: i for i, channel in enumerate(case.channels)}
    return np.array([row[name] for name in table.channel], dtype=np.int64)


def effects_of_fit(case: Case, model: ObservedModel, fit: Result) -> EffectsOf:
    """The effects that a fit has coefficients of."""
    if isinstance(model, ServiceModel):
        p = fit.parameters.values
        return lambda rows, times, loads=None: structure_effects(model, p, rows, times, loads)
    seasonal, acting = fit.seasonal, case.elsewhere
    assert seasonal is not None
    assert isinstance(acting, SeasonalModel)
    scales = Scales(seasonal.level_low, seasonal.level_high, seasonal.air_mean)
    return lambda rows, times, loads=None: effects_at(acting, scales, times, loads)


def all_is_known(case: Case, model: ObservedModel, times: Floats) -> Bools:
    """(k,) at which times, s, all that acts is known."""
    if isinstance(model, ServiceModel):
        return known_at(model.service, model.heat, np.nan_to_num(times))
    acting = case.elsewhere
    assert isinstance(acting, SeasonalModel)
    return effects_at(acting, Scales.of(acting), times).known


def structure_effects(
    model: ServiceModel, p: Floats, rows: Ints, times: Floats, loads: Floats | None = None
) -> Effects:
    """The effects on readings of a structure on its mesh.

    A constant and what does not come back, of each gauge; the parts of the motion, whose
    coefficients are one; and its derivatives by the parameters.

    Args:
        model: of the structure.
        p: (n,) parameters, SI.
        rows: (k,) numbers of the channels.
        times: (k,) s.
        loads: (k,) times whose level and temperatures act then; None: the same.
    """
    motions = model.motions(p, rows, np.nan_to_num(times), loads)
    own = list(lasting_motions(model.service, times))
    total = motions.total
    columns = [("constant", "", np.ones(len(times)))]
    columns += [(name, "irreversible", values) for name, values in own]
    columns += [(name, name, part[:, 0]) for name, part in motions.parts.items()]
    columns += [(name, "", total[:, 1 + h]) for h, name in enumerate(model.names)]
    names, effects, values = zip(*columns, strict=True)
    shared = len(columns) - 1 - len(own)
    return Effects(np.column_stack(values), names, effects, shared)

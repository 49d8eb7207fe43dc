"""The effects that explain readings of a structure in service, by a seasonal model or a mesh."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from geoident.forward.in_service.error_shapes import error_shapes
from geoident.forward.in_service.seasonal import Effects, Scales, effects_at, lasting_motions
from geoident.forward.in_service.structure import Motions, ServiceModel, known_at
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
    seasonal, acting = fit.seasonal, case.elsewhere
    assert seasonal is not None
    scales = Scales(seasonal.level_low, seasonal.level_high, seasonal.air_mean)
    if isinstance(model, ServiceModel):
        p = fit.parameters.values
        terms, own = seasonal.terms, seasonal.effects

        def effects_of(rows: Ints, times: Floats, loads: Floats | None = None) -> Effects:
            """By the terms of the result, which may be of a version with fewer of them."""
            effects = structure_effects(model, p, scales, rows, times, loads)
            columns = dict(zip(effects.names, effects.columns.T, strict=True))
            nothing = np.zeros(len(times))
            kept = np.column_stack([columns.get(term, nothing) for term in terms])
            return Effects(kept, terms, own, len(terms) - len(effects.own))

        return effects_of
    assert isinstance(acting, SeasonalModel)
    return lambda _, times, loads=None: effects_at(acting, scales, times, loads)


def all_is_known(case: Case, model: ObservedModel, times: Floats) -> Bools:
    """(k,) at which times, s, all that acts is known."""
    if isinstance(model, ServiceModel):
        return known_at(model.service, model.heat, np.nan_to_num(times))
    acting = case.elsewhere
    assert isinstance(acting, SeasonalModel)
    return effects_at(acting, Scales.of(acting), times).known


def structure_effects(
    model: ServiceModel,
    p: Floats,
    scales: Scales,
    rows: Ints,
    times: Floats,
    loads: Floats | None = None,
) -> Effects:
    """The effects on readings of a structure on its mesh; see `effects_of_motions`.

    Args:
        model: of the structure.
        p: (n,) parameters, SI.
        scales: what the level counts from.
        rows: (k,) numbers of the channels.
        times: (k,) s.
        loads: (k,) times whose level and temperatures act then; None: the same.
    """
    motions = model.motions(p, rows, np.nan_to_num(times), loads)
    return effects_of_motions(model, motions, scales, times, loads)


def effects_of_motions(
    model: ServiceModel,
    motions: Motions,
    scales: Scales,
    times: Floats,
    loads: Floats | None = None,
) -> Effects:
    """The effects that motions of a structure on its mesh have.

    A constant and what does not come back, of each gauge; the motion by level and temperature,
    whose coefficients are about one, with the shapes of the error of the model; creep; and the
    derivatives of the motion by the parameters.

    Args:
        model: of the structure.
        motions: of the readings (k).
        scales: what the level counts from.
        times: (k,) s.
        loads: (k,) times whose level and temperatures act then; None: the same.
    """
    loads = np.nan_to_num(times if loads is None else loads)
    columns = [("constant", "", np.ones(len(times)))]
    columns += [(name, "irreversible", v) for name, v in lasting_motions(model.service, times)]
    own, total = len(columns), motions.total
    columns += error_shapes(model, motions, scales, loads)
    if "creep" in motions.parts:
        columns.append(("creep", "creep", motions.parts["creep"][:, 0]))
    columns += [(name, "", total[:, 1 + h]) for h, name in enumerate(model.names)]
    names, effects, values = zip(*columns, strict=True)
    return Effects(np.column_stack(values), names, effects, len(columns) - own)

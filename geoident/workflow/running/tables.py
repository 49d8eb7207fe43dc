"""The tables of a result, from the parts that know their numbers."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from geoident.identify.assessment.uncertainty import Assessment
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.gauges import Reading
from geoident.model.parameter import Parameter, Prior
from geoident.model.result import GaugeTable, ParameterTable
from geoident.workflow.running.selection import Selection


def parameter_table(
    parameters: Sequence[Parameter], values: Floats, assessment: Assessment
) -> ParameterTable:
    """The parameters at their values with what is known of them.

    Args:
        parameters: the n unknowns.
        values: (n,) SI.
        assessment: how well they are known.
    """
    return ParameterTable(
        names=tuple(q.name for q in parameters),
        values=values,
        sd=assessment.sd,
        lower95=assessment.lower95,
        upper95=assessment.upper95,
        lower=np.array([q.lower for q in parameters], dtype=np.float64),
        upper=np.array([q.upper for q in parameters], dtype=np.float64),
        start=np.array([q.start for q in parameters], dtype=np.float64),
        at_bound=assessment.at_bound,
        determined=assessment.determined,
        priors=tuple(prior_text(q.prior) for q in parameters),
        units=tuple(q.unit for q in parameters),
        dimensions=tuple(q.dimension for q in parameters),
        covariance=assessment.covariance,
        correlation=assessment.correlation,
    )


def bare_parameter_table(parameters: Sequence[Parameter], values: Floats) -> ParameterTable:
    """The parameters at their values (n,) where nothing was asked about their uncertainty."""
    n = len(parameters)
    unknown = np.full(n, np.nan)
    bounds = np.array([(q.lower, q.upper) for q in parameters], dtype=np.float64).reshape(n, 2)
    return ParameterTable(
        names=tuple(q.name for q in parameters),
        values=values,
        sd=unknown,
        lower95=unknown,
        upper95=unknown,
        lower=bounds[:, 0],
        upper=bounds[:, 1],
        start=np.array([q.start for q in parameters], dtype=np.float64),
        at_bound=np.any(bounds == values[:, None], axis=1),
        determined=np.ones(n, dtype=np.bool_),
        priors=tuple(prior_text(q.prior) for q in parameters),
        units=tuple(q.unit for q in parameters),
        dimensions=tuple(q.dimension for q in parameters),
        covariance=np.full((n, n), np.nan),
        correlation=np.full((n, n), np.nan),
    )


def prior_text(prior: Prior | None) -> str:
    """A prior as results hold it.

    >>> prior_text(Prior(8e6, 1e6))
    'normal(8e+06, 1e+06)'
    """
    return "" if prior is None else f"{prior.kind}({prior.mean:.6g}, {prior.sd:.6g})"


def gauge_table(selection: Selection, computed: Floats) -> GaugeTable:
    """Readings beside the computed ones (n_channels, n_stages), m."""
    case = selection.case
    place = places(case)
    measured = np.full(computed.shape, np.nan)
    sd = np.full(computed.shape, np.nan)
    used, bad = (np.zeros(computed.shape, dtype=np.bool_) for _ in range(2))
    for pair, readings in _together(case).items():
        if pair in place:
            measured[place[pair]], sd[place[pair]] = _combined(readings, selection)
            bad[place[pair]] = bool(readings[0].bad)
    for pair in selection.pairs:
        used[place[pair]] = True
    return GaugeTable(
        channels=tuple(channel.name for channel in case.channels),
        stages=tuple(stage.name for stage in case.stages),
        measured=measured,
        computed=computed,
        sd=sd,
        used=used,
        first=_points([channel.first for channel in case.channels], case),
        second=_points([channel.second for channel in case.channels], case),
        bad=bad,
    )


def _together(case: Case) -> dict[tuple[str, str], list[Reading]]:
    """The good readings of each channel and stage; where there is none, the bad ones."""
    found: dict[tuple[str, str], list[Reading]] = {}
    taken = [reading for reading in case.readings if reading.value is not None]
    for reading in sorted(taken, key=lambda reading: bool(reading.bad)):
        group = found.setdefault((reading.channel, reading.stage), [])
        if not group or not reading.bad or group[0].bad:
            group.append(reading)
    return found


def _combined(readings: Sequence[Reading], selection: Selection) -> tuple[float, float]:
    """The weighted mean of readings, m, and its standard deviation."""
    values = np.array([reading.value for reading in readings], dtype=np.float64)
    if len(readings) == 1:
        return float(values[0]), selection.accuracy(readings[0])
    weight = np.array([selection.accuracy(reading) for reading in readings]) ** -2.0
    return float(weight @ values / weight.sum()), float(weight.sum() ** -0.5)


def places(case: Case) -> dict[tuple[str, str], tuple[int, int]]:
    """Row and column of each channel and stage in the tables of a result."""
    rows = [channel.name for channel in case.channels]
    columns = [stage.name for stage in case.stages]
    return {
        (channel, stage): (i, j)
        for (i, channel), (j, stage) in product(enumerate(rows), enumerate(columns))
    }


def accuracies(case: Case) -> Floats:
    """Standard deviation of a reading of each channel (n_channels, n_stages), m.

    NaN at the stage at which a channel is zeroed: it reads nothing there.
    """
    each = np.array([channel.accuracy for channel in case.channels], dtype=np.float64)
    zero = [[channel.zero == stage.name for stage in case.stages] for channel in case.channels]
    at_zero = np.array(zero, dtype=np.bool_).reshape(len(case.channels), len(case.stages))
    return np.where(at_zero, np.nan, each[:, None])


def _points(points: Sequence[tuple[float, ...] | None], case: Case) -> Floats:
    none = (np.nan,) * case.analysis.dim
    table = [none if point is None else point for point in points]
    return np.array(table, dtype=np.float64).reshape(len(table), case.analysis.dim)

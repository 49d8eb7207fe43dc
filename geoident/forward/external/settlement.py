"""A case whose readings a law of settlement gives, with exact derivatives (theory 4.10).

Consolidation under a load that is placed at once is a sum of exponentials,

    U = 1 - sum_j a_j exp(-(k_j l_v + l_h) t) ,   l_v = c_v / h^2 ,   l_h = 8 c_h / (mu D^2) ,

so that the mean over a lift that takes some time (Olson 1977) is one as well. Lifts are
superposed; drains that come later begin to act then.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoident.forward.external.model import ExternalModel
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.drains import resistance
from geoident.model.dual import Dual, ParameterPoint, joined
from geoident.model.parameter import Values
from geoident.model.settlement import Consolidation, Fill, SettlementLaw

TERMS = 40
"""Of Terzaghi's series; what the others weigh, 0.5 %, goes with the last."""


def settlement(
    law: SettlementLaw, times: Floats, values: Values, names: Sequence[str] = ()
) -> Dual:
    """Settlement (m, n_channels) at some times, and its derivatives.

    NaN before the law applies.

    Args:
        law: the law.
        times: (m,) seconds since 1970.
        values: of the parameters, SI.
        names: of the parameters by which to differentiate.
    """
    point = ParameterPoint(values, names)
    final = point.numbers(law.final)
    if law.consolidation is not None:
        return final * _courses(law.consolidation, times, point)
    elapsed = np.where(times >= law.since, times - law.since, np.nan)[:, None]
    time = point.numbers(law.time)
    if law.curve == "asaoka":
        return final * (1.0 - (time.reciprocal() * -elapsed).exp())
    if not law.shape:
        return final * (1.0 - time / time.plus(elapsed))
    return final * (1.0 - (-_slowed(time.reciprocal() * elapsed, point.numbers(law.shape))).exp())


_STRAIGHT = 1e-4
"""Shape times x below which log(1 + m x) / m is its series: m may be 0."""


def _slowed(x: Dual, m: Dual) -> Dual:
    """log(1 + m x) / m, which is x where m is 0."""
    a, b = x.value, np.broadcast_to(m.value, x.value.shape)
    z = a * b
    small = z < _STRAIGHT
    safe = np.where(small, 1.0, b)
    value = np.where(small, a * (1.0 - z / 2.0 + z**2 / 3.0), np.log1p(z) / safe)
    exact = (a / (1.0 + z) - np.log1p(z) / safe) / safe
    by_m = np.where(small, a**2 * (-0.5 + 2.0 * z / 3.0 - 0.75 * z**2), exact)
    slopes = x.columns[..., 1:] / (1.0 + z)[..., None] + by_m[..., None] * m.columns[..., 1:]
    return Dual(np.concatenate([value[..., None], slopes], axis=-1))


def _courses(of: Consolidation, times: Floats, point: ParameterPoint) -> Dual:
    """(m, n_channels) parts of the final settlement; channels that are alike are computed once."""
    known: dict[tuple[object, ...], Dual] = {}
    columns = []
    for k, fill in enumerate(of.fills):
        drains = of.drains
        numbers = (
            *(each[k] for each in (of.c_v, of.path, of.stress, of.creep, of.creep_time) if each),
            *(() if drains is None else (drains.c_h[k], drains.smear_ratio[k])),
        )
        key = id(fill), *numbers
        if key not in known:
            known[key] = _course(of, k, fill, times, point)
        columns.append(known[key].columns)
    return Dual(np.stack(columns, axis=1)) if columns else Dual.constant(
        np.zeros((len(times), 0)), len(point.names)
    )  # fmt: skip


def _course(of: Consolidation, k: int, fill: Fill, times: Floats, point: ParameterPoint) -> Dual:
    """(m,) parts of the final settlement of channel k."""
    vertical = horizontal = point.constant(0.0)
    installed = -np.inf
    if of.c_v:
        path = point.number(of.path[k])
        vertical = point.number(of.c_v[k]) / (path * path)
    if of.drains is not None:
        drains, installed = of.drains, of.drains.installed
        n, s = (point.constant(x / drains.diameter) for x in (drains.influence, drains.smear))
        mu = resistance(n, s, point.number(drains.smear_ratio[k]))
        horizontal = 8.0 * point.number(drains.c_h[k]) / (mu * drains.influence**2)
    begin, end, load = _parted(fill, installed)
    if of.stress:
        stress = point.number(of.stress[k])
        levels = joined([stress.plus(q).log()[None] for q in load])
        parts = (levels[1:] - levels[:-1]) / (levels[-1] - levels[0])
    else:
        parts = point.constant(np.diff(load) / (load[-1] - load[0]))
    done = degree(begin, end, times, vertical, horizontal, installed, vertical_flow=bool(of.c_v))
    if of.creep:
        creep = log_time(begin, end, times, point.number(of.creep_time[k]))
        done = done + point.number(of.creep[k]) * creep
    return Dual((done * parts).columns.sum(axis=1))


def _parted(fill: Fill, installed: float) -> tuple[Floats, Floats, Floats]:
    """The lifts of a fill, with a lift during which drains are installed in two."""
    begin, end, load = fill.begin, fill.end, fill.load
    across = np.flatnonzero((begin < installed) & (installed < end))
    if across.size:
        k = int(across[0])
        part = (installed - begin[k]) / (end[k] - begin[k])
        begin, end = np.insert(begin, k + 1, installed), np.insert(end, k, installed)
        load = np.insert(load, k + 1, load[k] + part * (load[k + 1] - load[k]))
    return begin, end, load


def degree(
    begin: Floats,
    end: Floats,
    times: Floats,
    vertical: Dual,
    horizontal: Dual,
    installed: float,
    *,
    vertical_flow: bool,
) -> Dual:
    """Degree of consolidation (m, k) of lifts at some times; 0 before a lift.

    Args:
        begin: (k,) of the lifts, s.
        end: (k,) s; none has begun before drains are installed and ends after.
        times: (m,) s.
        vertical: l_v, 1/s.
        horizontal: l_h, 1/s.
        installed: when the drains are, s.
        vertical_flow: water flows up and down as well.
    """
    t = times[:, None]
    span = end - begin
    until = np.minimum(t, end)  # what of a lift is there
    placed = np.where(t >= begin, 1.0, 0.0)
    gradual = np.divide(until - begin, span, out=np.ones_like(until), where=span > 0.0)
    part = placed * gradual
    age, lasted = np.maximum(t - until, 0.0), np.maximum(until - begin, 0.0)
    before = begin < installed
    waited = np.where(before, np.maximum(t - installed, 0.0), 0.0)  # drains act on lifts before
    k_j, a_j = _terms() if vertical_flow else (np.zeros(1), np.ones(1))
    l_v, l_h = float(vertical.value), float(horizontal.value)
    rate = k_j * l_v + np.where(before, 0.0, l_h)[:, None]  # (k, j)
    x = rate * lasted[..., None]
    old = part[..., None] * a_j * np.exp(-rate * age[..., None])
    left = old * _mean_decay(x)
    drained = np.exp(-l_h * waited)
    value = part - drained * left.sum(axis=-1)
    if vertical.n == 0:
        return Dual(value[..., None])
    slope = old * lasted[..., None] * _mean_decay_slope(x) - left * age[..., None]
    by_vertical = -drained * (slope * k_j).sum(axis=-1)
    by_horizontal = np.where(
        before, waited * drained * left.sum(axis=-1), -drained * slope.sum(axis=-1)
    )
    slopes = (
        by_vertical[..., None] * vertical.columns[1:]
        + by_horizontal[..., None] * horizontal.columns[1:]
    )
    return Dual(np.concatenate([value[..., None], slopes], axis=-1))


def _terms() -> tuple[Floats, Floats]:
    """k_j and a_j of Terzaghi's series, (j,)."""
    order = 2.0 * np.arange(TERMS, dtype=np.float64) + 1.0
    weight = 8.0 / (np.pi * order) ** 2
    weight[-1] += 1.0 - weight.sum()
    return 0.25 * np.pi**2 * order**2, weight


def _mean_decay(x: Floats) -> Floats:
    """(1 - exp(-x)) / x, which is 1 at 0."""
    safe = np.where(x > 0.0, x, 1.0)
    return np.where(x > 0.0, -np.expm1(-safe) / safe, 1.0)


_SMALL = 1e-3
"""Below it a series is more exact than the formula."""


def _mean_decay_slope(x: Floats) -> Floats:
    """Its derivative."""
    safe = np.where(x > _SMALL, x, 1.0)
    exact = (np.exp(-safe) * (1.0 + safe) - 1.0) / safe**2
    return np.where(x > _SMALL, exact, -0.5 + x / 3.0 - x**2 / 8.0 + x**3 / 30.0)


def log_time(begin: Floats, end: Floats, times: Floats, time: Dual) -> Dual:
    """log10(1 + t / T) (m, k) since lifts, the mean over each; 0 before it.

    Args:
        begin: (k,) of the lifts, s.
        end: (k,) s.
        times: (m,) s.
        time: T, s.
    """
    t = times[:, None]
    span = end - begin
    until = np.minimum(t, end)
    older, younger = np.maximum(t - begin, 0.0), np.maximum(t - until, 0.0)
    T = float(time.value)
    # the integral of log(1 + x) is (1 + x) log(1 + x) - x
    x, y = older / T, younger / T
    risen = T * ((1.0 + x) * np.log1p(x) - x - (1.0 + y) * np.log1p(y) + y)
    by_time = np.log1p(x) - x - np.log1p(y) + y
    sudden = span <= 0.0
    width = np.where(sudden, 1.0, span)
    value = np.where(sudden, np.log1p(x), risen / width) / np.log(10.0)
    slope = np.where(sudden, -x / (1.0 + x) / T, by_time / width) / np.log(10.0)
    return Dual(np.concatenate([value[..., None], slope[..., None] * time.columns[1:]], axis=-1))


class SettlementModel(ExternalModel):
    """A case whose readings a law of settlement gives.

    Args:
        case: the case.
        law: of the case.
    """

    def __init__(self, case: Case, law: SettlementLaw) -> None:
        seen = np.array([parameter.name in law.seen for parameter in case.parameters], dtype=bool)
        applies = (law.times >= law.since) | (law.consolidation is not None)
        provided = np.repeat(applies[:, None], len(case.channels), axis=1)
        super().__init__(case, provided, seen)
        self.law = law

    def given_readings(self, p: Floats, *, derivatives: bool, exact: bool) -> Floats:
        """Settlements at p (n,); NaN before the law applies."""
        names = self.names if derivatives else ()
        return settlement(self.law, self.law.times, self.values(p), names).columns

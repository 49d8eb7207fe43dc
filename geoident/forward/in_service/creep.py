"""What creep, ageing and softening of a material make of readings in service (theory 16.7).

s(t) is what all channels would see of the load on day t if the elastic strain of the material came
once more: the answer to its stress taken away. With g(t) from 0, by the time under load,

    creep      integral of g(t - t') ds(t')                    strain follows the stress late
    ageing     integral of (1 / (1 + g(t')) - 1) ds(t')        what is loaded later strains less
    softening  (1 / (1 - g(t)) - 1) s(t)                       all that is loaded strains more

s is linear between days, for which the first integral is exact.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from geoident.model.arrays import Floats
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.in_service import DAY, TimeCurve


def creep_motion(s: Floats, since: float, curve: TimeCurve, point: ParameterPoint) -> Floats:
    """The integral of g(t - t') ds(t') on days (d, n_channels, 1 + n).

    Args:
        s: (d, n_channels, 1 + n) on these days. That of the first has acted for some time.
        since: how long, s.
        curve: of the material.
        point: the parameters.
    """
    t, rise = DAY * np.arange(len(s), dtype=np.float64), np.diff(s, axis=0)
    ends = _integral(curve, t, point)
    ramp = ((ends[1:] - ends[:-1]) / DAY).columns  # of a rise over a day, by days since it began
    first = Dual(_grown(curve, since + t, point).columns[:, None]) * Dual(s[:1])
    motion = first.columns
    for h in range(s.shape[-1]):
        motion[1:, :, h] += _convolved(ramp[:, 0], rise[..., h])
        if h and ramp[:, h].any():
            motion[1:, :, h] += _convolved(ramp[:, h], rise[..., 0])
    return motion


def ageing_motion(s: Floats, since: float, curve: TimeCurve, point: ParameterPoint) -> Floats:
    """The integral of (1 / (1 + g(t')) - 1) ds(t'), likewise."""
    middle = since + DAY * (np.arange(len(s) - 1, dtype=np.float64) + 0.5)
    less = (_grown(curve, middle, point) + 1.0).reciprocal() + (-1.0)
    steps = Dual(less.columns[:, None]) * Dual(np.diff(s, axis=0))
    motion = np.zeros_like(s)
    np.cumsum(steps.columns, axis=0, out=motion[1:])
    return motion


def softening_motion(s: Floats, since: float, curve: TimeCurve, point: ParameterPoint) -> Floats:
    """(1 / (1 - g(t)) - 1) s(t), likewise."""
    grown = _grown(curve, since + DAY * np.arange(len(s), dtype=np.float64), point)
    more = (-grown + 1.0).reciprocal() + (-1.0)
    return (Dual(more.columns[:, None]) * Dual(s)).columns


MOTIONS = {"creep": creep_motion, "ageing": ageing_motion, "softening": softening_motion}
"""How a material changes to what that makes of readings."""


def curve_fault(kind: str, curve: TimeCurve, longest: float, point: ParameterPoint) -> str | None:
    """Why the numbers of a curve are impossible, a clause; None where they are not.

    Args:
        kind: a key of `MOTIONS`.
        curve: of the material.
        longest: time under load, s.
        point: the parameters.
    """
    share, time = (float(point.number(x).value) for x in (curve.share, curve.time))
    if not time > 0.0:
        return f"the time of its {kind} must be positive"
    if not share >= 0.0:
        return f"the share of its {kind} must not be negative"
    if kind == "softening":
        lost = float(_grown(curve, np.array([longest]), point).value[0])
        if not lost < 1.0:
            return f"its softening leaves no modulus: {lost:.3g} of it are lost at the end"
    return None


_FORMS: dict[str, tuple[Callable[[Dual], Dual], Callable[[Dual], Dual]]] = {
    "exponential": (lambda x: -(-x).exp() + 1.0, lambda x: x + (-x).exp() + (-1.0)),
    "logarithmic": (lambda x: (x + 1.0).log(), lambda x: (x + 1.0) * (x + 1.0).log() - x),
}
"""Of x = t / time: g by its share, and the integral of that over x."""


def _grown(curve: TimeCurve, t: Floats, point: ParameterPoint) -> Dual:
    """The growth g (k,) at times t (k,) under load, s."""
    x = _wide(point.number(curve.time).reciprocal()).times(t)
    return _wide(point.number(curve.share)) * _FORMS[curve.law][0](x)


def _integral(curve: TimeCurve, t: Floats, point: ParameterPoint) -> Dual:
    """The integral of g from 0 to t (k,), s."""
    time = point.number(curve.time)
    x = _wide(time.reciprocal()).times(t)
    return _wide(point.number(curve.share) * time) * _FORMS[curve.law][1](x)


def _wide(number: Dual) -> Dual:
    """A number as an array (1,)."""
    return Dual(number.columns[None])


def _convolved(weights: Floats, steps: Floats) -> Floats:
    """(k, c): at k the sum over j of weights (k,) at k - j times steps (k, c) at j."""
    length = 2 * len(steps)
    product = np.fft.rfft(weights, length)[:, None] * np.fft.rfft(steps, length, axis=0)
    return np.fft.irfft(product, length, axis=0)[: len(steps)]

"""How far to follow a Newton step: to near where what drives it comes to zero.

That is the slope of a potential, or the next step with the same factor, by its part along this one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

HARDLY_RISEN = 0.3
"""Part of what drives a step at its beginning that is nearly nothing."""

_OFF_THE_ENDS = 0.02
"""Part of its bracket by which a share stays off its ends, so that the bracket always shrinks."""

_MOST_CUTS = 40
"""Shares of a step that are tried; three are usual."""

EndT = TypeVar("EndT")


def zero_along(
    at: Callable[[float], EndT], drive: Callable[[EndT], float], first: float, last: float
) -> EndT:
    """Follow a step to near the zero of what drives it (Illinois variant of regula falsi).

    Args:
        at: where a share of the step, from 0 to 1, leads.
        drive: what drives it on from there.
        first: the same at its beginning, positive.
        last: the same at its end, negative.
    """
    low, high, whole = 0.0, 1.0, first
    for _ in range(_MOST_CUTS):
        share = (low * last - high * first) / (last - first)
        margin = _OFF_THE_ENDS * (high - low)
        share = float(np.clip(share, low + margin, high - margin))
        end = at(share)
        here = drive(end)
        if abs(here) <= HARDLY_RISEN * whole:
            break
        if here > 0.0:
            low, first, last = share, here, 0.5 * last
        else:
            high, last, first = share, here, 0.5 * first
    return end

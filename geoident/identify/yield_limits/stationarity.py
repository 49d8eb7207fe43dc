"""What a search for yield limits can say of its answer: the kind of stationary point.

With the residuals r and the Jacobian J of the active pieces in scaled parameters, the gradient of
parameter h is measured by its cosine |J_h^T r| / (|J_h| |r|), 0 where a bound holds it. Where no
strain point is biactive the response is smooth, and a gradient of zero is all that there is to
prove: the point is *strongly stationary*. At a kink the derivative differs from side to side: the
discrepancy itself is compared a small step away along every coordinate to both sides, along the
steepest descent and along the Gauss-Newton step. If it is lower nowhere, the point is *stationary
on the active pieces*. (That all directions are checked is not claimed: a kink of q planes has up to
2^q pieces.)

Where the readings are met exactly, nothing can meet them better: zero is the bound that proves it.

A strength whose planes are reached at a few points may owe that to noise; and its interval, made
with the derivatives of the active pieces, ends above although they cease. So a strength known no
better than `LOOSE` is raised to its upper bound, the others following to first order: if the
discrepancy grows by less than `PLAIN`, the readings do not exclude that no point reaches them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.identify.least_squares.acceptance import FIRST_RADIUS, Point
from geoident.identify.least_squares.bounded import bounded_least_squares
from geoident.identify.least_squares.gauss_newton import Search
from geoident.identify.yield_limits.unreached import headroom, unreached
from geoident.model.arrays import Bools, Floats
from geoident.model.certificate import Activity, Certificate

FLAT = 1e-4
"""A gradient below this, relative, is zero."""

PROBE = 1e-3
"""Length of the steps to the sides of a kink, relative."""

LOWER = 1e-4
"""A discrepancy lower by less than this part, a step away, is none."""

PLAIN = 3.84
"""Growth of the discrepancy at the end of a 95 % interval of one parameter."""

STRONG = "strongly stationary"
ACTIVE = "stationary on the active pieces"
NONE = "not stationary"
GLOBAL = "global"


@dataclass(frozen=True)
class Checked:
    """What one-sided derivatives say of a point.

    Args:
        point: the point.
        gradient: largest cosine between a column of J that is free to move and r.
        probes: how many points around it were compared; 0 where it was not necessary.
        lower: a lower point nearby, or None.
    """

    point: Point
    gradient: float
    probes: int
    lower: Point | None


def gradient(search: Search, point: Point) -> float:
    """The largest cosine of the module's head."""
    J, r = point.model.jacobian, point.model.residual
    low, high = search.box.sides(point.x, 1.0)
    g = J.T @ r
    g[((g > 0.0) & (low == 0.0)) | ((g < 0.0) & (high == 0.0))] = 0.0
    size = np.linalg.norm(J, axis=0) * np.linalg.norm(r)
    cosines = np.divide(np.abs(g), size, out=np.zeros_like(g), where=size > 0.0)
    return float(cosines.max(initial=0.0))


def check(
    search: Search, point: Point, *, kinks: int, exact: bool, spent: Callable[[], bool]
) -> Checked:
    """Looks to the sides of a point, where there is a kink or the gradient is not zero.

    Args:
        search: evaluates.
        point: the end of the search.
        kinks: biactive strain points there.
        exact: the readings are met exactly.
        spent: whether no more may be evaluated.
    """
    steepness = 0.0 if exact else gradient(search, point)
    if exact or (steepness <= FLAT and not kinks):
        return Checked(point, steepness, 0, None)
    best, probes = point, 0
    for x in _around(search, point):
        if spent():
            break
        trial = search.try_point(x)
        search.record(x, trial, PROBE, "probe")
        probes += 1
        if trial is not None and trial.phi < best.phi:
            best = trial
    return Checked(point, steepness, probes, best if _lower(best, point) else None)


def _lower(trial: Point, point: Point) -> bool:
    return trial.phi < (1.0 - LOWER) * point.phi


def _around(search: Search, point: Point) -> Iterator[Floats]:
    """Points (n,) a small step away, inside the bounds."""
    unit = search.box.unit(point.x)
    J, r = point.model.jacobian, point.model.residual
    slope = J.T @ r * unit
    newton = bounded_least_squares(J, r, *search.box.sides(point.x, PROBE)) / unit
    directions = [*np.eye(len(unit)), *-np.eye(len(unit)), -slope, newton]
    for d in directions:
        size = np.abs(d).max(initial=0.0)
        x = search.scaling.clip(point.x + PROBE * unit * d / (size or 1.0))
        if np.any(x != point.x):
            yield x


def open_above(
    search: Search, point: Point, strength: Bools, *, spent: Callable[[], bool]
) -> Bools:
    """Strengths (n,) of which the readings do not exclude that no point reaches their planes.

    Args:
        search: evaluates.
        point: the end of the search.
        strength: (n,) strengths whose planes are reached there.
        spent: whether no more may be evaluated.
    """
    found = np.zeros(len(strength), dtype=np.bool_)
    for i in np.flatnonzero(strength):
        if spent():
            break
        if not np.isfinite(search.scaling.upper[i]):
            continue
        x = point.x.copy()
        x[i] = search.scaling.upper[i]
        trial = search.try_point(x)
        search.record(x, trial, 0.0, "from above" if trial else "from above: no solution")
        found[i] = trial is not None and _expected(search, trial, int(i)) < point.phi + PLAIN
    return found


def _expected(search: Search, point: Point, held: int) -> float:
    """The linearised discrepancy after the best step of all parameters but one."""
    free = np.arange(len(point.x)) != held
    J, r = point.model.jacobian[:, free], point.model.residual
    low, high = search.box.sides(point.x, FIRST_RADIUS)
    d = bounded_least_squares(J, r, low[free], high[free])
    return float(np.sum((r + J @ d) ** 2))


def certificate(
    checked: Checked,
    activity: Activity,
    names: tuple[str, ...],
    *,
    exact: bool,
    above: Sequence[str] = (),
) -> Certificate:
    """What is proven at the end of a search.

    Args:
        checked: the end of the search.
        activity: the planes there.
        names: of the n parameters.
        exact: the readings are met exactly.
        above: names of the strengths that are `open_above`.
    """
    jacobian = checked.point.model.jacobian
    idle = unreached(activity, jacobian)
    least = checked.point.p - headroom(activity)
    kinks = int(activity.biactive.sum())
    return Certificate(
        kind=_kind(checked, kinks, exact=exact),
        gradient=checked.gradient,
        activity=activity,
        lower_bounds={names[i]: float(least[i]) for i in np.flatnonzero(idle & np.isfinite(least))},
        bound=0.0 if exact else float("nan"),
        open_above=tuple(above),
        remarks=(
            *_remarks(checked, kinks, exact=exact),
            *(
                f"The readings do not exclude that {name} is so large that no strain point reaches "
                "its planes: its interval has no upper end."
                for name in above
            ),
        ),
    )


def _kind(checked: Checked, kinks: int, *, exact: bool) -> str:
    if exact:
        return GLOBAL
    if checked.lower is not None:
        return NONE
    if checked.probes:
        return ACTIVE
    return STRONG if not kinks else NONE


def _remarks(checked: Checked, kinks: int, *, exact: bool) -> Iterator[str]:
    if exact:
        yield "The readings are met exactly: no parameters can meet them better."
    place = "The answer lies at a kink of the response"
    if not kinks:
        place = "The answer lies within a hair of a kink of the response"
    if checked.probes and checked.lower is None:
        yield f"{place}: {checked.probes} points around it were compared, and none is better."
    if checked.lower is not None:
        yield f"{place}, and a point near it is better."

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
with the derivatives of the active pieces, ends above although they cease. So every strength whose
planes are reached is raised to its upper bound, the others following to first order: if the
discrepancy grows by less than `GROWTH_95`, the readings do not exclude that no point reaches them.

Where n^T sigma stays below k everywhere and always, a smaller k, down to the largest n^T sigma,
gives the same response to the last digit. So k is known to be at least that and no more: the
*bound information* of planes that are not violated. A search brings such planes as near as can be
(`yield_evaluator`): they yield as soon as their neighbours give way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.identify.least_squares.acceptance import Iterate
from geoident.identify.least_squares.descent import Evaluator, gradient_cosines
from geoident.identify.least_squares.gauss_newton import phi_after_step
from geoident.identify.least_squares.trust_region import bounded_least_squares
from geoident.identify.problem.outcome import History
from geoident.identify.problem.problem import Discrepancy
from geoident.identify.problem.responses import YieldSystem
from geoident.model.arrays import Bools, Floats
from geoident.model.results.bands import NORMAL_95
from geoident.model.yielding import Activity, Certificate

FLAT = 1e-4
"""A gradient below this, relative, is zero."""

PROBE = 1e-3
"""Length of the steps to the sides of a kink, relative."""

LOWER = 1e-4
"""A discrepancy lower by less than this part, a step away, is none."""

GROWTH_95 = NORMAL_95**2
"""Growth of the discrepancy at the end of a 95 % interval of one parameter."""

BESIDE, FAR_ABOVE = 0.05, 10.0
"""How near, relative, a point must be to stand for another, and by how many times the growth its
discrepancy must be higher then."""

STRONG = "strongly stationary"
ACTIVE = "stationary on the active pieces"
NONE = "not stationary"
GLOBAL = "global"


@dataclass(frozen=True)
class StationarityCheck:
    """What one-sided derivatives say of a point.

    Args:
        point: the point.
        gradient: largest cosine between a column of J that is free to move and r.
        probes: how many points around it were compared; 0 where it was not necessary.
        lower: a lower point nearby, or None.
    """

    point: YieldIterate
    gradient: float
    probes: int
    lower: YieldIterate | None


def check(
    evaluator: Evaluator[YieldIterate],
    point: YieldIterate,
    *,
    exact: bool,
    spent: Callable[[], bool],
    least: float = 0.0,
) -> StationarityCheck:
    """Looks to the sides of a point, where there is a kink or the gradient is not zero.

    Args:
        evaluator: evaluates and records.
        point: the end of the search.
        exact: the readings are met exactly.
        spent: whether no more may be evaluated.
        least: by how much the discrepancy must be lower there to count, in squared accuracies.
    """
    cosines = gradient_cosines(evaluator.box, point)
    steepness = 0.0 if exact else float(cosines.max(initial=0.0))
    if exact or (steepness <= FLAT and not kinks(point.activity)):
        return StationarityCheck(point, steepness, 0, None)
    lowest, probes, place = point.phi, 0, None
    for x in _around(evaluator, point):
        if spent():
            break
        phi = evaluator.value(x, PROBE, "probe")
        probes += 1
        if phi < lowest:
            lowest, place = phi, x
    lower = None
    if place is not None and lowest < point.phi - max(LOWER * point.phi, least):
        lower = evaluator.try_point(place)
    return StationarityCheck(point, steepness, probes, lower)


def kinks(activity: Activity) -> int:
    """Number of strain points that are on a plane without flowing, over all stages."""
    return int(activity.biactive.sum())


def _around(evaluator: Evaluator[YieldIterate], point: YieldIterate) -> Iterator[Floats]:
    """Points (n,) a small step away, inside the bounds."""
    box, unit = evaluator.box, evaluator.box.unit(point.x)
    J, r = point.model.jacobian, point.model.residual
    slope = J.T @ r * unit
    newton = bounded_least_squares(J, r, *box.sides(point.x, PROBE)) / unit
    directions = [*np.eye(len(unit)), *-np.eye(len(unit)), -slope, newton]
    for d in directions:
        size = np.abs(d).max(initial=0.0)
        x = evaluator.scaling.clip(point.x + PROBE * unit * d / (size or 1.0))
        if np.any(x != point.x):
            yield x


def open_above(
    evaluator: Evaluator[YieldIterate],
    point: YieldIterate,
    strength: Bools,
    *,
    spent: Callable[[], bool],
) -> Bools:
    """Strengths (n,) of which the readings do not exclude that no point reaches their planes.

    Args:
        evaluator: evaluates and records.
        point: the end of the search.
        strength: (n,) strengths whose planes are reached there.
        spent: whether no more may be evaluated.
    """
    found = np.zeros(len(strength), dtype=np.bool_)
    for i in np.flatnonzero(strength & np.isfinite(evaluator.scaling.upper)):
        found[i] = not spent() and _open_above(evaluator, point, int(i))
    return found


def _open_above(evaluator: Evaluator[YieldIterate], point: YieldIterate, i: int) -> bool:
    """Whether the discrepancy hardly grows where one strength is raised to its upper bound.

    A search for nearly the same readings has mostly looked there before: what the model said then
    is enough where the discrepancy is far higher.
    """
    x = point.x.copy()
    x[i] = evaluator.scaling.upper[i]
    others = np.arange(len(x)) != i
    for known in evaluator.evaluated_near(x, BESIDE):
        if not np.isclose(known.x[i], x[i], rtol=1e-9, atol=0.0):
            continue
        if phi_after_step(evaluator.box, known, others) > point.phi + FAR_ABOVE * GROWTH_95:
            return False
    trial = evaluator.start(x, "from above")
    if trial is None:
        return False
    return phi_after_step(evaluator.box, trial, others) < point.phi + GROWTH_95


def certificate(
    checked: StationarityCheck,
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
    at_kink = kinks(activity) > 0
    return Certificate(
        kind=_kind(checked, at_kink=at_kink, exact=exact),
        gradient=checked.gradient,
        activity=activity,
        lower_bounds={names[i]: float(least[i]) for i in np.flatnonzero(idle & np.isfinite(least))},
        bound=0.0 if exact else float("nan"),
        open_above=tuple(above),
        remarks=(
            *_remarks(checked, at_kink=at_kink, exact=exact),
            *(
                f"The readings do not exclude that {name} is so large that no strain point reaches "
                "its planes: its interval has no upper end."
                for name in above
            ),
        ),
    )


def _kind(checked: StationarityCheck, *, at_kink: bool, exact: bool) -> str:
    if exact:
        return GLOBAL
    if checked.lower is not None:
        return NONE
    if checked.probes:
        return ACTIVE
    return NONE if at_kink else STRONG


def _remarks(checked: StationarityCheck, *, at_kink: bool, exact: bool) -> Iterator[str]:
    if exact:
        yield "The readings are reproduced exactly: no parameters can fit them better."
    place = "The answer lies at a kink of the response"
    if not at_kink:
        place = "The answer lies very close to a kink of the response"
    if checked.probes and checked.lower is None:
        yield f"{place}: {checked.probes} points around it were compared, and none is better."
    if checked.lower is not None:
        yield f"{place}, and a point near it is better."


CLOSE = 1e-6
"""An unreached plane is kept this far, relative, from where it is reached."""

_PART = 1e-12
"""A derivative below this part of the largest is none."""


@dataclass(frozen=True)
class YieldIterate(Iterate):
    """A point with its yield planes, those that no strain point reaches as near as can be.

    Args:
        unreached: (n,) strengths whose planes no strain point reaches.
        activity: the planes at the point that was evaluated, before they were brought near.
    """

    unreached: Bools
    activity: Activity


def yield_evaluator(
    discrepancy: Discrepancy, history: History, model: YieldSystem
) -> Evaluator[YieldIterate]:
    """An evaluator that brings unreached planes near.

    Args:
        discrepancy: of the problem.
        history: is told of every point that is recorded.
        model: of the problem.
    """
    scaling = discrepancy.scaling

    def brought_near(point: Iterate) -> YieldIterate:
        activity = model.activity(point.p)
        idle = unreached(activity, point.model.jacobian)
        room = headroom(activity) - CLOSE * np.abs(point.p)
        near = idle & np.isfinite(room) & (room > 0.0)
        x = scaling.to_scaled(np.where(near, point.p - np.where(near, room, 0.0), point.p))
        return YieldIterate(x, scaling.to_natural(x), point.model, idle, activity)

    return Evaluator(discrepancy, history, brought_near)


def strengths(activity: Activity, scaling: Floats) -> Bools:
    """Parameters (n,) whose growth moves planes away, and brings none nearer.

    Args:
        activity: the planes.
        scaling: dp/dx (n,), SI.
    """
    slopes = activity.slopes * scaling
    least = _PART * np.abs(slopes).max(initial=0.0)
    return np.asarray((slopes > least).any(axis=0) & ~(slopes < -least).any(axis=0))


def unreached(activity: Activity, jacobian: Floats) -> Bools:
    """Parameters (n,) that act on planes only, none of which any strain point reaches.

    Args:
        activity: the planes.
        jacobian: (g, n) derivatives of the readings there, in any scaling of the readings.
    """
    idle = (activity.points.sum(axis=1) == 0)[:, None]
    moved = np.abs(activity.slopes) > _PART * np.abs(activity.slopes).max(initial=0.0)
    silent = np.linalg.norm(jacobian, axis=0) == 0.0
    return np.asarray(moved.any(axis=0) & (idle | ~moved).all(axis=0) & silent)


def headroom(activity: Activity) -> Floats:
    """By how much (n,), SI, each parameter alone can fall before a point reaches one of its planes.

    The distances are linear in a strength. 0 where a plane is reached, infinite where no strain
    point has the material or the parameter moves no plane outwards.
    """
    gap = np.maximum(activity.distances - activity.reached, 0.0)
    gap[activity.points.sum(axis=1) > 0] = 0.0
    slopes = activity.slopes
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(slopes > 0.0, gap[:, None] / slopes, np.inf)
    return np.asarray(room.min(axis=0, initial=np.inf), dtype=np.float64)

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

Of a strength whose planes no strain point reaches (`yield_points`) only a lower bound is known: the
*bound information* of planes that are not violated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.identify.least_squares.descent import Evaluator, gradient_cosines
from geoident.identify.least_squares.gauss_newton import phi_after_step
from geoident.identify.least_squares.trust_region import bounded_least_squares
from geoident.identify.yield_limits.yield_points import YieldIterate, headroom, unreached
from geoident.model.arrays import Bools
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
    steepness = 0.0 if exact else float(gradient_cosines(evaluator.box, point).max(initial=0.0))
    if exact or (steepness <= FLAT and not kinks(point.activity)):
        return StationarityCheck(point, steepness, 0, None)
    unit = evaluator.box.unit(point.x)
    J, r = point.linearization.jacobian, point.linearization.residual
    newton = bounded_least_squares(J, r, *evaluator.box.sides(point.x, PROBE)) / unit
    axes = np.eye(len(unit))
    lowest, probes, place = point.phi, 0, None
    for d in (*axes, *-axes, -(J.T @ r * unit), newton):
        size = float(np.abs(d).max(initial=0.0)) or 1.0
        x = evaluator.scaling.clip(point.x + PROBE * unit * d / size)
        if np.array_equal(x, point.x):  # held by bounds
            continue
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
    flags = np.zeros(len(strength), dtype=np.bool_)
    for i in np.flatnonzero(strength & np.isfinite(evaluator.scaling.upper)):
        flags[i] = not spent() and _open_above(evaluator, point, int(i))
    return flags


def _open_above(evaluator: Evaluator[YieldIterate], point: YieldIterate, i: int) -> bool:
    """Whether the misfit hardly grows where one strength is raised to its upper bound.

    A search for nearly the same readings has mostly looked there before: what the model said then
    is enough where the misfit is far higher.
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
    at_kink, remarks = kinks(activity) > 0, []
    place = f"The answer lies {'at' if at_kink else 'very close to'} a kink of the response"
    if exact:
        kind = GLOBAL
        remarks.append("The readings are reproduced exactly: no parameters can fit them better.")
    elif checked.lower is not None:
        kind = NONE
        remarks.append(f"{place}, and a point near it is better.")
    elif checked.probes:
        kind = ACTIVE
        compared = f"{checked.probes} points around it were compared"
        remarks.append(f"{place}: {compared}, and none is better.")
    else:
        kind = NONE if at_kink else STRONG
    remarks += [
        f"The readings do not exclude that {name} is so large that no strain point reaches "
        "its planes: its interval has no upper end."
        for name in above
    ]
    idle = unreached(activity, checked.point.linearization.jacobian)
    least = checked.point.p - headroom(activity)
    return Certificate(
        kind=kind,
        gradient=checked.gradient,
        activity=activity,
        lower_bounds={names[i]: float(least[i]) for i in np.flatnonzero(idle & np.isfinite(least))},
        bound=0.0 if exact else float("nan"),
        open_above=tuple(above),
        remarks=tuple(remarks),
    )
